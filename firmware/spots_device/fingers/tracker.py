"""Converts readings to touches: press, movement, firm press and release, debounced.

One reading of six channels cannot distinguish two fingers from one finger between them. A sequence
of readings can, because nearly every finger is alone on the strip for some readings. While there
may be several fingers, the measured position lies between them and is not reported. The tracker is
a state machine with the states UP (no finger), DOWN (one finger) and TWO (perhaps several fingers).
In a fourth state, SPENT, a touch is ignored until it ends. In the table, "the position" is the
measured one; `detect` is set in the layout:

====  =====  ==================================================================================
from  to     when
====  =====  ==================================================================================
UP    DOWN   `detect` consecutive readings agree on a position, or on a steady motion
UP    TWO    readings disagree for 40 ms: fingers touched together at unknown positions
DOWN  DOWN   the position is that of the finger, or the finger slides
DOWN  TWO    otherwise; the first finger gets the position that it had one reading *earlier*
TWO   DOWN   the position stays where the first finger was, or nearer to it than a second finger can
             be: the second finger has left, or the first one rolled or slid
TWO   DOWN   the position stays elsewhere, and the first finger has left: it was lifting, or the
             brightness was never that of two fingers, or no second finger could cause this position
TWO   DOWN   while the first finger lifts, the position approaches the second finger in ever smaller
             steps, or the estimated position of this finger, and less than 2 mm remain
TWO   DOWN   while the first finger lifts, the position has almost reached the second finger (the
             last step was small), and the light then grows, because a third finger arrives
TWO   UP     while the first finger lifts, the position has almost reached the second finger, and
             then no finger touches: the second finger is reported for a moment
TWO   DOWN   the position stays, although the light changes: only one finger touches
TWO   TWO    the first finger rests, and two readings agree on the position of the second finger
             (second.py); the light of the first finger may be unknown
TWO   TWO    the second finger slides, at least 0.1 s after the start of TWO; the readings show that
             the first finger rests and does not lift
TWO   DOWN   one of two known fingers has left: one reading shows which one
TWO   TWO    two known fingers rest, and two readings agree on the position of a third finger
TWO   TWO    the first finger has left: it began to lift 35 ms ago, or two readings lie between the
             second and a third finger; the second finger is now the first one
TWO   UP     no finger touches
====  =====  ==================================================================================

A second finger may rest beside the first one without being found. If one of the two then leaves,
the second finger's position is computed from earlier readings. A release is delayed by `release_ms`
(release debounce). The conditions about other fingers are in pair.py and evidence.py.
Integers only; allocates nothing.
"""

from array import array

from .. import const
from ..reading.decode import (
    LED_OFF,
    MISFIT,
    NOT_CALIBRATED,
    SATURATED,
    TOO_DARK,
    TOUCHING,
)
from .evidence import (
    has_almost_left,
    has_left,
    recalls,
    slack_um,
)
from .locate import noise
from .pair import watch
from .state import (
    APART_UM,
    B_BEFORE,
    B_BOTH,
    B_GUESS,
    B_NOW,
    B_OLDEST,
    B_SECOND,
    B_SEEN,
    BEGAN,
    CALM,
    CHECKED,
    DECAY,
    DETECT,
    DOWN,
    DRIFTS,
    ENDS,
    EVEN,
    FALLS,
    FELL,
    FIRM_MN,
    FITS,
    FLAGS_NOW,
    FORCE_MN,
    FORCE_NOW_MN,
    FOUND,
    FOUND_SLACK_UM,
    FOUND_UM,
    GUESSED,
    HAS_DIPPED,
    HIGH_MN,
    HIGH_UM,
    HINT_UM,
    IGNORED,
    IS_CALM,
    IS_EVEN,
    JUMP_UM,
    KNOWN,
    LEAST,
    LEAVING,
    LEFT,
    LENGTH_UM,
    LIFTED,
    LOOSE,
    LOST,
    LOW,
    LOW_MN,
    LOW_UM,
    MOVED,
    NEAR_UM,
    NEVER,
    NEXT,
    NOISE_PRODUCT,
    ODD,
    PAIR,
    PEAK,
    PRESS_MN,
    RELEASE_MN,
    RELEASE_T,
    REMAINS,
    RESTED,
    RISES,
    SAME,
    SAME_UM,
    SECOND,
    SEEN,
    SINCE,
    SINGLE,
    SIZE,
    SLACK_GUESS_UM,
    SOON,
    SPENT,
    STATE,
    STEP_UM,
    STILL,
    STUCK_T,
    T_NOW,
    THIRD,
    TICKS,
    TWO,
    UP,
    X_BEFORE_UM,
    X_GUESS_UM,
    X_NOW_UM,
    X_PEAK_UM,
    X_SECOND_UM,
    X_SEEN_UM,
    X_UM,
    B,
    T,
)
from .steady import stays

