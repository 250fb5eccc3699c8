"""Converts readings to touches: press, movement, firm press and release, debounced.

One reading of six channels cannot distinguish two fingers from one finger between them. A sequence
of readings can, because nearly every finger is alone on the strip for some readings. While there
may be several fingers, the position of a reading is not used. State machine, with the states UP (no
finger), DOWN (one finger) and TWO (perhaps several fingers); `detect` is a limit of the layout:

====  =====  ==================================================================================
from  to     when
====  =====  ==================================================================================
UP    DOWN   `detect` consecutive readings agree on a position, or on a steady motion
UP    TWO    readings disagree for 40 ms: fingers touched together at unknown positions
DOWN  DOWN   the position is that of the finger, or the finger slides
DOWN  TWO    otherwise; the first finger keeps its position of one reading *earlier*
TWO   DOWN   the position rests where the first finger was: the second finger has left
TWO   DOWN   the position rests elsewhere, and the first finger has left: it was lifting, or the
             brightness was never that of two fingers, or no second finger could cause this position
TWO   DOWN   the first finger lifts, and the position has almost reached the second finger, which
             it approaches in ever smaller steps, or which was estimated there before
TWO   DOWN   the first finger was lifting, the last step was small, and another finger arrives; or
TWO   UP     no finger touches any more: the position was almost that of the second finger
TWO   DOWN   the brightness changes, but not the position: only one finger touches
TWO   TWO    the first finger rests, and readings agree on the position of the second finger
             (second.py), even if the light of the first finger is unknown
TWO   TWO    the second finger slides, at least 0.1 s after this state began: the first finger
             rests, and if it lifted, the readings would be different
TWO   DOWN   one of two known fingers has left: one reading shows which
TWO   TWO    two known fingers rest, and readings agree on the position of a third finger
TWO   TWO    the first finger began to lift `_FALL_T` ago: the second finger is now the first
TWO   UP     no finger touches
====  =====  ==================================================================================

When one finger is alone again, and a second finger had rested beside it but was not found, the
position of the second finger is estimated from the last readings of both fingers. A release is
delayed by `release_ms` (release debounce). The conditions about other fingers are in evidence.py.
Integers only; allocates nothing.
"""

try:
    from micropython import const
except ImportError:
    const = int  # on the host


from array import array

from .decode import LED_OFF, MISFIT, NOT_CALIBRATED, SATURATED, TOO_DARK, TOUCHING
from .evidence import (
    find_third,
    guess,
    guess_both,
    has_almost_left,
    has_left,
    recalls,
    slides,
    solve,
)
from .second import noise

DOUBTFUL = LED_OFF | MISFIT | NOT_CALIBRATED | SATURATED | TOO_DARK
# Flags of an untrusted reading whose spectrum fits one press well enough for a key: the strip has
# drifted, or there are two fingers.
TWO_FIT = MISFIT | TOO_DARK
_BLIND = NOT_CALIBRATED | SATURATED
# Time is in ticks of 1.024 ms: the board's microseconds without their lower ten bits. Both wrap at
# the same moment.
TICK_US = 1024
TICKS = 1 << 22

_UP = const(0)
_DOWN = const(1)
_SPENT = const(2)  # the finger or object must be lifted before the next touch
_TWO = const(3)

