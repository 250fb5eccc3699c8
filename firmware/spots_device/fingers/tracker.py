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
UP    DOWN   `detect` readings agree on a position, or on a steady motion, and the last one fits
UP    TWO    this does not happen for 40 ms: fingers touched together at unknown positions
DOWN  DOWN   the position is that of the finger, or the finger slides
DOWN  TWO    otherwise; the first finger gets the position that it had one reading *earlier*
TWO   DOWN   the position stays where the first finger was, or nearer to it than a second finger can
             be: the second finger has left, or the first one rolled or slid
TWO   DOWN   the position stays elsewhere, and the first finger has left: it was lifting, or the
             brightness was never that of two fingers, or no second finger could cause this position
TWO   DOWN   while the first finger lifts, the position approaches the second finger in ever smaller
             steps, or the estimated position of this finger, and less than 2 mm remain
TWO   DOWN   the position stays, although the light changes: only one finger touches
TWO   TWO    the first finger rests, and two readings agree on the position of the second finger
             (second.py); the light of the first finger may be unknown
TWO   TWO    the second finger slides, at least 0.1 s after the start of TWO; the readings show that
             the first finger rests and does not lift
TWO   DOWN   one of two known fingers has left: one reading shows which one
TWO   TWO    two known fingers rest, and two readings agree on the position of a third finger
TWO   TWO    the first finger has left: it began to lift 35 ms ago (25 ms if the position turns
             back), or two readings lie between the second and a third finger
DOWN  UP     no finger touches; also if another one then touches elsewhere within `release_ms`
TWO   UP     no finger touches; the last reading may be the only one of the second finger alone
====  =====  ==================================================================================

