"""Converts readings to touches: press, movement, firm press and release, debounced.

One reading of six channels cannot distinguish two fingers from one finger between them. A sequence
of readings can, because nearly every finger is alone on the strip for some readings. While there
may be several fingers, the position of a reading is not used. State machine:

====  =====  ==================================================================================
from  to     when
====  =====  ==================================================================================
UP    DOWN   `detect` consecutive readings agree on a position, or on a steady motion
UP    TWO    readings disagree for 40 ms: fingers touched together at unknown positions
DOWN  DOWN   the position is that of the finger, or the finger slides
DOWN  TWO    otherwise; the first finger keeps its position of one reading *earlier*
TWO   DOWN   the position rests where the first finger was: the second finger has left
TWO   DOWN   the position rests elsewhere, and the first finger has left: the brightness fell, or it
             was never that of two fingers, or no second finger could cause this position
TWO   DOWN   the brightness changes, but not the position: only one finger touches
TWO   TWO    the first finger rests, and readings agree on the second one (second.py), even if
             the light of the first one is unknown
TWO   DOWN   one of two known fingers has left: one reading shows which
TWO   TWO    the first finger began to lift `_FALL_T` ago: the second one becomes the first
TWO   UP     no finger touches
====  =====  ==================================================================================

When one finger is alone again, a second finger that rested beside it, but was not found, is
estimated from the last readings of both. A release is delayed by `release_ms` (release debounce).
Integers only; allocates nothing.
"""

try:
    from micropython import const
except ImportError:
    const = int  # on the host


from array import array

from .decode import LED_OFF, MISFIT, NOT_CALIBRATED, SATURATED, TOO_DARK, TOUCHING
from .locate import locate, power
from .second import may_rest, weigh

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
_NOISE_UM = const(20_000)  # upper limit of the standard deviation
_REST_UM = const(250)  # largest difference between two readings of a resting position
_SAME_UM = const(450)  # largest distance from the mean position of the same finger
_BACK_UM = const(900)  # largest distance from the first finger after the second one has left
_SLIDE_LIGHT = const(9000)  # largest change of brightness per tick in a slide, Q20 of log2
_TOGETHER_T = const(39)  # if readings disagree for this time, fingers touched together
_REST_T = const(12)  # least duration of a resting position
_MOVED_UM = const(1500)
_SEEN_T = const(24)  # within this time the light of two fingers is visible
# Ratios of light as differences of brightness, Q20 of log2.
_FALLEN = const(772_000)  # 0.6
_DIPPED = const(435_000)  # 0.75
_LOST = const(337_000)  # 0.8
_MORE = const(171_000)  # 1.12
_EVEN = const(74_000)  # 1.05
# Limits for the detection of a second finger beside the first one.
_NEAR_UM = const(2000)
_APART_UM = const(4500)  # least distance between two fingers
_AGREE_UM = const(600)
_SURE_UM = const(4000)
_RISEN = const(30_000)  # 1.02: a finger arrives
_CALM = const(40_000)  # 1.03: the light of a finger at rest
_OTHER = const(150_000)  # 1.1
_EARLY = const(1)
_LATE = const(2)
# Share of the estimate's uncertainty that must be inside a key, in eighths; `_SOON`: about two
# standard deviations; `_LATER`: about one, because the key would be lost otherwise.
_SOON = const(5)
_LATER = const(4)
_TWICE_T = const(8)  # least time between two estimates that confirm each other
_NEVER = const(1 << 29)
_FALL_T = const(34)  # longest time in which a finger lifts
_CHANGED = const(150_000)  # 1.1
# Limits for the detection of a third finger.
_GROWN = const(116_000)  # 1.08
_BOTH = const(397_000)  # 1.3
_SINGLE = const(419_000)  # 1.32


def elapsed(since, now):
    """Return the ticks from the time `since` to the later time `now`; correct across a wrap."""
    return (now - since) & (TICKS - 1)


def _counts(brightness):
    """Convert a brightness (log2 in Q20) to counts times 16; the result is at least 1."""
    return max(power(brightness) >> 6, 1)