# Product of the light in counts and the standard deviation of the position in um by ADC noise, at
# the far end of a strip of 85 mm. The product grows with the square of the strip's length.
_NOISE = const(90_000)
_TYPICAL = const(289)  # decay for which `_NOISE` was measured, see `second.locate`
_REST_UM = const(250)  # largest difference between two readings of a resting position
_SAME_UM = const(450)  # largest distance of a reading from the mean position of its finger
_BACK_UM = const(900)  # largest distance from the first finger after the second one has left
_SLIDE_LIGHT = const(9000)  # largest change of brightness per tick in a slide, Q20 of log2
_TOGETHER_T = const(39)  # if readings disagree for this time, fingers touched together
_REST_T = const(12)  # least duration of a resting position
_MOVED_UM = const(1500)
# Ratios of light as differences of brightness, Q20 of log2.
_FALLEN = const(772_000)  # 0.6
_LOST = const(337_000)  # 0.8
_MORE = const(171_000)  # 1.12
_EVEN = const(74_000)  # 1.05
# Limits for the detection of a second finger beside the first one.
_NEAR_UM = const(2000)
_APART_UM = const(4500)  # least distance between two fingers
_RISEN = const(30_000)  # 1.02: a finger arrives
_CALM = const(40_000)  # 1.03: the light of a finger at rest
# Share of the estimate's uncertainty that must be inside a key, in eighths; `_SOON`: about two
# standard deviations; `_LATER`: about one, because the key would be lost otherwise.
_SOON = const(5)
_LATER = const(4)
_NEVER = const(1 << 29)
_FALL_T = const(34)  # longest time in which a finger lifts
_LIFTS_T = const(9)  # least time of a lift before its end is predicted
_REMAINS_UM = const(2000)  # largest distance to the second finger at this end
_FAST_UM = const(20_000)
_CHANGED = const(150_000)  # 1.1
# Limits for the detection of a third finger.
_GROWN = const(116_000)  # 1.08
_BOTH = const(397_000)  # 1.3
_HALF = const(1 << 20)  # 2

# State of a tracker: indices in one array, because MicroPython is slow at objects with many
# attributes. The first three elements are the output of `locate` and `weigh`. Positions are in um,
# brightness (`B` in names) in Q20 of log2, times (`T` in names) in ticks; flags are 0 or 1.
_FOUND_UM = const(0)
_FOUND_SLACK_UM = const(1)
_FOUND_B = const(2)
_STATE = const(3)
_X_UM = const(4)  # position of the first finger
_FORCE_MN = const(5)  # force of the last reading that fits one press
_KNOWN = const(6)  # in TWO: whether the position of the first finger is known
_SEEN = const(7)  # consecutive readings that agree; -1 if the last one does not fit one press
_X_BEFORE_UM = const(8)  # position of the first finger, one reading earlier
_X_SEEN_UM = const(9)  # position and brightness of the last reading
_B_SEEN = const(10)
_STEP_UM = const(11)  # motion between the last two readings; in TWO: away from the first finger
_B = const(12)  # brightness of the first finger in the last three readings of it alone
_B_BEFORE = const(13)
_B_OLDEST = const(14)
_SINCE = const(15)  # time and brightness of the first reading at the present position
_B_SINCE = const(16)
_T = const(17)  # time of the last reading
_BEGAN = const(18)  # start of the present state
_IS_EVEN = const(19)  # the force of the first finger is steady
_IS_CALM = const(20)  # the force of the first finger is steady within a lower limit
_RISES = const(21)  # the force of the first finger rises
_FALLS = const(22)  # whether the first finger lifts, and since when
_FELL = const(23)
_SECOND = const(24)  # whether a second finger is known; position and brightness of it
_X_SECOND_UM = const(25)
_B_SECOND = const(26)
_THIRD = const(27)  # there may be a third finger
_PAIR = const(28)  # whether there was a reading in the state TWO
_LOOSE = const(29)  # the position of the first finger is an estimate
_PEAK = const(30)  # in TWO: largest brightness and its position; least brightness since, and of all
_X_PEAK_UM = const(31)
_LOW = const(32)
_LEAST = const(33)
_RESTED = const(34)  # whether the last reading was at the same position; whether it fits one press
_FIT_SEEN = const(35)
_X_BOTH_UM = const(36)  # last reading of two fingers that rest: position, brightness, fit
_B_BOTH = const(37)
_FIT_BOTH = const(38)
_GUESSED = const(39)  # whether there is an estimate of another finger, and since when
_GUESSED_T = const(40)
_X_GUESS_UM = const(41)  # this estimate: position, brightness and uncertainty of the other finger
_B_GUESS = const(42)
_SLACK_GUESS_UM = const(43)
_DRIFTS = const(44)  # the finger alone did not fit one press: then the fit is no evidence
_LEAVING = const(45)  # whether no finger touches, and since when
_LEFT = const(46)
_HAS_DIPPED = const(47)  # the light was lost for a moment
_X_PAIR_UM = const(48)  # last reading of two known fingers that rest: position, brightness
_B_PAIR = const(49)
_HINT_UM = const(50)  # in TWO: unconfirmed estimate of the second finger nearest to the first one
# MicroPython encodes an index from -16 to 47 in one byte.
_ODD = const(-16)  # a reading did not fit one press
_STILL = const(-15)  # since when a touch rests; limits of position and force in which it rests
_LOW_UM = const(-14)
_HIGH_UM = const(-13)
_LOW_MN = const(-12)
_HIGH_MN = const(-11)
_FIRM_MN = const(-10)  # force of a firm press, until the firm press is reported
_LENGTH_UM = const(-9)  # length of the strip, see `set_layout` and `_NOISE`
_DECAY = const(-8)
_NOISE_PRODUCT = const(-7)
_RELEASE_MN = const(-6)  # from here on: limits of the layout
_PRESS_MN = const(-5)
_STUCK_T = const(-4)
_DETECT = const(-3)
_JUMP_UM = const(-2)
_RELEASE_T = const(-1)
_SIZE = const(67)


