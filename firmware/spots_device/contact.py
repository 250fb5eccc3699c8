"""Readings to touches: press, movement, force and release, debounced; one finger after the other.

One reading of six channels cannot tell two fingers from one between them, but time can: nearly
every finger is alone for some readings. While more than one may be there, no place between them
counts:

====  =====  ==================================================================================
from  to     when
====  =====  ==================================================================================
UP    DOWN   `detect` readings in a row agree on a place, or on a steady motion
UP    TWO    they did not for 40 ms: fingers that came together, none of their places known
DOWN  DOWN   the place is that of the finger, or the finger slides
DOWN  TWO    otherwise; the finger is where it was one reading *earlier*
TWO   DOWN   the place rests where the first finger was: the second one has left
TWO   DOWN   it rests elsewhere, and the first one has left: its light fell before, or was seen to
             fall, or there never was the light of two, or two could not seem to lie there
TWO   TWO    with the first at rest, several readings agree where the second is (second.py)
TWO   UP     the light has gone
====  =====  ==================================================================================

A release counts after a time (release debounce). Integers only; allocates nothing.
"""

try:
    from micropython import const
except ImportError:
    const = int  # on the host


from array import array

from .decode import LED_OFF, MISFIT, NOT_CALIBRATED, SATURATED, TOO_DARK, TOUCHING
from .second import locate, power

DOUBTFUL = LED_OFF | MISFIT | NOT_CALIBRATED | SATURATED | TOO_DARK
# Of a reading with two fingers: never trusted, and both bits if its spectrum would fit one press.
TWO_FIT = MISFIT | TOO_DARK
_BLIND = NOT_CALIBRATED | SATURATED
# Time is in ticks of 1.024 ms: the board's microseconds without their lower ten bits, so that it
# wraps where they do.
TICK_US = 1024
TICKS = 1 << 22

_UP = const(0)
_DOWN = const(1)
_SPENT = const(2)  # what lies there must be lifted before it makes another touch
_TWO = const(3)

_DECAY = const(288)  # of a usual dye, see second.py
# Standard deviation of a place in um times the light in counts: that of the converter's noise at
# the far end of a strip of 85 mm; it grows with the square of the length.
_NOISE = const(90_000)
_NOISE_UM = const(20_000)  # at most
_REST_UM = const(250)  # from reading to reading, of a place that rests
_SAME_UM = const(450)  # from the mean place of a finger that is there
_BACK_UM = const(900)  # from the finger that was alone before
_SLIDE_LIGHT = const(9000)  # a tick; brightness, Q20 of log2
_TOGETHER_T = const(39)  # readings that agree on nothing for so long are fingers that came together
_REST_T = const(12)
_MOVED_UM = const(1500)
_SEEN_T = const(24)  # two fingers are seen together within
# Shares of light as differences of brightness.
_FALLEN = const(772_000)  # 0.6
_DIPPED = const(435_000)  # 0.75
_LOST = const(337_000)  # 0.8
_MORE = const(171_000)  # 1.12
_EVEN = const(74_000)  # 1.05
_MATCH = const(210_000)  # 1.15
# Of a second finger that is found beside the first.
_NEAR_UM = const(2000)
_MATCH_UM = const(800)
_AGREE_UM = const(600)
_SURE_UM = const(2500)
_GUESSES = const(2)
_OTHER = const(150_000)  # 1.1
_SOON_T = const(78)
_LEVEL = const(2)
# Of a third.
_GROWN = const(116_000)  # 1.08
_BOTH = const(397_000)  # 1.3
_SINGLE = const(419_000)  # 1.32
_ALONE_T = const(28)


def elapsed(since, now):
    """Return the ticks from one time to a later one."""
    return (now - since) & (TICKS - 1)


def _counts(brightness):
    """Return light in sixteenths of a count of a brightness."""
    return max(power(brightness) >> 6, 1)