class ContactTracker:
    """Converts the readings of a strip to touches.

    Parameters
    ----------
    sink : object
        Receiver with these methods; `t` is the time in ticks, `x_um` a position:
        ``down(x_um, t)``: a finger touches.
        ``at(x_um, t)``: new position of this finger, while it is alone.
        ``firm(t)``: the force has reached ``firm_mN``; called once for each touch.
        ``up(t)``: the finger has left.
        ``next(x_um, t)``: the finger has left, and another one touches.
        ``stuck()``: the touch has not moved for ``stuck_ms``, so it is not a finger.
        With a known strip length also:
        ``second(x_um, slack_um, t) -> bool``: a second finger touches, at `x_um` +- `slack_um`.
        Returns whether the sink uses the second finger.
        ``left(second, t)``: the second finger has left if `second` is true, else the first one.

    Attributes
    ----------
    x_um : int
        Position of the first finger in um.
    force_mN : int
        Force of the last reading that fits one press, in mN.
    """

    def __init__(self, sink):
        self.sink = sink
        self._layout = None
        self._state = _SPENT
        self._known = False  # in TWO: whether the first finger's position is known
        self._seen = 0  # consecutive readings that agree
        self.x_um = self._x_before_um = self._x_seen_um = self._step_um = 0
        self._b = self._b_before = self._b_oldest = self._b_seen = 0
        self._b_since = 0
        self._length_um = self._decay = 0
        self._t = self._began = self._since = 0
        self._even = self._second = self._third = self._rises = self._pair = False
        self._falls = self._fell = 0
        self._loose = False
        self._low = 0
        self._noise = _NOISE
        self._rested = self._fit_seen = self._fit_both = False
        self._x_both_um = self._b_both = 0
        self._guessed = False
        # Whether the finger alone did not fit one press: then the fit is no evidence.
        self._drifts = 0
        self._guessed_at = 0
        self._x_second_um = self._b_second = 0
        self._x_guess_um = self._b_guess = self._slack_guess_um = 0
        self._found = array("i", bytes(12))
        self._leaving = False
        self._left = self._still = 0
        self._dipped = self._odd = False
        self._peak = self._x_peak_um = self._least = 0
        self._firm_mN = _NEVER  # force of a firm press, unless it was reported
        self._low_um = self._high_um = self._low_mN = self._high_mN = 0  # of a touch at rest
        self.force_mN = 0

    @property
    def touched(self):
        """Whether a finger with a known position touches the strip."""
        return self._state == _DOWN or (self._state == _TWO and self._known)

    @property
    def two(self):
        """Whether more than one finger may touch the strip."""
        return self._state == _TWO

    def set_layout(self, layout, length_um=0, decay=0):
        """Set the limits and the strip length; a present touch is ignored until it is lifted.

        Parameters
        ----------
        layout : layout.Layout
            Its statements in `layout.LIMITS` are used.
        length_um : int
            Length of the strip in um. With 0, one finger is expected: each movement is a slide,
            and readings that do not fit one press are ignored.
        decay : int
            Decay of the dye, see `locate.locate`.
        """
        self._layout = layout
        self._decay = decay
        self._length_um = length_um
        # Light decreases along a strip, and a long strip needs a weak dye: the noise grows.
        share = min(max(length_um, 0), 600_000) * 3 // 1000
        self._noise = max(share * share * 18 // 13, _NOISE)
        self.spend()

    def spend(self):
        """Drop the touch; the finger must be lifted before the next touch."""
        self._state = _SPENT
        self._seen = 0
        self._leaving = False

    def take(self, flags, position_um, force_mN, brightness, t):
        """Process a reading.

        Parameters
        ----------
        flags : int
            Flag bits of `decode`.
        position_um, force_mN : int
            Position in um and force in mN.
        brightness : int
            Brightness in Q20 of log2.
        t : int
            Time in ticks.
        """
        if flags & LED_OFF:
            return  # with the LED off, a touch cannot be detected
        layout = self._layout
        if not flags & TOUCHING or (force_mN < layout.release_mN and not flags & DOUBTFUL):
            self._lift(t)
            if force_mN and not flags & MISFIT and self._state == _UP:
                self._approach(position_um, brightness, t)
            return
        if self._leaving:
            self._leaving = False
            self._dipped = True
        if flags & _BLIND:
            self._seen = 0
            return
        fits = not flags & MISFIT or flags & TWO_FIT == TWO_FIT
        if not fits and not self._length_um:
            return
        state = self._state
        if fits:
            self.force_mN = force_mN
            if layout.stuck_t and state and self._rests(position_um, force_mN, t):
                self._state = _SPENT
                self.sink.stuck()
                return
        if state == _DOWN:
            self._follow(fits, position_um, force_mN, brightness, t)
        elif state == _UP:
            self._press(fits, position_um, force_mN, brightness, t)
        elif state == _TWO:
            self._part(fits, position_um, force_mN, brightness, t)
        if self._state == _DOWN:
            self._drifts = flags & MISFIT
        self._t = t

    def _lift(self, t):
        if self._state == _UP:
            self._seen = 0
            return
        if not self._leaving:
            self._leaving = True
            self._left = t
        if elapsed(self._left, t) < self._layout.release_t:
            return
        self._leaving = False
        down, self._state = self.touched, _UP
        self._seen = 0
        if down:
            self.sink.up(t)

    # State UP.

    def _approach(self, x_um, brightness, t):
        """Record a reading as the first one of a possible touch."""
        self._began = self._since = t
        self.x_um = self._x_seen_um = x_um
        self._b_seen = brightness
        self._step_um = self._peak = 0
        self._seen = 1

    def _press(self, fits, x_um, force_mN, brightness, t):
        layout = self._layout
        if force_mN < layout.press_mN:
            self._seen = 0
            if fits:
                self._approach(x_um, brightness, t)
            return
        moved_um = x_um - self._x_seen_um
        if not self._seen:
            self._approach(x_um, brightness, t)
        elif (
            fits
            and self._seen > 0
            and abs(moved_um)
            < (self._slack_um(brightness) * 5 >> 2 if self._length_um else layout.jump_um)
        ):
            self._seen += 1
        else:
            steady = self._step_um and abs(moved_um - self._step_um) < self._slack_um(brightness)
            if fits and steady and abs(moved_um) <= layout.jump_um:
                self._seen = layout.detect  # the finger slides already
            else:
                self._seen = 1
                self.x_um = x_um
                if elapsed(self._began, t) >= _TOGETHER_T:
                    self._known = self._even = False
                    self._mix(x_um, brightness, t)
                    return
        # Three readings show whether a motion is steady.
        self._step_um = moved_um if self._seen == 1 and elapsed(self._began, t) else 0
        if not fits:
            self._step_um = 0
            self._seen = -1
        self._x_seen_um = x_um
        self._b_seen = brightness
        if self._seen >= layout.detect:
            self._begin(x_um, force_mN, brightness, t)
            self._b_before = 0
            self.sink.down(x_um, t)
            self._harden(force_mN, t)

    # State DOWN.

    def _begin(self, x_um, force_mN, brightness, t):
        self._state = _DOWN
        self._seen = 0
        self._loose = False
        self._dipped = False
        self.x_um = self._x_before_um = x_um
        self._b = self._b_before = brightness
        self._b_oldest = 0
        self._x_seen_um = x_um
        self._firm_mN = self._layout.firm_mN
        self._rest(x_um, force_mN, t)

    def _follow(self, fits, x_um, force_mN, brightness, t):
        off_um = x_um - self.x_um
        if fits and -_SAME_UM < off_um < _SAME_UM:
            off_um >>= 1
            self._loose = False
        elif fits and self._loose and -_NEAR_UM < off_um < _NEAR_UM:
            pass
        elif self._is_next(fits, off_um, x_um, brightness, t):
            self._part(fits, x_um, force_mN, brightness, t)
            return
        self._x_before_um = self.x_um
        self.x_um += off_um
        self._x_seen_um = x_um
        self._b_oldest = self._b_before
        self._b_before = self._b
        self._b = brightness
        self._dipped = False
        self.sink.at(x_um, t)
        if force_mN >= self._firm_mN:
            self._harden(force_mN, t)

    def _is_next(self, fits, off_um, x_um, brightness, t):
        """Return whether a reading at another position may be of two fingers; if so, enter TWO.

        Parameters
        ----------
        fits : bool
            Whether the spectrum of the reading fits one press.
        off_um : int
            Distance of the reading from the finger, in um.
        x_um, brightness, t : int
            Position in um, brightness in Q20 of log2, and time in ticks.
        """
        if fits and not self._dipped:
            if abs(off_um) < 4 * self.noise_um(brightness):
                return False
            ticks = min(elapsed(self._t, t), _TOGETHER_T)
            if abs(x_um - self._x_seen_um) <= self._layout.jump_um and (
                not self._length_um or abs(brightness - self._b) <= _SLIDE_LIGHT * ticks
            ):
                return False
        before = self._b_before
        risen = self._b - before
        last = min(self._b, brightness)
        steady = before and abs(before - self._b_oldest) < _EVEN
        self._calm = abs(risen) < _CALM and abs(before - self._b_oldest) < _CALM
        self._even = risen > -_EVEN and (risen < _EVEN or steady)
        self._rises = risen >= _EVEN and not steady
        self._falls = _EARLY if risen <= -_EVEN else 0
        self._fell = t
        if last < max(self._b, before, self._b_oldest) - _FALLEN:
            self._dipped = True
        self._known = True
        self.x_um = self._x_before_um
        if not self._rises:
            self._b = before
        self._mix(x_um, brightness, t)
        self._least = last
        return True

    # State TWO.

    def _mix(self, x_um, brightness, t):
        self._state = _TWO
        self._began = t
        self._seen = -1
        self._odd = self._second = self._third = False
        self._rested = self._guessed = self._pair = False
        self._b_both = 0
        self._peak = self._least = self._low = brightness
        self._x_peak_um = x_um

    def _part(self, fits, x_um, force_mN, brightness, t):
        # The light of two fingers was lost and grows again: a third finger.
        if (
            self._low < self._peak - _LOST
            and brightness > self._low + _GROWN
            and self._peak > self._b + _BOTH
        ):
            self._third = True
        if brightness > self._peak + _RISEN and self._falls == _LATE:
            self._third = True
        if brightness >= self._peak:
            self._peak = self._low = brightness
            self._x_peak_um = x_um
        self._low = min(brightness, self._low)
        self._least = min(brightness, self._least)
        seen = self._seen
        x_last_um = self._x_seen_um
        b_last = self._b_seen
        steady = abs(x_um - x_last_um) < self._slack_um(brightness)
        if brightness > self._b_seen + _RISEN:
            self._b_both = 0
        elif not steady and self._rested:
            self._x_both_um = self._x_seen_um
            self._b_both = self._b_seen
            self._fit_both = self._fit_seen
        self._rested = steady
        self._fit_seen = fits
        if seen >= 0 and fits and steady:
            self._seen = min(seen + 1, 99)
        else:
            self._seen = 0
            self._since = t
            self._b_since = brightness
            if not fits:
                self._seen = -1
                self._odd = True
        self._x_seen_um = x_um
        self._b_seen = brightness
        off_um = abs(x_um - self.x_um)
        # With two fingers, this change of light would move the position.
        change = abs(brightness - b_last)
        single = (
            fits
            and self._known
            and not self._second
            and self._pair
            and change > _CHANGED
            and abs(x_um - x_last_um) < max(_REST_UM, (change >> 12) * min(off_um, 100_000) >> 12)
        )
        if brightness < self._peak - _EVEN:
            self._even = self._rises = False  # the first finger may be leaving
            if self._known and not self._falls and brightness < b_last - _CALM:
                away = off_um - abs(x_last_um - self.x_um)
                if away > _REST_UM:
                    self._falls = _LATE
                    self._fell = t
        if self._second and self._resolve(fits, x_um, force_mN, brightness, t):
            return
        if not (self._second or self._third or self._dipped):
            if self._even:
                self._guess(fits, x_um, brightness, t)
            elif self._rises:
                self._weigh(fits, x_last_um, b_last, x_um, brightness, t)
        self._pair = True
        seen = self._seen
        if not single and (seen < 1 or elapsed(self._since, t) * (seen + 1) < _REST_T * seen):
            return
        if not self._known:
            # If light was lost and the position moved, one of two fingers has left. Or there was
            # only one finger, and ambient light that is now off.
            if (brightness < self._peak - _LOST and abs(x_um - self._x_peak_um) > _MOVED_UM) or (
                self._odd and elapsed(self._since, t) >= _TOGETHER_T
            ):
                self._begin(x_um, force_mN, brightness, t)
                self._b_before = 0
                self.sink.down(x_um, t)
                self._recall(x_um, brightness, t)
                self._harden(force_mN, t)
            return
        off_um = x_um - self.x_um
        back_um = _NEAR_UM if self._loose else _BACK_UM
        if abs(off_um) < max(back_um, 4 * self.noise_um(brightness)):
            firm_mN = self._firm_mN
            if not self._second:
                self._recall(x_um, brightness, t)
            self._begin(x_um, force_mN, brightness, t)
            self._firm_mN = firm_mN
            if self._second:
                self._second = False
                self.sink.left(True, t)
            self.sink.at(x_um, t)
        elif single or self._has_left(off_um, brightness, t):
            stays = self._second and not self._dipped and abs(x_um - self._x_second_um) < _APART_UM
            if not stays:
                if self._second:
                    self.sink.left(True, t)
                self._recall(x_um, brightness, t)
            self._second = False
            self._begin(x_um, force_mN, brightness, t)
            if stays:
                self.sink.left(False, t)
            else:
                self._b_before = 0
                self.sink.next(x_um, t)
            self._harden(force_mN, t)

    def _resolve(self, fits, x_um, force_mN, brightness, t):
        """Update the light of two known fingers; return whether one of them has left."""
        if self._even:
            if (
                self._solve(self.x_um, self._b, x_um, brightness, fits)
                and abs(self._found[0] - self._x_second_um) < _NEAR_UM
            ):
                self._b_second = self._found[2]
            return False
        if (
            fits
            and abs(x_um - self._x_second_um) < _NEAR_UM
            and (brightness < self._b_second + _MORE)
        ):
            b = self._b_second
            self._second = False
            self._begin(x_um, force_mN, brightness, t)
            self._b_before = b
            self._loose = True
            self.sink.left(False, t)
            self.sink.at(x_um, t)
            return True
        if not self._falls:
            self._guessed = False
            return False
        slack_um = self._find_third(fits, x_um, brightness)
        if not slack_um and elapsed(self._fell, t) < _FALL_T:
            return False
        self.x_um = self._x_before_um = self._x_second_um
        self._b = self._b_second
        self._second = False
        self._mix(x_um, brightness, t)
        self._even = self._pair = True
        self._dipped = self._calm = False
        self._falls = 0
        self._loose = True
        self.sink.left(False, t)
        if slack_um:
            self._second = self.sink.second(self._x_guess_um, slack_um, t)
            self._x_second_um = self._x_guess_um
            self._b_second = self._b_guess
        return True

    def _find_third(self, fits, x_um, brightness):
        """Estimate a third finger beside the second one, as if the first one had left.

        Returns its uncertainty in um, or 0. While the first one lifts, two readings do not agree.
        """
        second_um = self._x_second_um
        found = self._found
        agrees = self._guessed
        last_um = self._x_guess_um
        self._guessed = (
            self._solve(second_um, self._b_second, x_um, brightness, fits)
            and found[2] > self._b_second - _BOTH
            and abs(found[0] - self.x_um) > _APART_UM
        )
        if not self._guessed:
            return 0
        self._x_guess_um = at_um = found[0]
        self._b_guess = found[2]
        if (
            not agrees
            or abs(at_um - last_um) > _AGREE_UM
            or not self._solve(second_um, self._b_second - _CHANGED, x_um, brightness, fits)
        ):
            return 0
        return abs(found[0] - at_um)

    def _solve(self, x1_um, b1, x_um, brightness, fits):
        """Estimate a finger beside one at `x1_um` from a reading, see `locate.locate`.

        Stores the result in `_found`, and returns whether its position is on the strip.
        """
        found = self._found
        return (
            self._length_um
            and locate(
                found,
                self._decay,
                x1_um,
                b1,
                x_um,
                brightness,
                -1 if self._drifts else fits,
                self.noise_um(brightness),
            )
            and -_NEAR_UM - found[1] < found[0] < self._length_um + _NEAR_UM + found[1]
        )

    def _guess(self, fits, x_um, brightness, t):
        """Estimate a finger beside the first one, which rests; report it if two readings agree."""
        if not self._solve(self.x_um, self._b, x_um, brightness, fits):
            self._guessed = False
            end_um = self._length_um + _NEAR_UM if x_um > self.x_um else -_NEAR_UM
            if not may_rest(self._decay, self.x_um, self._b - _EVEN, end_um, x_um, brightness):
                # The first finger became dimmer, even if the second one is at the end of the strip.
                self._even = False
                self._falls = _EARLY
                self._fell = t
            return
        found = self._found
        at_um = found[0]
        slack_um = found[1]
        b = found[2]
        if self._calm:
            slack_um >>= 1
        agrees = self._guessed and abs(at_um - self._x_guess_um) <= _AGREE_UM + (
            slack_um + self._slack_guess_um >> 1
        )
        if agrees and (
            elapsed(self._guessed_at, t) < _TWICE_T
            or (abs(b - self._b_guess) <= _OTHER and (fits or not self._calm))
        ):
            return  # no evidence: the same share of light always gives the same position
        self._guessed_at = t
        self._guessed = True
        self._x_guess_um = at_um
        self._slack_guess_um = slack_um
        self._b_guess = b
        if not agrees or slack_um > _SURE_UM:
            return
        self._second = self.sink.second(at_um, slack_um * _SOON >> 3, t)
        self._x_second_um = at_um
        self._b_second = b

    def _weigh(self, fits, x_last_um, b_last, x_um, brightness, t):
        """Estimate both fingers while the light of the first one is unknown."""
        found = self._found
        if not self._pair:
            return
        if brightness < b_last + _EVEN:
            # Both fingers rest: only a spectrum of two fingers confirms an earlier estimate.
            if self._guessed and self._rested and not fits:
                self._found_both(fits, x_um, brightness, t)
            return
        limit_um = self._length_um + _NEAR_UM if x_um > self.x_um else -_NEAR_UM
        if (
            not weigh(found, self._decay, self.x_um, limit_um, x_last_um, b_last, x_um, brightness)
            or found[2] < self._b - _CALM
        ):
            # A third reading confirms an earlier estimate, because its light differs.
            if (
                self._guessed
                and self._solve(self.x_um, self._b_guess, x_um, brightness, fits)
                and abs(found[0] - self._x_guess_um) <= _AGREE_UM + self._slack_guess_um
            ):
                self._found_both(fits, x_um, brightness, t)
            else:
                self._guessed = False
            return
        at_um = found[0]
        slack_um = found[1]
        b = found[2]
        agrees = (
            self._guessed
            and abs(at_um - self._x_guess_um) <= _AGREE_UM + slack_um + self._slack_guess_um
        )
        if not agrees or slack_um < self._slack_guess_um:
            self._guessed = True
            self._x_guess_um = at_um
            self._slack_guess_um = slack_um
            self._b_guess = b
        if agrees:
            self._found_both(fits, x_um, brightness, t)

    def _found_both(self, fits, x_um, brightness, t):
        found = self._found
        self._b = self._b_guess
        self._even = True
        self._rises = False
        if self._slack_guess_um > _SURE_UM or not self._solve(
            self.x_um, self._b, x_um, brightness, fits
        ):
            self._guessed = False
            return
        self._b_guess = found[2]
        self._second = self.sink.second(self._x_guess_um, self._slack_guess_um * _SOON >> 3, t)
        self._x_second_um = self._x_guess_um
        self._b_second = found[2]

    def _recall(self, x_um, brightness, t):
        """Report a finger that rested beside the one that is now alone at `x_um`."""
        if (
            self._second
            or not self._b_both
            or abs(self._b_since - brightness) > _EVEN  # it lifts
            or not self._solve(x_um, self._b_since, self._x_both_um, self._b_both, self._fit_both)
        ):
            return
        at_um = self._found[0]
        slack_um = self._found[1]
        if slack_um > _SURE_UM or abs(at_um - self.x_um) < _APART_UM + slack_um:
            return
        if self.sink.second(at_um, slack_um * _LATER >> 3, t):
            self.sink.left(True, t)

    def _has_left(self, off_um, brightness, t):
        """Return whether the first finger has left, if positions now rest `off_um` um from it."""
        if brightness > self._b_since + _DIPPED:
            return True  # with two fingers, this change of force would move the position
        first = self._b
        if self._second:
            apart_um = self._x_second_um - self.x_um
            if off_um < 0:
                apart_um = -apart_um
            if abs(off_um) < apart_um - _NEAR_UM and brightness < self._b_since - _EVEN:
                return False  # both lift
            # A third finger may be there, and the second one may not have left.
            return not self._solve(
                self._x_second_um,
                self._b_second - _DIPPED,
                self.x_um + off_um,
                brightness,
                True,
            )
        x_um = self.x_um + off_um
        # No second finger on the strip could cause this position while the first one rests.
        alone = (self._seen > 1 or brightness < first + _SINGLE) and not self._solve(
            self.x_um, first - _MORE, x_um, brightness, True
        )
        if self._falls and not self._third and elapsed(self._fell, t) >= _FALL_T:
            return True
        if self._third:
            # Return True only if the light is too low for two fingers.
            return brightness < self._peak - _LOST and (alone or brightness < first + _SINGLE)
        if alone:
            return True
        if self._dipped or self._least < min(first, brightness) - _DIPPED:
            return True
        if self._peak < first + _MORE and elapsed(self._began, t) >= _SEEN_T:
            return True  # the light was never that of two fingers
        light_first = _counts(first)
        peak = _counts(self._peak)
        light = _counts(brightness)
        if light >= peak - light_first // 5:
            return False
        # Light was lost while the position moved away from the first finger.
        away_um = x_um - self._x_peak_um
        if off_um < 0:
            away_um = -away_um
        return away_um > (abs(off_um) >> 5) * ((light_first << 4) // peak) // 10

    def noise_um(self, brightness):
        """Return an upper limit of a position's standard deviation due to ADC noise, in um."""
        return min(self._noise * 16 // _counts(brightness), _NOISE_UM)

    def _slack_um(self, brightness):
        # Largest difference of two readings of a resting finger, by the noise of the darker one.
        return max(_REST_UM, self._noise * 56 // _counts(min(brightness, self._b_seen)))

    def _harden(self, force_mN, t):
        if force_mN >= self._firm_mN and self._state == _DOWN:
            self._firm_mN = _NEVER
            self.sink.firm(t)

    def _rests(self, x_um, force_mN, t):
        if not (
            self._low_um <= x_um <= self._high_um and self._low_mN <= force_mN <= self._high_mN
        ):
            self._rest(x_um, force_mN, t)
            return False
        if elapsed(self._still, t) < self._layout.stuck_t:
            return False
        self._still = t
        return True

    def _rest(self, x_um, force_mN, t):
        off_um = self._layout.slide_um >> 1
        self._low_um = x_um - off_um
        self._high_um = x_um + off_um
        self._low_mN = force_mN - (force_mN >> 2)
        self._high_mN = force_mN + (force_mN >> 2)
        self._still = t