def elapsed(since, now):
    """Return the ticks from the time `since` to the later time `now`, both in ticks.

    The result is correct if the counter has wrapped once in between.
    """
    return (now - since) & (TICKS - 1)


class ContactTracker:
    """Converts the readings of a strip to touches.

    Parameters
    ----------
    sink : object
        Receiver with these methods; `t` is the time in ticks of `TICK_US`, `x_um` a position in um:
        ``down(x_um, t)``: a finger touches. ``at(x_um, t)``: new position of this finger, while it
        is alone. ``firm(t)``: the force has reached ``firm_mN``; called once for each touch.
        ``up(t)``: the finger has left. ``next(x_um, t)``: the finger has left, and another one
        touches. ``stuck()``: the touch has not moved for ``stuck_ms``, so it is not a finger. If
        the strip length is known, also these methods: ``second(x_um, slack_um, t) -> bool``: a
        second finger touches, at `x_um` +- `slack_um`. Returns whether the sink uses this finger.
        If the sink already uses a second finger, this is a third finger. ``left(second, t)``: the
        second finger has left if `second` is true, else the first one. ``moved(x_um, slack_um)``:
        new estimate of the second finger, while the first one rests.
    """

    def __init__(self, sink):
        self.sink = sink
        self._layout = None
        self._s = s = array("i", bytes(4 * _SIZE))
        s[_STATE] = _SPENT
        s[_FIRM_MN] = _NEVER

    @property
    def x_um(self):
        """Position of the first finger in um."""
        return self._s[_X_UM]

    @property
    def force_mN(self):
        """Force of the last reading that fits one press, in mN."""
        return self._s[_FORCE_MN]

    @property
    def touched(self):
        """Whether a finger with a known position touches the strip."""
        s = self._s
        return s[_STATE] == _DOWN or (s[_STATE] == _TWO and s[_KNOWN])

    @property
    def two(self):
        """Whether more than one finger may touch the strip."""
        return self._s[_STATE] == _TWO

    def set_layout(self, layout, length_um=0, decay=0):
        """Set the limits and the strip length; a present touch is ignored until it is lifted.

        Parameters
        ----------
        layout : layout.Layout
            Layout whose limits are used, see `layout.LIMITS`.
        length_um : int
            Length of the strip in um. With 0, one finger is expected: each movement is a slide,
            and readings that do not fit one press are ignored.
        decay : int
            Decay of the light by the dye, see `second.locate`.
        """
        s = self._s
        self._layout = layout
        s[_RELEASE_MN] = layout.release_mN
        s[_PRESS_MN] = layout.press_mN
        s[_STUCK_T] = layout.stuck_t
        s[_DETECT] = layout.detect
        s[_JUMP_UM] = layout.jump_um
        s[_RELEASE_T] = layout.release_t
        s[_DECAY] = decay
        s[_LENGTH_UM] = length_um
        # Light decreases along a strip, and a long strip needs a weak dye: the noise grows. The
        # position comes from the decay: half the decay, twice the noise.
        share = min(max(length_um, 0), 600_000) * 3 // 1000
        product = max(share * share * 18 // 13, _NOISE)
        s[_NOISE_PRODUCT] = max(product, product // max(decay, 72) * _TYPICAL)
        self.spend()

    def spend(self):
        """End the present touch; the finger must be lifted before a new touch can begin."""
        s = self._s
        s[_STATE] = _SPENT
        s[_SEEN] = 0
        s[_LEAVING] = False

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
        s = self._s
        if flags & LED_OFF:
            return  # with the LED off, a touch cannot be detected
        if not flags & TOUCHING or (force_mN < s[_RELEASE_MN] and not flags & DOUBTFUL):
            if s[_STATE] != _UP:
                self._lift(t)
            else:
                s[_SEEN] = 0
            if force_mN and not flags & MISFIT and s[_STATE] == _UP:
                self._approach(position_um, brightness, t)
            return
        if s[_LEAVING]:
            s[_LEAVING] = False
            s[_HAS_DIPPED] = True
        if flags & _BLIND:
            s[_SEEN] = 0
            return
        fits = not flags & MISFIT or flags & TWO_FIT == TWO_FIT
        if not fits and not s[_LENGTH_UM]:
            return
        state = s[_STATE]
        if fits:
            s[_FORCE_MN] = force_mN
            if s[_STUCK_T] and state and self._rests(position_um, force_mN, t):
                s[_STATE] = _SPENT
                self.sink.stuck()
                return
        if state == _DOWN:
            self._follow(fits, position_um, force_mN, brightness, t)
        elif state == _UP:
            self._press(fits, position_um, force_mN, brightness, t)
        elif state == _TWO:
            self._part(fits, position_um, force_mN, brightness, t)
        if s[_STATE] == _DOWN:
            s[_DRIFTS] = flags & MISFIT
        s[_T] = t

    def _lift(self, t):
        s = self._s
        if not s[_LEAVING]:
            s[_LEAVING] = True
            s[_LEFT] = s[_T]
        if elapsed(s[_LEFT], t) < s[_RELEASE_T]:
            return
        s[_LEAVING] = False
        if s[_STATE] == _TWO and has_almost_left(s):
            self.sink.next(s[_X_SEEN_UM], t)
        down, s[_STATE] = self.touched, _UP
        s[_SEEN] = 0
        if down:
            self.sink.up(t)

    # State UP.

    def _approach(self, x_um, brightness, t):
        """Record a reading that may be the first reading of a touch; arguments as in `_is_next`."""
        s = self._s
        s[_BEGAN] = s[_SINCE] = t
        s[_X_UM] = s[_X_SEEN_UM] = x_um
        s[_B_SEEN] = brightness
        s[_STEP_UM] = 0
        s[_SEEN] = 1

    def _press(self, fits, x_um, force_mN, brightness, t):
        s = self._s
        if force_mN < s[_PRESS_MN]:
            s[_SEEN] = 0
            if fits:
                self._approach(x_um, brightness, t)
            return
        moved_um = x_um - s[_X_SEEN_UM]
        if not s[_SEEN]:
            self._approach(x_um, brightness, t)
        elif (
            fits
            and s[_SEEN] > 0
            and abs(moved_um)
            < (self._slack_um(brightness) * 5 >> 2 if s[_LENGTH_UM] else s[_JUMP_UM])
        ):
            s[_SEEN] += 1
        else:
            steady = s[_STEP_UM] and abs(moved_um - s[_STEP_UM]) < self._slack_um(brightness)
            if fits and steady and abs(moved_um) <= s[_JUMP_UM]:
                s[_SEEN] = s[_DETECT]  # the finger slides already
            else:
                s[_SEEN] = 1
                s[_X_UM] = x_um
                if elapsed(s[_BEGAN], t) >= _TOGETHER_T:
                    s[_KNOWN] = s[_IS_EVEN] = False
                    self._mix(x_um, brightness, t)
                    return
        # Three readings show whether a motion is steady.
        s[_STEP_UM] = moved_um if s[_SEEN] == 1 and elapsed(s[_BEGAN], t) else 0
        if not fits:
            s[_STEP_UM] = 0
            s[_SEEN] = -1
        s[_X_SEEN_UM] = x_um
        s[_B_SEEN] = brightness
        if s[_SEEN] >= s[_DETECT]:
            self._begin(x_um, force_mN, brightness, t)
            s[_B_BEFORE] = 0
            self.sink.down(x_um, t)
            self._harden(force_mN, t)

    # State DOWN.

    def _begin(self, x_um, force_mN, brightness, t):
        s = self._s
        s[_STATE] = _DOWN
        s[_SEEN] = 0
        s[_LOOSE] = False
        s[_HAS_DIPPED] = False
        s[_X_UM] = s[_X_BEFORE_UM] = x_um
        s[_B] = s[_B_BEFORE] = brightness
        s[_B_OLDEST] = 0
        s[_X_SEEN_UM] = x_um
        s[_FIRM_MN] = self._layout.firm_mN
        self._rest(x_um, force_mN, t)

    def _follow(self, fits, x_um, force_mN, brightness, t):
        s = self._s
        off_um = x_um - s[_X_UM]
        if fits and -_SAME_UM < off_um < _SAME_UM:
            off_um >>= 1
            s[_LOOSE] = False
        elif fits and s[_LOOSE] and -_NEAR_UM < off_um < _NEAR_UM:
            pass
        elif self._is_next(fits, off_um, x_um, brightness, t):
            self._part(fits, x_um, force_mN, brightness, t)
            return
        s[_X_BEFORE_UM] = s[_X_UM]
        s[_X_UM] += off_um
        s[_X_SEEN_UM] = x_um
        s[_B_OLDEST] = s[_B_BEFORE]
        s[_B_BEFORE] = s[_B]
        s[_B] = brightness
        s[_HAS_DIPPED] = False
        self.sink.at(x_um, t)
        if force_mN >= s[_FIRM_MN]:
            self._harden(force_mN, t)

    def _is_next(self, fits, off_um, x_um, brightness, t):
        """Return whether a reading at a new position may be of two fingers; if so, enter state TWO.

        Parameters
        ----------
        fits : bool
            Whether the spectrum of the reading fits one press.
        off_um : int
            Distance of the reading from the finger, in um.
        x_um, brightness, t : int
            Position in um, brightness in Q20 of log2, and time in ticks.
        """
        s = self._s
        if fits and not s[_HAS_DIPPED]:
            if abs(off_um) < 4 * self.noise_um(brightness):
                return False
            ticks = min(elapsed(s[_T], t), _TOGETHER_T)
            if abs(x_um - s[_X_SEEN_UM]) <= s[_JUMP_UM] and (
                not s[_LENGTH_UM] or abs(brightness - s[_B]) <= _SLIDE_LIGHT * ticks
            ):
                return False
        before = s[_B_BEFORE]
        risen = s[_B] - before
        last = min(s[_B], brightness)
        steady = before and abs(before - s[_B_OLDEST]) < _EVEN
        s[_IS_CALM] = abs(risen) < _CALM and abs(before - s[_B_OLDEST]) < _CALM
        s[_IS_EVEN] = risen > -_EVEN and (risen < _EVEN or steady)
        s[_RISES] = risen >= _EVEN and not steady
        s[_FALLS] = risen <= -_EVEN
        s[_FELL] = t
        if last < max(s[_B], before, s[_B_OLDEST]) - _FALLEN:
            s[_HAS_DIPPED] = True
        s[_KNOWN] = True
        s[_X_UM] = s[_X_BEFORE_UM]
        if not s[_RISES]:
            s[_B] = before
        self._mix(x_um, brightness, t)
        s[_LEAST] = last
        s[_SEEN] = -1
        return True

    # State TWO.

    def _mix(self, x_um, brightness, t):
        s = self._s
        s[_STATE] = _TWO
        s[_BEGAN] = t
        s[_ODD] = s[_SECOND] = s[_THIRD] = False
        s[_RESTED] = s[_GUESSED] = s[_PAIR] = False
        s[_B_BOTH] = 0
        s[_HINT_UM] = -_NEVER
        s[_PEAK] = s[_LEAST] = s[_LOW] = brightness
        s[_X_PEAK_UM] = x_um

    def _part(self, fits, x_um, force_mN, brightness, t):
        s = self._s
        # While the first finger lifts, the light is lost. More light: another finger arrives.
        if (
            brightness > s[_B_SEEN] + _RISEN
            and elapsed(s[_FELL], s[_T]) >= _LIFTS_T
            and has_almost_left(s)
        ):
            self._begin(s[_X_SEEN_UM], force_mN, s[_B_SEEN], t)
            s[_LOOSE] = True
            self.sink.next(s[_X_UM], t)
            self._follow(fits, x_um, force_mN, brightness, t)
            return
        # The light of two fingers was lost and grows again: a third finger.
        if (
            s[_LOW] < s[_PEAK] - _LOST
            and brightness > s[_LOW] + _GROWN
            and s[_PEAK] > s[_B] + _BOTH
        ):
            s[_THIRD] = True
        if brightness >= s[_PEAK]:
            s[_PEAK] = s[_LOW] = brightness
            s[_X_PEAK_UM] = x_um
        if brightness < s[_LOW]:
            s[_LOW] = brightness
        if brightness < s[_LEAST]:
            s[_LEAST] = brightness
        seen = s[_SEEN]
        x_last_um = s[_X_SEEN_UM]
        b_last = s[_B_SEEN]
        steady = abs(x_um - x_last_um) < self._slack_um(brightness)
        if brightness > s[_B_SEEN] + _RISEN:
            s[_B_BOTH] = 0
        elif not steady and s[_RESTED]:
            s[_X_BOTH_UM] = s[_X_SEEN_UM]
            s[_B_BOTH] = s[_B_SEEN]
            s[_FIT_BOTH] = s[_FIT_SEEN]
        s[_RESTED] = steady
        s[_FIT_SEEN] = fits
        if seen >= 0 and fits and steady:
            s[_SEEN] = min(seen + 1, 99)
        else:
            s[_SEEN] = 0
            s[_SINCE] = t
            s[_B_SINCE] = brightness
            if not fits:
                s[_SEEN] = -1
                s[_ODD] = True
        s[_X_SEEN_UM] = x_um
        s[_B_SEEN] = brightness
        off_um = abs(x_um - s[_X_UM])
        away_um = off_um - abs(x_last_um - s[_X_UM])
        known = fits and s[_KNOWN] and s[_PAIR] and not s[_SECOND]
        # With two fingers, this change of light would move the position.
        change = abs(brightness - b_last)
        single = (
            known
            and change > _CHANGED
            and abs(x_um - x_last_um) < max(_REST_UM, (change >> 12) * min(off_um, 100_000) >> 12)
        )
        # While the first finger lifts, the position approaches the second finger, in ever smaller
        # steps. The remaining distance is about the square of a step divided by the step before.
        # Or the second finger was estimated here before.
        ends = known and (
            (
                s[_FALLS]
                and not s[_THIRD]
                and elapsed(s[_FELL], t) >= _LIFTS_T
                and brightness > b_last - _LOST
                and 0 < away_um < _FAST_UM
                and away_um * away_um < s[_STEP_UM] * _REMAINS_UM
            )
            or (abs(x_um - s[_HINT_UM]) < _NEAR_UM and brightness < s[_PEAK] - _EVEN)
        )
        s[_STEP_UM] = away_um
        if brightness < s[_PEAK] - _EVEN and not (
            s[_SECOND]
            and not s[_FALLS]
            and brightness > b_last - _EVEN
            and slides(s, fits, x_um, brightness)
        ):
            s[_IS_EVEN] = s[_RISES] = False  # the first finger may be leaving
            if s[_KNOWN] and not s[_FALLS] and brightness < b_last - _CALM and away_um > _REST_UM:
                s[_FALLS] = True
                s[_FELL] = t
        if not s[_SECOND]:
            s[_X_PAIR_UM] = x_um
            s[_B_PAIR] = brightness
        elif self._resolve(fits, x_um, force_mN, brightness, t):
            return
        if not (s[_SECOND] or s[_THIRD] or s[_HAS_DIPPED]):
            if s[_IS_EVEN]:
                found = guess(s, fits, x_um, brightness, t)
            else:
                found = (
                    s[_RISES]
                    and s[_PAIR]
                    and guess_both(s, fits, x_last_um, b_last, x_um, brightness)
                )
            if found:
                s[_SECOND] = self.sink.second(s[_X_GUESS_UM], s[_SLACK_GUESS_UM] * _SOON >> 3, t)
                s[_X_SECOND_UM] = s[_X_GUESS_UM]
                s[_B_SECOND] = s[_B_GUESS]
            # When the first finger begins to lift, estimates move away from it.
            if s[_GUESSED] and abs(s[_X_GUESS_UM] - s[_X_UM]) < abs(s[_HINT_UM] - s[_X_UM]):
                s[_HINT_UM] = s[_X_GUESS_UM]
        s[_PAIR] = True
        seen = s[_SEEN]
        if not (single or ends) and (
            seen < 1 or elapsed(s[_SINCE], t) * (seen + 1) < _REST_T * seen
        ):
            return
        if not s[_KNOWN]:
            # If light was lost and the position moved, one of two fingers has left. Or there was
            # only one finger, and ambient light that is now off.
            if (brightness < s[_PEAK] - _LOST and abs(x_um - s[_X_PEAK_UM]) > _MOVED_UM) or (
                s[_ODD] and elapsed(s[_SINCE], t) >= _TOGETHER_T
            ):
                self._begin(x_um, force_mN, brightness, t)
                s[_B_BEFORE] = 0
                self.sink.down(x_um, t)
                self._recall(x_um, brightness, t)
                self._harden(force_mN, t)
            return
        off_um = x_um - s[_X_UM]
        back_um = _APART_UM if s[_LOOSE] else _BACK_UM
        # The first reading of a soft touch is noisier than the present one.
        if abs(off_um) < max(back_um, 4 * self.noise_um(min(brightness, s[_B]))):
            firm_mN = s[_FIRM_MN]
            if not s[_SECOND]:
                self._recall(x_um, brightness, t)
            self._begin(x_um, force_mN, brightness, t)
            s[_FIRM_MN] = firm_mN
            if s[_SECOND]:
                s[_SECOND] = False
                self.sink.left(True, t)
            self.sink.at(x_um, t)
        elif single or has_left(s, off_um, brightness):
            stays = s[_SECOND] and not s[_HAS_DIPPED] and abs(x_um - s[_X_SECOND_UM]) < _APART_UM
            if not stays:
                if s[_SECOND]:
                    self.sink.left(True, t)
                if not ends:
                    self._recall(x_um, brightness, t)
            s[_SECOND] = False
            self._begin(x_um, force_mN, brightness, t)
            if stays:
                self.sink.left(False, t)
            else:
                s[_B_BEFORE] = 0
                s[_LOOSE] = ends
                self.sink.next(x_um, t)
            self._harden(force_mN, t)

    def _resolve(self, fits, x_um, force_mN, brightness, t):
        """Update the light of two known fingers; return whether one of them has left.

        The arguments are a reading, as in `_is_next` and `take`.
        """
        s = self._s
        if s[_IS_EVEN]:
            if solve(s, s[_X_UM], s[_B], x_um, brightness, fits):
                at_um = s[_FOUND_UM]
                slack_um = s[_FOUND_SLACK_UM]
                near = abs(at_um - s[_X_SECOND_UM]) < _NEAR_UM
                if near and brightness == s[_PEAK]:
                    s[_X_SECOND_UM] = at_um
                    s[_B_SECOND] = s[_FOUND_B]
                if near or slides(s, fits, x_um, brightness):
                    s[_X_PAIR_UM] = x_um
                    s[_B_PAIR] = brightness
                    s[_GUESSED] = False
                    self.sink.moved(at_um, slack_um)
                    return True
            # Two fingers that rest act like one finger at the position of their common reading.
            slack_um = find_third(s, s[_X_PAIR_UM], s[_B_PAIR], -1, x_um, brightness)
            if slack_um:
                self.sink.second(s[_X_GUESS_UM], slack_um, t)
                self.sink.moved(s[_X_SECOND_UM], slack_um)
            return True
        if fits and abs(x_um - s[_X_SECOND_UM]) < _NEAR_UM and (brightness < s[_B_SECOND] + _MORE):
            b = s[_B_SECOND]
            s[_SECOND] = False
            self._begin(x_um, force_mN, brightness, t)
            s[_B_BEFORE] = b
            s[_LOOSE] = True
            self.sink.left(False, t)
            self.sink.at(x_um, t)
            return True
        if not s[_FALLS]:
            s[_GUESSED] = False
            return False
        second_um = s[_X_SECOND_UM]
        slack_um = find_third(s, second_um, s[_B_SECOND], fits, x_um, brightness)
        if not slack_um and elapsed(s[_FELL], t) < _FALL_T:
            return False
        s[_X_UM] = s[_X_BEFORE_UM] = second_um
        s[_B] = s[_B_SECOND]
        s[_SECOND] = False
        self._mix(x_um, brightness, t)
        s[_IS_EVEN] = s[_PAIR] = True
        s[_HAS_DIPPED] = s[_IS_CALM] = False
        s[_FALLS] = False
        s[_LOOSE] = True
        self.sink.left(False, t)
        if slack_um and s[_B_GUESS] > s[_B] - _HALF:
            s[_SECOND] = self.sink.second(s[_X_GUESS_UM], slack_um, t)
            s[_X_SECOND_UM] = s[_X_GUESS_UM]
            s[_B_SECOND] = s[_B_GUESS]
        return True

    def _recall(self, x_um, brightness, t):
        """Report a second finger that was not found while two fingers touched."""
        s = self._s
        if recalls(s, x_um, brightness) and self.sink.second(
            s[_FOUND_UM], s[_FOUND_SLACK_UM] * _LATER >> 3, t
        ):
            self.sink.left(True, t)

    def noise_um(self, brightness):
        """Return an upper limit of a position's standard deviation due to ADC noise, in um.

        `brightness` is that of the reading, in Q20 of log2.
        """
        return noise(self._s[_NOISE_PRODUCT], brightness)

    def _slack_um(self, brightness):
        s = self._s
        # Largest difference of two readings of a resting finger, by the noise of the darker one.
        return max(_REST_UM, self.noise_um(min(brightness, s[_B_SEEN])) * 7 >> 1)

    def _harden(self, force_mN, t):
        s = self._s
        if force_mN >= s[_FIRM_MN] and s[_STATE] == _DOWN:
            s[_FIRM_MN] = _NEVER
            self.sink.firm(t)

    def _rests(self, x_um, force_mN, t):
        s = self._s
        if not (s[_LOW_UM] <= x_um <= s[_HIGH_UM] and s[_LOW_MN] <= force_mN <= s[_HIGH_MN]):
            self._rest(x_um, force_mN, t)
            return False
        if elapsed(s[_STILL], t) < s[_STUCK_T]:
            return False
        s[_STILL] = t
        return True

    def _rest(self, x_um, force_mN, t):
        s = self._s
        off_um = self._layout.slide_um >> 1
        s[_LOW_UM] = x_um - off_um
        s[_HIGH_UM] = x_um + off_um
        s[_LOW_MN] = force_mN - (force_mN >> 2)
        s[_HIGH_MN] = force_mN + (force_mN >> 2)
        s[_STILL] = t