class ContactTracker:
    """Turns readings into touches.

    Parameters
    ----------
    sink : object
        ``down(x_um, t)``, ``at(x_um, t)`` for every further reading of that finger alone,
        ``firm(t)`` once when it gets that hard, ``up(t)``, ``next(x_um, t)`` for another finger
        in the place of this one, ``stuck()`` for one that does not move for long. Where the
        length of the strip is known also ``second(x_um, slack_um, t)`` for another finger beside
        this one, which returns whether it is used, and ``left(second, t)`` once that one or,
        else, the first one has left.

    Attributes
    ----------
    x_um : int
        Place of the first finger, as far as it is known.
    force_mN : int
        Of the last reading that could be trusted.
    """

    def __init__(self, sink):
        self.sink = sink
        self._layout = None
        self._state = _SPENT
        self._known = False  # in TWO: whether the first finger's place is known, and its key down
        self._seen = 0  # readings in a row that agree
        self.x_um = self._x_before_um = self._x_seen_um = self._step_um = 0
        self._b = self._b_before = self._b_oldest = self._b_seen = 0
        self._b_since = self._b_level = self._level = 0
        self._length_um = 0
        self._t = self._began = self._since = 0
        self._even = self._second = self._third = False
        self._low = 0
        self._noise = _NOISE
        self._guesses = self._x_second_um = self._b_second = 0
        self._x_guess_um = self._b_guess = self._slack_guess_um = 0
        self._fades = False
        self._found = array("i", bytes(12))
        self._leaving = False
        self._left = self._still = 0
        self._dipped = self._odd = False
        self._peak = self._x_peak_um = self._least = 0
        self._firm = False
        self._rest_um = self._rest_mN = 0
        self.force_mN = 0

    @property
    def touched(self):
        """Whether a finger is down."""
        return self._state == _DOWN or (self._state == _TWO and self._known)

    @property
    def two(self):
        """Whether more than one finger may be there."""
        return self._state == _TWO

    def set_layout(self, layout, length_um=0):
        """Use these limits on a strip of this length.

        With 0 for the length one finger is expected: what moves is a slide, however its light
        changes, and readings that do not fit one press do not count.
        What lies on the strip must be lifted before it makes a touch.
        """
        self._layout = layout
        self._length_um = length_um
        # The light that tells places apart falls along a strip, and a long one needs a weak dye.
        share = min(max(length_um, 0), 600_000) * 3 // 1000
        self._noise = max(share * share * 18 // 13, _NOISE)
        self.spend()

    def spend(self):
        """Forget the touch; the finger has to be lifted before it makes another."""
        self._state = _SPENT
        self._seen = 0
        self._leaving = False

    def take(self, flags, position_um, force_mN, brightness, t):
        """Take a reading, at time `t` in ticks; `brightness` is Q20 of log2."""
        if flags & LED_OFF:
            return  # the LED was off: neither a touch nor the end of one
        layout = self._layout
        if not flags & TOUCHING or (force_mN < layout.release_mN and not flags & DOUBTFUL):
            self._lift(t)
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

    # No finger is down.

    def _press(self, fits, x_um, force_mN, brightness, t):
        layout = self._layout
        if force_mN < layout.press_mN:
            self._seen = 0
            return
        moved_um = x_um - self._x_seen_um
        if not self._seen:
            self._began = self._since = t
            self.x_um = x_um
            self._peak = 0
            self._seen = 1
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
                self._seen = layout.detect  # it came down sliding
            else:
                self._seen = 1
                self.x_um = x_um
                if elapsed(self._began, t) >= _TOGETHER_T:
                    self._known = False
                    self._mix(x_um, brightness, t)
                    return
        # A motion is judged by three readings.
        self._step_um = moved_um if self._seen == 1 and elapsed(self._began, t) else 0
        if not fits:
            self._step_um = 0
            self._seen = -1
        self._note(x_um, brightness)
        if self._seen >= layout.detect:
            self._begin(x_um, force_mN, brightness, t)
            self.sink.down(x_um, t)
            self._harden(force_mN, t)

    # One finger is down.

    def _begin(self, x_um, force_mN, brightness, t):
        self._state = _DOWN
        self._seen = 0
        self._dipped = False
        self.x_um = self._x_before_um = x_um
        self._b = self._b_before = brightness
        self._b_oldest = 0
        self._x_seen_um = x_um
        self._firm = False
        self._rest_um = x_um
        self._rest_mN = force_mN
        self._still = t

    def _follow(self, fits, x_um, force_mN, brightness, t):
        off_um = x_um - self.x_um
        if fits and -_SAME_UM < off_um < _SAME_UM:
            off_um >>= 1
        elif self._is_next(fits, off_um, x_um, brightness, t):
            self._part(fits, x_um, force_mN, brightness, t)
            return
        self._x_before_um = self.x_um
        self.x_um += off_um
        self._x_seen_um = x_um
        self._b_oldest = self._b_before
        self._b_before = self._b
        self._b = brightness
        if self._dipped:
            self._dipped = False
        self.sink.at(x_um, t)
        if not self._firm:
            self._harden(force_mN, t)

    def _is_next(self, fits, off_um, x_um, brightness, t):
        """Return whether a reading that is off may be of more than this finger."""
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
        self._even = risen > -_EVEN and (risen < _EVEN or abs(before - self._b_oldest) < _EVEN)
        if last < max(self._b, before, self._b_oldest) - _FALLEN:
            self._dipped = True
        self._known = True
        self.x_um = self._x_before_um
        self._b = before
        self._mix(x_um, brightness, t)
        self._least = last
        return True

    # More than one may be.

    def _mix(self, x_um, brightness, t):
        self._state = _TWO
        self._began = t
        self._seen = -1
        self._odd = self._second = self._third = self._fades = False
        self._guesses = 0
        self._peak = self._least = self._low = brightness
        self._x_peak_um = x_um

    def _part(self, fits, x_um, force_mN, brightness, t):
        # Light of two that was lost and grows again, or grows after a rest: a third has come.
        if (
            self._low < self._peak - _LOST
            and brightness > self._low + _GROWN
            and self._peak > self._b + _BOTH
        ) or (
            self._seen > 0 and brightness > self._b_seen + _GROWN and self._b_seen > self._b + _MORE
        ):
            self._third = True
        if brightness >= self._peak:
            self._peak = self._low = brightness
            self._x_peak_um = x_um
        self._low = min(brightness, self._low)
        self._least = min(brightness, self._least)
        moved_um = x_um - self._x_seen_um
        seen = self._seen
        if seen >= 0 and fits and self._is_steady(moved_um, brightness):
            self._seen = min(seen + 1, 99)
            self._level += 1
            if abs(brightness - self._b_level) > _EVEN:
                self._level = 0
                self._b_level = brightness
        else:
            self._seen = 0
            self._since = t
            self._b_since = self._b_level = brightness
            self._level = 0
            if not fits:
                self._seen = -1
                self._odd = True
        self._note(x_um, brightness)
        if self._known and self._length_um and self._locate(fits, x_um, force_mN, brightness, t):
            return
        seen = self._seen
        if seen < 1 or elapsed(self._since, t) * (seen + 1) < _REST_T * seen:
            return
        if not self._known:
            # They came together: one has left when light was lost and the place moved. Or it was
            # one, under a light that has gone.
            if (brightness < self._peak - _LOST and abs(x_um - self._x_peak_um) > _MOVED_UM) or (
                self._odd and elapsed(self._since, t) >= _TOGETHER_T
            ):
                self._begin(x_um, force_mN, brightness, t)
                self.sink.down(x_um, t)
                self._harden(force_mN, t)
            return
        off_um = x_um - self.x_um
        if abs(off_um) < max(_BACK_UM, 4 * (self.noise_um(brightness))):
            firm = self._firm
            self._begin(x_um, force_mN, brightness, t)
            self._firm = firm
            if self._second:
                self._second = False
                self.sink.left(True, t)
            self.sink.at(x_um, t)
        elif self._has_left(off_um, brightness, t):
            if self._second and abs(x_um - self._x_second_um) < _NEAR_UM:
                self._remain(x_um, force_mN, brightness, t)
                return
            self._begin(x_um, force_mN, brightness, t)
            if self._second:
                self._second = False
                self.sink.left(True, t)
            self.sink.next(x_um, t)
            self._harden(force_mN, t)

    def _locate(self, fits, x_um, force_mN, brightness, t):
        """Look for a second finger beside the first one; return whether that one remained alone."""
        if self._second and fits:
            slack_um = max(_MATCH_UM, self._slack_um(brightness))
            if (
                abs(x_um - self._x_second_um) < slack_um
                and abs(brightness - self._b_second) < _MATCH
            ):
                self._remain(x_um, force_mN, brightness, t)
                return True
        if brightness < self._peak - _EVEN:
            self._fades = True  # the first one may be leaving
        late = elapsed(self._began, t) > _SOON_T
        if self._second:
            # The second one rests: a third may come beside it.
            if self._fades:
                self._guess(self._x_second_um, self._b_second, x_um, brightness, t)
        elif self._even and not (late or self._fades or self._third or self._dipped):
            self._guess(self.x_um, self._b, x_um, brightness, t)
        return False

    def _guess(self, x1_um, b1, x_um, brightness, t):
        """Estimate the finger beside one at rest; press its key once several readings agree."""
        found = self._found
        noise_um = self.noise_um(brightness)
        if not locate(found, _DECAY, x1_um, b1, x_um, brightness, noise_um):
            self._guesses = 0
            return
        at_um = found[0]
        slack_um = found[1]
        if not -_NEAR_UM < at_um < self._length_um + _NEAR_UM or (
            self._second and abs(at_um - self.x_um) < _NEAR_UM + slack_um
        ):
            self._guesses = 0
            return
        if not self._guesses or abs(at_um - self._x_guess_um) > _AGREE_UM + (
            slack_um + self._slack_guess_um >> 1
        ):
            self._guesses = 1
        elif abs(found[2] - self._b_guess) > _OTHER:
            self._guesses += 1  # with another share of the light, so it is no blend of others
        elif self._guesses == 1:
            return
        self._x_guess_um = at_um
        self._slack_guess_um = slack_um
        self._b_guess = found[2]
        if self._guesses < _GUESSES or slack_um > _SURE_UM:
            return
        if self._second:
            # So the first one has gone, and the second takes its place.
            self.sink.left(False, t)
            self.x_um = x1_um
            self._b = b1
            self._began = t
            self._fades = self._third = False
            self._peak = brightness
            self._x_peak_um = x_um
        self._second = self.sink.second(at_um, 2 * slack_um, t)
        if self._second:
            self._x_second_um = at_um
            self._b_second = found[2]

    def _remain(self, x_um, force_mN, brightness, t):
        """The first finger has left the second."""
        self._second = False
        self._begin(x_um, force_mN, brightness, t)
        self.sink.left(False, t)
        self._harden(force_mN, t)

    def _has_left(self, off_um, brightness, t):
        """Return whether the first finger is gone from a light that rests elsewhere."""
        if abs(brightness - self._b_since) > _DIPPED:
            return True  # of two, one that presses harder or lifts moves the place
        first = self._b
        if self._third:
            # Only what is too little light for two, for long.
            return (
                elapsed(self._since, t) >= _ALONE_T
                and brightness < self._peak - _LOST
                and brightness < first + _SINGLE
            )
        if self._dipped or self._least < min(first, brightness) - _DIPPED:
            return True
        if self._peak < first + _MORE and elapsed(self._began, t) >= _SEEN_T:
            return True  # there never was the light of two
        alone = _counts(first)
        peak = _counts(self._peak)
        light = _counts(brightness)
        if self._is_alone(self.x_um + off_um, brightness):
            return True
        if light >= peak - alone // 5:
            return False
        # Light was lost, and the place went away from the first finger meanwhile.
        away_um = self.x_um + off_um - self._x_peak_um
        if off_um < 0:
            away_um = -away_um
        return away_um > (abs(off_um) >> 5) * ((alone << 4) // peak) // 10

    def _is_alone(self, x_um, brightness):
        """Return whether no second finger on the strip could shift a light that rests so far.

        The first one would have 0.6 of its light or more.
        """
        if self._level < _LEVEL or not self._length_um:
            return False
        found = self._found
        first = self._b - _FALLEN
        if not locate(found, _DECAY, self.x_um, first, x_um, brightness, 0):
            return True
        slack_um = _NEAR_UM + found[1]
        return not -slack_um < found[0] < self._length_um + slack_um

    def _is_steady(self, moved_um, brightness):
        return -_REST_UM < moved_um < _REST_UM or abs(moved_um) < self._slack_um(brightness)

    def noise_um(self, brightness):
        """Return the standard deviation of a place by the converter's noise, at most."""
        return min(self._noise * 16 // _counts(brightness), _NOISE_UM)

    def _slack_um(self, brightness):
        # Between two readings, by the darker one's noise.
        return max(_REST_UM, self._noise * 56 // _counts(min(brightness, self._b_seen)))

    def _note(self, x_um, brightness):
        self._x_seen_um = x_um
        self._b_seen = brightness

    def _harden(self, force_mN, t):
        if not self._firm and force_mN >= self._layout.firm_mN and self._state == _DOWN:
            self._firm = True
            self.sink.firm(t)

    def _rests(self, x_um, force_mN, t):
        layout = self._layout
        if (
            abs(x_um - self._rest_um) > layout.slide_um >> 1
            or abs(force_mN - self._rest_mN) > self._rest_mN >> 2
        ):
            self._rest_um = x_um
            self._rest_mN = force_mN
            self._still = t
            return False
        if elapsed(self._still, t) < layout.stuck_t:
            return False
        self._still = t
        return True