DOUBTFUL = LED_OFF | MISFIT | NOT_CALIBRATED | SATURATED | TOO_DARK
# Flags of an untrusted reading whose spectrum fits one press well enough for a key: the strip has
# drifted, or there are two fingers.
TWO_FIT = MISFIT | TOO_DARK
_BLIND = NOT_CALIBRATED | SATURATED
TICK_US = 1024  # see `TICKS`

# Product of the light in counts and the standard deviation of the position in um by ADC noise, at
# the far end of a strip of 85 mm. The product grows with the square of the strip's length.
_NOISE = const(90_000)
_TYPICAL = const(289)  # decay for which `_NOISE` was measured, see `locate.locate`
_SLIDE_LIGHT = const(9000)  # largest change of brightness per tick in a slide, Q20 of log2
_TOGETHER_T = const(39)  # if readings disagree for this time, fingers touched together
_REST_T = const(12)  # least time for which the position must stay
_MOVED_UM = const(1500)
# Ratios of light as differences of brightness, Q20 of log2.
_FALLEN = const(772_000)  # 0.6
# Limits for the detection of a second finger beside the first one.
# Share of the estimate's uncertainty that must be inside a key, in eighths. `SOON` is about two
# standard deviations; `_LATER` is about one, because the key would be lost otherwise.
_LATER = const(4)
_FALL_T = const(34)  # longest time in which a finger lifts
# Limits for the detection of a third finger.
_GROWN = const(116_000)  # 1.08
_BOTH = const(397_000)  # 1.3
_HALF = const(1 << 20)  # 2


def elapsed(since, now):
    """Return the ticks from the time `since` to the later time `now`, both in ticks.

    The result is correct if the times are less than `TICKS` apart, even if the counter wraps.
    """
    return (now - since) & (TICKS - 1)