A second finger may rest beside the first one without being found. If one of the two then leaves,
the second finger's position is computed from earlier readings. A release is delayed by `release_ms`
(release debounce). The conditions about other fingers are in pair.py and evidence.py.
Integers only; allocates nothing.
"""

from array import array

from .. import const
from ..reading import decode
from . import state as c
from .evidence import (
    has_left,
    recalls,
    slack_um,
    was_second,
)
from .locate import noise
from .pair import watch
from .steady import stays

DOUBTFUL = (
    decode.LED_OFF | decode.MISFIT | decode.NOT_CALIBRATED | decode.SATURATED | decode.TOO_DARK
)
_FITS = decode.FITS_WITH_DRIFT
_BLIND = decode.NOT_CALIBRATED | decode.SATURATED
TICK_US = 1024  # see `state.TICKS`

# Product of the light in counts and the standard deviation of the position in um by ADC noise, at
# the far end of a strip of 85 mm. The product grows with the square of the strip's length.
_NOISE = const(90_000)
_TYPICAL = const(289)  # decay for which `_NOISE` was measured, see `locate.locate`
_SLIDE_LIGHT = const(9000)  # largest change of brightness per tick in a slide, Q20 of log2
_TOGETHER_T = const(39)  # if readings disagree for this time, fingers touched together
_MOVED_UM = const(1500)
# Ratios of light as differences of brightness, Q20 of log2.
_HALF = const(1 << 20)  # 2
# Share of the estimate's uncertainty that must be inside a key, in eighths. `SOON` is about two
# standard deviations; `_LATER` is about one, because the key would be lost otherwise.
_LATER = const(4)


def elapsed(since, now):
    """Return the ticks from the time `since` to the later time `now`, both in ticks.

    The result is correct if the times are less than `TICKS` apart, even if the counter wraps.
    """
    return (now - since) & (c.TICKS - 1)


class ContactTracker:
    """Converts the readings of a strip to touches.

    It calls methods of `sink`; `t` is a time in ticks, `x_um` a position. ``down(x_um, t)``: a
    finger touches. ``at(x_um, t)``: its new position, while it is alone; if the result is true, no
    more positions of this finger are needed. ``firm(t)``: the force has reached ``firm_mN``, once
    for each touch. ``up(t)``: the finger has left. ``next(x_um, t)``: the finger has left, and
    another one touches. ``stuck()``: the touch has not moved for ``stuck_ms``, so it is no finger.

    If the strip length is known, also: ``second(x_um, slack_um, t) -> bool``: a second finger
    touches at `x_um` +- `slack_um`, or a third one if the sink uses a second one; returns whether
    the sink uses it. ``left(second, t)``: the second finger has left if `second` is true, else the
    first one. ``moved(x_um, slack_um)``: a new estimate of the second one, while the first rests.
    """

    def __init__(self, sink):
        self.sink = sink
        self._layout = None
        self.state = s = array("i", bytes(4 * c.SIZE))
        s[c.STATE] = c.SPENT
        s[c.FIRM_MN] = c.NEVER

    @property
    def x_um(self):
        """Position of the first finger in um."""
        return self.state[c.X_UM]

    @property
    def force_mN(self):
        """Force of the last reading that fits one press, in mN."""
        return self.state[c.FORCE_MN]

    @property
    def touched(self):
        """Whether a finger with a known position touches the strip."""
        s = self.state
        return s[c.STATE] == c.DOWN or (s[c.STATE] == c.TWO and s[c.KNOWN])

    @property
    def two(self):
        """Whether more than one finger may touch the strip."""
        return self.state[c.STATE] == c.TWO

    def set_layout(self, layout, length_um=0, decay=0, cross=None):
        """Set the limits and the strip length; a finger that touches is ignored until it lifts.

        Without a length, one finger is expected: a movement up to ``jump_um`` is a slide, and
        readings that do not fit one press are ignored. `decay` is that of `locate.locate`, `cross`
        that of a calibration, or None.
        """
        s = self.state
        s[c.CROSS_NEAR_UM], s[c.CROSS_FAR_UM], s[c.CROSS_B] = (length_um and cross) or (0, 0, 0)
        self._layout = layout
        s[c.RELEASE_MN] = layout.release_mN
        s[c.PRESS_MN] = layout.press_mN
        s[c.STUCK_T] = layout.stuck_t
        s[c.DETECT] = layout.detect
        s[c.JUMP_UM] = layout.jump_um
        s[c.RELEASE_T] = layout.release_t
        s[c.DECAY] = decay
        s[c.LENGTH_UM] = length_um
        # Light decreases along a strip, and a long strip needs a weak dye: the noise grows. The
        # position comes from the decay: half the decay, twice the noise.
        share = min(max(length_um, 0), 600_000) * 3 // 1000
        product = max(share * share * 18 // 13, _NOISE)
        s[c.NOISE_PRODUCT] = max(product, product // max(decay, 72) * _TYPICAL)
        self.spend()

    def spend(self):
        """End the present touch; the finger must be lifted before a new touch can begin."""
        s = self.state
        s[c.STATE] = c.SPENT
        s[c.SEEN] = 0
        s[c.LEAVING] = False

    def take(self, flags, position_um, force_mN, brightness, t):
        """Process a reading: update the state, and call the methods of `sink`.

        `brightness` is in Q20 of log2; `flags` are those of the module `decode`.
        """
        # The call frames of this function and of most that it calls have at most 11 words, see
        # strip.py: the reading is in the state.
        s = self.state
        if flags & decode.LED_OFF or (flags & decode.TOUCHING and not force_mN):
            return  # whether a finger touches is unknown: LED off, or the ambient light has changed
        s[c.X_NOW_UM] = position_um
        s[c.FORCE_NOW_MN] = force_mN
        s[c.B_NOW] = brightness
        s[c.T_NOW] = t
        if s[c.STATE] == c.DOWN:
            if stays(s, flags):
                if not s[c.IGNORED] and self.sink.at(position_um, t):
                    s[c.IGNORED] = True
                return
        elif s[c.STATE] == c.TWO and self._take_two(flags):
            return
        if not flags & decode.TOUCHING or (force_mN < s[c.RELEASE_MN] and not flags & DOUBTFUL):
            if s[c.STATE] != c.UP:
                self._lift(t)
            else:
                s[c.SEEN] = 0
            if force_mN and not flags & decode.MISFIT and s[c.STATE] == c.UP:
                self._approach()
            return
        if s[c.LEAVING]:
            s[c.LEAVING] = False
            if s[c.STATE] == c.TWO or (
                s[c.STATE] == c.DOWN and abs(position_um - s[c.X_UM]) > c.NEAR_UM
            ):
                self._leave(t)  # this touch is another finger
        if flags & _BLIND:
            s[c.SEEN] = 0
            return
        s[c.FITS] = not flags & decode.MISFIT or flags & _FITS == _FITS
        if s[c.FITS]:
            s[c.FORCE_MN] = force_mN
            if s[c.STUCK_T] and s[c.STATE] and self._rests():
                s[c.STATE] = c.SPENT
                self.sink.stuck()
                return
        elif not s[c.LENGTH_UM]:
            return
        if s[c.STATE] == c.DOWN:
            self._follow()
        elif s[c.STATE] == c.UP:
            self._press()
        elif s[c.STATE] == c.TWO:
            self._take_two(flags | c.CHECKED)
        if s[c.STATE] == c.DOWN:
            s[c.DRIFTS] = flags & decode.MISFIT
        s[c.T] = t

    def _lift(self, t):
        s = self.state
        if not s[c.LEAVING]:
            if s[c.STATE] == c.TWO and was_second(s):
                self._pass(s[c.X_SEEN_UM], s[c.B_SEEN])
            s[c.LEAVING] = True
            s[c.LEFT] = s[c.T]
        if elapsed(s[c.LEFT], t) < s[c.RELEASE_T]:
            return
        s[c.LEAVING] = False
        self._leave(t)

    def _leave(self, t):
        # All fingers have left.
        s = self.state
        down, s[c.STATE] = self.touched, c.UP
        s[c.SEEN] = 0
        if down:
            self.sink.up(t)

    # State UP.

    def _approach(self):
        """Record a reading that may be the first reading of a touch."""
        s = self.state
        s[c.BEGAN] = s[c.SINCE] = s[c.T_NOW]
        s[c.X_UM] = s[c.X_SEEN_UM] = s[c.X_NOW_UM]
        s[c.B_SEEN] = s[c.B_NOW]
        s[c.STEP_UM] = 0
        s[c.SEEN] = 1

    def _press(self):
        s = self.state
        if s[c.FORCE_NOW_MN] < s[c.PRESS_MN]:
            s[c.SEEN] = 0
            if s[c.FITS]:
                self._approach()
            return
        x_um = s[c.X_NOW_UM]
        moved_um = x_um - s[c.X_SEEN_UM]
        if not s[c.SEEN]:
            self._approach()
        elif s[c.SEEN] > 0 and abs(moved_um) < (
            slack_um(s, s[c.B_SEEN]) * 5 >> 2 if s[c.LENGTH_UM] else s[c.JUMP_UM]
        ):
            # A reading of one finger or two decides nothing: the next one does.
            if s[c.FITS]:
                s[c.SEEN] += 1
            elif elapsed(s[c.BEGAN], s[c.T_NOW]) >= _TOGETHER_T:
                self._begin_two()
                return
        else:
            steady = s[c.STEP_UM] and abs(moved_um - s[c.STEP_UM]) < slack_um(s, s[c.B_SEEN])
            if s[c.FITS] and steady and abs(moved_um) <= s[c.JUMP_UM]:
                s[c.SEEN] = s[c.DETECT]  # the finger slides already
            else:
                s[c.SEEN] = 1
                s[c.X_UM] = x_um
                if elapsed(s[c.BEGAN], s[c.T_NOW]) >= _TOGETHER_T:
                    self._begin_two()
                    return
        # Three readings show whether a motion is steady.
        s[c.STEP_UM] = moved_um if s[c.SEEN] == 1 and elapsed(s[c.BEGAN], s[c.T_NOW]) else 0
        if not s[c.FITS]:
            s[c.STEP_UM] = 0
        s[c.X_SEEN_UM] = x_um
        s[c.B_SEEN] = s[c.B_NOW]
        if s[c.SEEN] >= s[c.DETECT]:
            self._begin(x_um, s[c.B_NOW])
            s[c.B_BEFORE] = 0
            self.sink.down(x_um, s[c.T_NOW])
            self._harden()

    def _begin_two(self):
        s = self.state
        s[c.KNOWN] = s[c.IS_EVEN] = False
        self._enter_two()

    # State DOWN.

    def _begin(self, x_um, brightness):
        s = self.state
        s[c.STATE] = c.DOWN
        s[c.SEEN] = 0
        s[c.LOOSE] = False
        s[c.IGNORED] = False
        s[c.X_UM] = s[c.X_BEFORE_UM] = x_um
        s[c.B] = s[c.B_BEFORE] = brightness
        s[c.B_OLDEST] = 0
        s[c.X_SEEN_UM] = x_um
        s[c.FIRM_MN] = self._layout.firm_mN
        self._stay(x_um)

    def _follow(self):
        s = self.state
        x_um = s[c.X_NOW_UM]
        off_um = x_um - s[c.X_UM]
        if s[c.FITS] and -c.SAME_UM < off_um < c.SAME_UM:
            off_um >>= 1
            s[c.LOOSE] = False
        elif s[c.FITS] and s[c.LOOSE] and -c.NEAR_UM < off_um < c.NEAR_UM:
            pass
        elif self._is_next(off_um):
            self._take_two(c.CHECKED)
            return
        s[c.X_BEFORE_UM] = s[c.X_UM]
        s[c.X_UM] += off_um
        s[c.X_SEEN_UM] = x_um
        s[c.B_OLDEST] = s[c.B_BEFORE]
        s[c.B_BEFORE] = s[c.B]
        s[c.B] = s[c.B_NOW]
        self.sink.at(x_um, s[c.T_NOW])
        if s[c.FORCE_NOW_MN] >= s[c.FIRM_MN]:
            self._harden()

    def _is_next(self, off_um):
        """Return whether a reading at a new position may be of two fingers; if so, enter state TWO.

        `off_um` is the distance of the reading from the finger, in um.
        """
        s = self.state
        if s[c.FITS]:
            if abs(off_um) < 4 * noise(s[c.NOISE_PRODUCT], s[c.B_NOW]):
                return False
            if abs(s[c.X_NOW_UM] - s[c.X_SEEN_UM]) <= s[c.JUMP_UM] and (
                not s[c.LENGTH_UM]
                or abs(s[c.B_NOW] - s[c.B])
                <= _SLIDE_LIGHT * min((s[c.T_NOW] - s[c.T]) & (c.TICKS - 1), _TOGETHER_T)
            ):
                return False
        self._overlap()
        return True

    def _overlap(self):
        # Another finger may have touched at the present reading: enter state TWO.
        self._enter_two()
        s = self.state
        before = s[c.B_BEFORE]
        risen = s[c.B] - before
        drift = abs(before - s[c.B_OLDEST])
        if not before:
            drift = c.EVEN
        s[c.IS_EVEN] = risen > -c.EVEN and (risen < c.EVEN or drift < c.EVEN)
        s[c.RISES] = risen >= c.EVEN and drift >= c.EVEN
        s[c.FALLS] = risen <= -c.EVEN
        s[c.FELL] = s[c.T_NOW]
        if s[c.LEAST] > s[c.B]:
            s[c.LEAST] = s[c.B]
        s[c.KNOWN] = True
        s[c.X_UM] = s[c.X_BEFORE_UM]
        if not s[c.RISES]:
            s[c.B] = before
        s[c.SEEN] = -1

    # State TWO.

    def _enter_two(self):
        s = self.state
        s[c.STATE] = c.TWO
        s[c.BEGAN] = s[c.T_NOW]
        s[c.ODD] = s[c.SECOND] = False
        s[c.WAS_STILL] = s[c.GUESSED] = s[c.PAIR] = False
        s[c.B_BOTH] = 0
        s[c.HINT_UM] = -c.NEVER
        s[c.PEAK] = s[c.LEAST] = s[c.B_NOW]
        s[c.X_PEAK_UM] = s[c.X_NOW_UM]

    def _take_two(self, flags):
        """Process a reading in the state TWO; return False if `take` must check it first."""
        s = self.state
        s[c.FLAGS_NOW] = flags
        what = watch(s, s[c.B_NOW])
        if what <= 0:
            return not what
        if what == c.MOVED:
            self.sink.moved(s[c.FOUND_UM], s[c.FOUND_SLACK_UM])
            return True
        t = s[c.T_NOW]
        if what == c.PASSED:
            self._pass(s[c.X_LAST_UM], s[c.B_LAST])
            self._enter_two()
            s[c.IS_EVEN] = s[c.RISES] = s[c.FALLS] = False
            s[c.PAIR] = s[c.LOOSE] = True
            return True
        s[c.X_NOW_UM] -= s[c.CROSS_UM]  # only one finger remains
        if what < c.MOVED:
            if what & c.FOUND:
                self._add(s[c.SLACK_GUESS_UM] * c.SOON >> 3)
            if what & c.REMAINS:
                self._remain(what)
        elif what == c.LIFTED:
            b = s[c.B_SECOND]
            s[c.SECOND] = False
            self._begin(s[c.X_NOW_UM], s[c.B_NOW])
            s[c.B_BEFORE] = b
            s[c.LOOSE] = True
            self.sink.left(False, t)
            self.sink.at(s[c.X_NOW_UM], t)
        elif what & 0xFF == c.SAME:
            self.sink.second(s[c.X_GUESS_UM], what >> 8, t)
            self.sink.moved(s[c.X_SECOND_UM], what >> 8)
        else:
            self._fade(what >> 8)
        if s[c.STATE] == c.DOWN:
            s[c.DRIFTS] = flags & decode.MISFIT
        s[c.T] = t
        return True

    def _pass(self, x_um, brightness):
        # The first finger had left in an earlier reading, which was of the second one alone.
        self._begin(x_um, brightness)
        self.sink.next(x_um, self.state[c.T_NOW])

    def _add(self, slack_um):
        # Report the finger that was estimated last; it becomes the second one.
        s = self.state
        s[c.SECOND] = self.sink.second(s[c.X_GUESS_UM], slack_um, s[c.T_NOW])
        s[c.X_SECOND_UM] = s[c.X_GUESS_UM]
        s[c.B_SECOND] = s[c.B_GUESS]

    def _fade(self, slack_um):
        # The first finger has left. With `slack_um`, there is an estimate of a third one.
        s = self.state
        s[c.X_UM] = s[c.X_BEFORE_UM] = s[c.X_SECOND_UM]
        s[c.B] = s[c.B_SECOND]
        s[c.SECOND] = False
        self._enter_two()
        s[c.IS_EVEN] = s[c.PAIR] = True
        s[c.FALLS] = False
        s[c.LOOSE] = True
        self.sink.left(False, s[c.T_NOW])
        if slack_um and s[c.B_GUESS] > s[c.B] - _HALF:
            self._add(slack_um)

    def _remain(self, how):
        # Only one finger seems to touch. `how`: the result of `pair.watch`.
        s = self.state
        x_um = s[c.X_NOW_UM]
        t = s[c.T_NOW]
        if not s[c.KNOWN]:
            # If light was lost and the position moved, one of two fingers has left. Or there was
            # only one finger, perhaps with ambient light that is now off.
            if (
                how & c.SINGLE
                or (
                    s[c.B_NOW] < s[c.PEAK] - c.LOST
                    and abs(x_um - s[c.X_PEAK_UM]) > _MOVED_UM
                    and abs(s[c.B_NOW] - s[c.B_SINCE]) < c.CHANGED
                )
                or (s[c.ODD] and elapsed(s[c.SINCE], t) >= _TOGETHER_T)
            ):
                self._begin(x_um, s[c.B_NOW])
                s[c.B_BEFORE] = 0
                self.sink.down(x_um, t)
                self._recall()
                self._harden()
            return
        off_um = x_um - s[c.X_UM]
        # Two fingers are at least `APART_UM` apart. So a nearer position is that of the first
        # finger, which rolled, or slid while it lifted. If a second finger is known, it may also
        # be the position of both. The first reading of a soft touch is noisier than this one.
        back_um = c.NEAR_UM if s[c.SECOND] else c.APART_UM
        if abs(off_um) < back_um + 2 * noise(s[c.NOISE_PRODUCT], min(s[c.B_NOW], s[c.B])):
            firm_mN = s[c.FIRM_MN]
            if not s[c.SECOND]:
                self._recall()
            self._begin(x_um, s[c.B_NOW])
            s[c.FIRM_MN] = firm_mN
            if s[c.SECOND]:
                s[c.SECOND] = False
                self.sink.left(True, t)
            self.sink.at(x_um, t)
        elif how & c.SINGLE or has_left(s, off_um):
            stays = s[c.SECOND] and abs(x_um - s[c.X_SECOND_UM]) < c.APART_UM
            if not stays:
                if s[c.SECOND]:
                    self.sink.left(True, t)
                if not how & c.ENDS:
                    self._recall()
            s[c.SECOND] = False
            self._begin(x_um, s[c.B_NOW])
            if stays:
                self.sink.left(False, t)
            else:
                s[c.B_BEFORE] = 0
                s[c.LOOSE] = 1 if how & c.ENDS else 0
                self.sink.next(x_um, t)
            self._harden()

    def _recall(self):
        """Report a second finger that was not found while two fingers touched."""
        s = self.state
        if recalls(s) and self.sink.second(
            s[c.FOUND_UM], s[c.FOUND_SLACK_UM] * _LATER >> 3, s[c.T_NOW]
        ):
            self.sink.left(True, s[c.T_NOW])

    def noise_um(self, brightness):
        """Return an upper limit of a position's standard deviation due to ADC noise, in um.

        `brightness` is that of the reading, in Q20 of log2.
        """
        return noise(self.state[c.NOISE_PRODUCT], brightness)

    def _harden(self):
        s = self.state
        if s[c.FORCE_NOW_MN] >= s[c.FIRM_MN] and s[c.STATE] == c.DOWN:
            s[c.FIRM_MN] = c.NEVER
            self.sink.firm(s[c.T_NOW])

    def _rests(self):
        s = self.state
        if not (
            s[c.LOW_UM] <= s[c.X_NOW_UM] <= s[c.HIGH_UM]
            and s[c.LOW_MN] <= s[c.FORCE_NOW_MN] <= s[c.HIGH_MN]
        ):
            self._stay(s[c.X_NOW_UM])
            return False
        if elapsed(s[c.STILL], s[c.T_NOW]) < s[c.STUCK_T]:
            return False
        s[c.STILL] = s[c.T_NOW]
        return True

    def _stay(self, x_um):
        s = self.state
        off_um = self._layout.slide_um >> 1
        force_mN = s[c.FORCE_NOW_MN]
        s[c.LOW_UM] = x_um - off_um
        s[c.HIGH_UM] = x_um + off_um
        s[c.LOW_MN] = force_mN - (force_mN >> 2)
        s[c.HIGH_MN] = force_mN + (force_mN >> 2)
        s[c.STILL] = s[c.T_NOW]