class ContactTracker:
    """Converts the readings of a strip to touches.

    Parameters
    ----------
    sink : object
        Receiver with these methods; `t` is the time in ticks of `TICK_US`, `x_um` a position in um:
        ``down(x_um, t)``: a finger touches. ``at(x_um, t)``: new position of this finger, while it
        is alone; if the method returns true, the tracker may stop reporting the positions of this
        finger. ``firm(t)``: the force has reached ``firm_mN``; called once for each touch.
        ``up(t)``: the finger has left. ``next(x_um, t)``: the finger has left, and another one
        touches. ``stuck()``: the touch has not moved for ``stuck_ms``, so it is not a finger. If
        the strip length is known, also these methods: ``second(x_um, slack_um, t) -> bool``: a
        second finger touches, at `x_um` +- `slack_um`. Returns whether the sink uses this finger.
        If the sink already uses a second finger, this is a third finger. ``left(second, t)``: the
        second finger has left if `second` is true, else the first one. ``moved(x_um, slack_um)``:
        new estimate of the second finger's position, while the first one rests.
    """

    def __init__(self, sink):
        self.sink = sink
        self._layout = None
        self.state = s = array("i", bytes(4 * SIZE))
        s[STATE] = SPENT
        s[FIRM_MN] = NEVER

    def report_to(self, sink):
        """Use another receiver; it gets the positions of a finger that already touches."""
        self.sink = sink
        self.state[IGNORED] = False

    @property
    def x_um(self):
        """Position of the first finger in um."""
        return self.state[X_UM]

    @property
    def force_mN(self):
        """Force of the last reading that fits one press, in mN."""
        return self.state[FORCE_MN]

    @property
    def touched(self):
        """Whether a finger with a known position touches the strip."""
        s = self.state
        return s[STATE] == DOWN or (s[STATE] == TWO and s[KNOWN])

    @property
    def two(self):
        """Whether more than one finger may touch the strip."""
        return self.state[STATE] == TWO

    def set_layout(self, layout, length_um=0, decay=0):
        """Set the limits and the strip length; a finger that touches is ignored until it lifts.

        Parameters
        ----------
        layout : layout.Layout
            Layout whose limits are used, see `layout.LIMITS`.
        length_um : int
            Length of the strip in um. With 0, one finger is expected: a movement up to ``jump_um``
            is a slide, and readings that do not fit one press are ignored.
        decay : int
            Decay of the light by the dye, see `locate.locate`.
        """
        s = self.state
        self._layout = layout
        s[RELEASE_MN] = layout.release_mN
        s[PRESS_MN] = layout.press_mN
        s[STUCK_T] = layout.stuck_t
        s[DETECT] = layout.detect
        s[JUMP_UM] = layout.jump_um
        s[RELEASE_T] = layout.release_t
        s[DECAY] = decay
        s[LENGTH_UM] = length_um
        # Light decreases along a strip, and a long strip needs a weak dye: the noise grows. The
        # position comes from the decay: half the decay, twice the noise.
        share = min(max(length_um, 0), 600_000) * 3 // 1000
        product = max(share * share * 18 // 13, _NOISE)
        s[NOISE_PRODUCT] = max(product, product // max(decay, 72) * _TYPICAL)
        self.spend()

    def spend(self):
        """End the present touch; the finger must be lifted before a new touch can begin."""
        s = self.state
        s[STATE] = SPENT
        s[SEEN] = 0
        s[LEAVING] = False

    def take(self, flags, position_um, force_mN, brightness, t):
        """Process a reading: update the state, and call the methods of `sink`.

        Parameters
        ----------
        flags : int
            Flag bits of the reading, see the module `decode`.
        position_um, force_mN : int
            Position in um and force in mN.
        brightness : int
            Brightness in Q20 of log2.
        t : int
            Time in ticks of `TICK_US`.
        """
        # The call frames of this function and of most that it calls have at most 11 words, see
        # strip.py: the reading is in the state.
        s = self.state
        if flags & LED_OFF:
            return  # with the LED off, a touch cannot be detected
        s[X_NOW_UM] = position_um
        s[FORCE_NOW_MN] = force_mN
        s[B_NOW] = brightness
        s[T_NOW] = t
        if s[STATE] == DOWN:
            if stays(s, flags):
                if not s[IGNORED] and self.sink.at(position_um, t):
                    s[IGNORED] = True
                return
        elif s[STATE] == TWO and self._part(flags):
            return
        if not flags & TOUCHING or (force_mN < s[RELEASE_MN] and not flags & DOUBTFUL):
            if s[STATE] != UP:
                self._lift(t)
            else:
                s[SEEN] = 0
            if force_mN and not flags & MISFIT and s[STATE] == UP:
                self._approach()
            return
        if s[LEAVING]:
            s[LEAVING] = False
            s[HAS_DIPPED] = True
        if flags & _BLIND:
            s[SEEN] = 0
            return
        s[FITS] = not flags & MISFIT or flags & TWO_FIT == TWO_FIT
        if s[FITS]:
            s[FORCE_MN] = force_mN
            if s[STUCK_T] and s[STATE] and self._rests():
                s[STATE] = SPENT
                self.sink.stuck()
                return
        elif not s[LENGTH_UM]:
            return
        if s[STATE] == DOWN:
            self._follow()
        elif s[STATE] == UP:
            self._press()
        elif s[STATE] == TWO:
            self._part(flags | CHECKED)
        if s[STATE] == DOWN:
            s[DRIFTS] = flags & MISFIT
        s[T] = t

    def _lift(self, t):
        s = self.state
        if not s[LEAVING]:
            s[LEAVING] = True
            s[LEFT] = s[T]
        if elapsed(s[LEFT], t) < s[RELEASE_T]:
            return
        s[LEAVING] = False
        if s[STATE] == TWO and has_almost_left(s):
            self.sink.next(s[X_SEEN_UM], t)
        down, s[STATE] = self.touched, UP
        s[SEEN] = 0
        if down:
            self.sink.up(t)

    # State UP.

    def _approach(self):
        """Record a reading that may be the first reading of a touch."""
        s = self.state
        s[BEGAN] = s[SINCE] = s[T_NOW]
        s[X_UM] = s[X_SEEN_UM] = s[X_NOW_UM]
        s[B_SEEN] = s[B_NOW]
        s[STEP_UM] = 0
        s[SEEN] = 1

    def _press(self):
        s = self.state
        if s[FORCE_NOW_MN] < s[PRESS_MN]:
            s[SEEN] = 0
            if s[FITS]:
                self._approach()
            return
        x_um = s[X_NOW_UM]
        moved_um = x_um - s[X_SEEN_UM]
        if not s[SEEN]:
            self._approach()
        elif (
            s[FITS]
            and s[SEEN] > 0
            and abs(moved_um) < (slack_um(s, s[B_SEEN]) * 5 >> 2 if s[LENGTH_UM] else s[JUMP_UM])
        ):
            s[SEEN] += 1
        else:
            steady = s[STEP_UM] and abs(moved_um - s[STEP_UM]) < slack_um(s, s[B_SEEN])
            if s[FITS] and steady and abs(moved_um) <= s[JUMP_UM]:
                s[SEEN] = s[DETECT]  # the finger slides already
            else:
                s[SEEN] = 1
                s[X_UM] = x_um
                if elapsed(s[BEGAN], s[T_NOW]) >= _TOGETHER_T:
                    s[KNOWN] = s[IS_EVEN] = False
                    self._mix()
                    return
        # Three readings show whether a motion is steady.
        s[STEP_UM] = moved_um if s[SEEN] == 1 and elapsed(s[BEGAN], s[T_NOW]) else 0
        if not s[FITS]:
            s[STEP_UM] = 0
            s[SEEN] = -1
        s[X_SEEN_UM] = x_um
        s[B_SEEN] = s[B_NOW]
        if s[SEEN] >= s[DETECT]:
            self._begin(x_um, s[B_NOW])
            s[B_BEFORE] = 0
            self.sink.down(x_um, s[T_NOW])
            self._harden()

    # State DOWN.

    def _begin(self, x_um, brightness):
        s = self.state
        s[STATE] = DOWN
        s[SEEN] = 0
        s[LOOSE] = False
        s[HAS_DIPPED] = s[IGNORED] = False
        s[X_UM] = s[X_BEFORE_UM] = x_um
        s[B] = s[B_BEFORE] = brightness
        s[B_OLDEST] = 0
        s[X_SEEN_UM] = x_um
        s[FIRM_MN] = self._layout.firm_mN
        self._rest(x_um)

    def _follow(self):
        s = self.state
        x_um = s[X_NOW_UM]
        off_um = x_um - s[X_UM]
        if s[FITS] and -SAME_UM < off_um < SAME_UM:
            off_um >>= 1
            s[LOOSE] = False
        elif s[FITS] and s[LOOSE] and -NEAR_UM < off_um < NEAR_UM:
            pass
        elif self._is_next(off_um):
            self._part(CHECKED)
            return
        s[X_BEFORE_UM] = s[X_UM]
        s[X_UM] += off_um
        s[X_SEEN_UM] = x_um
        s[B_OLDEST] = s[B_BEFORE]
        s[B_BEFORE] = s[B]
        s[B] = s[B_NOW]
        s[HAS_DIPPED] = False
        self.sink.at(x_um, s[T_NOW])
        if s[FORCE_NOW_MN] >= s[FIRM_MN]:
            self._harden()

    def _is_next(self, off_um):
        """Return whether a reading at a new position may be of two fingers; if so, enter state TWO.

        `off_um` is the distance of the reading from the finger, in um.
        """
        s = self.state
        if s[FITS] and not s[HAS_DIPPED]:
            if abs(off_um) < 4 * noise(s[NOISE_PRODUCT], s[B_NOW]):
                return False
            if abs(s[X_NOW_UM] - s[X_SEEN_UM]) <= s[JUMP_UM] and (
                not s[LENGTH_UM]
                or abs(s[B_NOW] - s[B])
                <= _SLIDE_LIGHT * min((s[T_NOW] - s[T]) & (TICKS - 1), _TOGETHER_T)
            ):
                return False
        self._overlap()
        return True

    def _overlap(self):
        # Another finger may have touched at the present reading: enter state TWO.
        self._mix()
        s = self.state
        before = s[B_BEFORE]
        risen = s[B] - before
        drift = abs(before - s[B_OLDEST])
        s[IS_CALM] = abs(risen) < CALM and drift < CALM
        if not before:
            drift = EVEN
        s[IS_EVEN] = risen > -EVEN and (risen < EVEN or drift < EVEN)
        s[RISES] = risen >= EVEN and drift >= EVEN
        s[FALLS] = risen <= -EVEN
        s[FELL] = s[T_NOW]
        if s[LEAST] > s[B]:
            s[LEAST] = s[B]
        if s[LEAST] < max(s[B], before, s[B_OLDEST]) - _FALLEN:
            s[HAS_DIPPED] = True
        s[KNOWN] = True
        s[X_UM] = s[X_BEFORE_UM]
        if not s[RISES]:
            s[B] = before
        s[SEEN] = -1

    # State TWO.

    def _mix(self):
        s = self.state
        s[STATE] = TWO
        s[BEGAN] = s[T_NOW]
        s[ODD] = s[SECOND] = s[THIRD] = False
        s[RESTED] = s[GUESSED] = s[PAIR] = False
        s[B_BOTH] = 0
        s[HINT_UM] = -NEVER
        s[PEAK] = s[LEAST] = s[LOW] = s[B_NOW]
        s[X_PEAK_UM] = s[X_NOW_UM]

    def _part(self, flags):
        """Process a reading in the state TWO; return False if `take` must check it first."""
        s = self.state
        s[FLAGS_NOW] = flags
        what = watch(s, s, s[B_NOW], s)
        if what <= 0:
            return not what
        if what == MOVED:
            self.sink.moved(s[FOUND_UM], s[FOUND_SLACK_UM])
            return True
        t = s[T_NOW]
        if what < MOVED:
            if what & FOUND:
                self._add(s[SLACK_GUESS_UM] * SOON >> 3)
            if what & REMAINS:
                self._remain(what)
        elif what == NEXT:
            self._begin(s[X_SEEN_UM], s[B_SEEN])
            s[LOOSE] = True
            self.sink.next(s[X_UM], t)
            self._follow()
        elif what == LIFTED:
            b = s[B_SECOND]
            s[SECOND] = False
            self._begin(s[X_NOW_UM], s[B_NOW])
            s[B_BEFORE] = b
            s[LOOSE] = True
            self.sink.left(False, t)
            self.sink.at(s[X_NOW_UM], t)
        elif what & 0xFF == SAME:
            self.sink.second(s[X_GUESS_UM], what >> 8, t)
            self.sink.moved(s[X_SECOND_UM], what >> 8)
        else:
            self._fade(what >> 8)
        if s[STATE] == DOWN:
            s[DRIFTS] = flags & MISFIT
        s[T] = t
        return True

    def _add(self, slack_um):
        # Report the finger that was estimated last; it becomes the second one.
        s = self.state
        s[SECOND] = self.sink.second(s[X_GUESS_UM], slack_um, s[T_NOW])
        s[X_SECOND_UM] = s[X_GUESS_UM]
        s[B_SECOND] = s[B_GUESS]

    def _fade(self, slack_um):
        # The first finger has left. With `slack_um`, there is an estimate of a third one.
        s = self.state
        s[X_UM] = s[X_BEFORE_UM] = s[X_SECOND_UM]
        s[B] = s[B_SECOND]
        s[SECOND] = False
        self._mix()
        s[IS_EVEN] = s[PAIR] = True
        s[HAS_DIPPED] = s[IS_CALM] = False
        s[FALLS] = False
        s[LOOSE] = True
        self.sink.left(False, s[T_NOW])
        if slack_um and s[B_GUESS] > s[B] - _HALF:
            self._add(slack_um)

    def _remain(self, how):
        # Only one finger seems to touch. `how`: the result of `pair.watch`.
        s = self.state
        x_um = s[X_NOW_UM]
        t = s[T_NOW]
        if not s[KNOWN]:
            # If light was lost and the position moved, one of two fingers has left. Or there was
            # only one finger, and ambient light that is now off.
            if (s[B_NOW] < s[PEAK] - LOST and abs(x_um - s[X_PEAK_UM]) > _MOVED_UM) or (
                s[ODD] and elapsed(s[SINCE], t) >= _TOGETHER_T
            ):
                self._begin(x_um, s[B_NOW])
                s[B_BEFORE] = 0
                self.sink.down(x_um, t)
                self._recall()
                self._harden()
            return
        off_um = x_um - s[X_UM]
        # Two fingers are at least `APART_UM` apart. So a nearer position is that of the first
        # finger, which rolled, or slid while it lifted. If a second finger is known, it may also
        # be the position of both. The first reading of a soft touch is noisier than this one.
        back_um = NEAR_UM if s[SECOND] else APART_UM
        if abs(off_um) < back_um + 2 * noise(s[NOISE_PRODUCT], min(s[B_NOW], s[B])):
            firm_mN = s[FIRM_MN]
            if not s[SECOND]:
                self._recall()
            self._begin(x_um, s[B_NOW])
            s[FIRM_MN] = firm_mN
            if s[SECOND]:
                s[SECOND] = False
                self.sink.left(True, t)
            self.sink.at(x_um, t)
        elif how & SINGLE or has_left(s, off_um):
            stays = s[SECOND] and not s[HAS_DIPPED] and abs(x_um - s[X_SECOND_UM]) < APART_UM
            if not stays:
                if s[SECOND]:
                    self.sink.left(True, t)
                if not how & ENDS:
                    self._recall()
            s[SECOND] = False
            self._begin(x_um, s[B_NOW])
            if stays:
                self.sink.left(False, t)
            else:
                s[B_BEFORE] = 0
                s[LOOSE] = 1 if how & ENDS else 0
                self.sink.next(x_um, t)
            self._harden()

    def _recall(self):
        """Report a second finger that was not found while two fingers touched."""
        s = self.state
        if recalls(s) and self.sink.second(s[FOUND_UM], s[FOUND_SLACK_UM] * _LATER >> 3, s[T_NOW]):
            self.sink.left(True, s[T_NOW])

    def noise_um(self, brightness):
        """Return an upper limit of a position's standard deviation due to ADC noise, in um.

        `brightness` is that of the reading, in Q20 of log2.
        """
        return noise(self.state[NOISE_PRODUCT], brightness)

    def _harden(self):
        s = self.state
        if s[FORCE_NOW_MN] >= s[FIRM_MN] and s[STATE] == DOWN:
            s[FIRM_MN] = NEVER
            self.sink.firm(s[T_NOW])

    def _rests(self):
        s = self.state
        if not (
            s[LOW_UM] <= s[X_NOW_UM] <= s[HIGH_UM] and s[LOW_MN] <= s[FORCE_NOW_MN] <= s[HIGH_MN]
        ):
            self._rest(s[X_NOW_UM])
            return False
        if elapsed(s[STILL], s[T_NOW]) < s[STUCK_T]:
            return False
        s[STILL] = s[T_NOW]
        return True

    def _rest(self, x_um):
        s = self.state
        off_um = self._layout.slide_um >> 1
        force_mN = s[FORCE_NOW_MN]
        s[LOW_UM] = x_um - off_um
        s[HIGH_UM] = x_um + off_um
        s[LOW_MN] = force_mN - (force_mN >> 2)
        s[HIGH_MN] = force_mN + (force_mN >> 2)
        s[STILL] = s[T_NOW]
