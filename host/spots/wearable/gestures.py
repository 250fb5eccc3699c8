"""Detects gestures, each with a confidence, on a strip that is worn on the body.

On an arm that bends and stretches, positions and forces are less accurate than on a desk. So no
gesture depends on the position of a touch, and only a squeeze depends on its force.
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from spots_device.fingers.tracker import ContactTracker
from spots_device.keys.layout import default_lines, parse
from spots_device.reading.decode import LED_OFF

from ..advice.contact_finder import tracker_arguments
from ..link.frames import Touch
from ..link.timeouts import RELEASE_S
from .margins import above, below
from .two_fingers import ANCHOR_AND_SLIDE, TWO_FINGER_SQUEEZE, TwoFingers

TAP, DOUBLE_TAP, HOLD = "tap", "double_tap", "hold"
SQUEEZE = "squeeze"
SWIPE_MINUS, SWIPE_PLUS = "swipe_minus", "swipe_plus"  # towards the sensor, and away from it
# Towards the sensor and away from it, after the finger has rested.
SLIDE_MINUS, SLIDE_PLUS = "slide_minus", "slide_plus"
NAMES = (
    TAP, DOUBLE_TAP, HOLD, SQUEEZE, SWIPE_MINUS, SWIPE_PLUS, SLIDE_MINUS, SLIDE_PLUS,
    TWO_FINGER_SQUEEZE, ANCHOR_AND_SLIDE
)  # fmt: skip

_STILL_UM = 4_000  # a finger that moves less than this counts as still
_TAP_S = 0.3  # longest tap
_AGAIN_S = 0.3  # longest pause between two taps of a double tap
_AGAIN_UM = 15_000  # largest distance between the two taps of a double tap
_HOLD_S = 0.6  # shortest hold
_SWIPE_UM = 14_000  # least distance of a swipe
_SWIPE_S = 0.45  # longest duration of the movement of a swipe
_REST_S = 0.25  # least rest before a slide
_SQUEEZE_MN = 5_000  # least force of a squeeze
_SQUEEZE_S = 0.1  # least duration of this force
_KEPT = 4096  # largest number of stored readings of a touch
# Limits for `ContactTracker`, see `keys.layout`: largest movement of a finger between two
# readings, delay of a release, and time after which an object that does not move is no finger.
_TUNING = ["jump_um 12000", "release_ms 30", "stuck_ms 20000"]


class Gesture(NamedTuple):
    """A touch that was classified as a gesture.

    Attributes
    ----------
    name : str
        Name of the gesture, one of `NAMES`.
    confidence : float
        Confidence from 0 to 1: 0.5 if a measured value is at a limit of the gesture, more if all
        values are far from their limits.
    position_um, distance_um : int
        Position where the touch began, and distance from there to the last position, in um;
        a positive distance is away from the sensor. A double tap has the values of its second tap.
        Two fingers: position of the first finger, and distance that the second finger has moved.
    force_mN : int
        Largest force of the touch, in mN; for two fingers, force of the last reading.
    time_s : float
        `Touch.time_s` of the reading that completed the gesture, in seconds.
    """

    name: str
    confidence: float
    position_um: int
    distance_um: int
    force_mN: int
    time_s: float


class Gestures:
    """Classifies the touches of one strip as gestures.

    Parameters
    ----------
    length_um : int, optional
        Length of the strip in um; with 0, gestures of two fingers are not detected.
    decay : int, optional
        Decay of the light along the strip, caused by its dye, in log2 units per um, times 2**24.
        The board's reply to ``hello`` contains it. Used for gestures of two fingers; a typical
        value if not given.
    cross : sequence of int, optional
        Cross-sensitivity of the strip: the value of ``cross`` in the board's reply to ``hello``.

    Attributes
    ----------
    objects : int
        Number of times that an object instead of a finger was detected on the strip; the caller may
        set it to 0.
    """

    def __init__(
        self, length_um: int = 0, decay: int | None = None, cross: Sequence[int] | None = None
    ):
        self._two = TwoFingers(length_um, decay, cross) if length_um else None
        self._contact = ContactTracker(self)
        self._contact.set_layout(parse([*_TUNING, *default_lines()]), 0)
        self._found: list[Gesture] = []
        self._now_s = 0.0
        self._heard_s: float | None = None
        self._path: _Path | None = None  # None while no finger touches
        self._tap: Gesture | None = None  # waits for a second tap
        self.objects = 0

    def take(self, touch: Touch, now_s: float) -> list[Gesture]:
        """Add a reading, and return the gestures that are now complete.

        Parameters
        ----------
        touch : Touch
            The next reading of the strip.
        now_s : float
            Time at which the reading arrived, in seconds, by the same clock as in `tick`.

        Returns
        -------
        list of Gesture
            Complete gestures, oldest first; empty for most readings.
        """
        self.tick(now_s)
        if not touch.flags & LED_OFF:  # a reading with the LED off does not show a finger
            self._heard_s = now_s
        self._now_s = touch.time_s
        if self._two:
            self._take_two(self._two, touch)
        self._contact.take(*tracker_arguments(touch))
        if self._tap and not self._path and self._now_s - self._tap.time_s > _AGAIN_S:
            self._report_tap()
        found, self._found = self._found, []
        return found

    def _take_two(self, two: TwoFingers, touch: Touch) -> None:
        gesture = two.take(touch)
        if self._path and two.both:
            self._path.decided = True  # the measured position is between two fingers
        if gesture:
            self._report_tap()
            self._found.append(Gesture(*gesture, touch.integers[1], self._now_s))

    def tick(self, now_s: float) -> None:
        """Drop the touch and a pending tap if no reading arrives for `RELEASE_S` seconds.

        Readings with the LED off do not count. Call `tick` regularly.

        Parameters
        ----------
        now_s : float
            Present time in seconds, by the same clock as in `take`.
        """
        if self._heard_s is not None and now_s - self._heard_s > RELEASE_S:
            self._heard_s = None
            self.release()

    def release(self) -> None:
        """Ignore the present touch, and drop a tap that waits for a second tap."""
        self._contact.spend()
        if self._two:
            self._two.release()
        self._path = self._tap = None

    # Called by `ContactTracker`.

    def down(self, x_um: int, t: int) -> None:
        """Handle the start of a contact, see `spots_device.fingers.tracker.ContactTracker`.

        Parameters
        ----------
        x_um : int
            Position on the strip, in um.
        t : int
            Time, in ticks of `spots_device.fingers.tracker.TICK_US`.
        """
        self._path = _Path(self._now_s, x_um)
        self._path.decided = self._two is not None and self._two.both
        self.at(x_um, t)

    def at(self, x_um: int, t: int) -> None:
        """Handle a new position of a contact.

        Parameters
        ----------
        x_um : int
            Position on the strip, in um.
        t : int
            Time, in ticks of `spots_device.fingers.tracker.TICK_US`.
        """
        self._path.extend(self._now_s, x_um, self._contact.force_mN)
        if not self._path.decided:
            self._decide_early()

    def firm(self, t: int) -> None:
        pass

    def next(self, x_um: int, t: int) -> None:
        """Handle a jump from one finger to another: a contact ends, and a new contact begins.

        Parameters
        ----------
        x_um : int
            Position of the new contact on the strip, in um.
        t : int
            Time, in ticks of `spots_device.fingers.tracker.TICK_US`.
        """
        self.up(t)
        self.down(x_um, t)

    def up(self, t: int) -> None:
        if not self._path.decided:
            self._decide_late()
        self._path = None

    def stuck(self) -> None:
        self._path = None
        self.objects += 1

    # Classification.

    def _decide_early(self) -> None:
        """Detect the gestures that are complete before the touch ends: a squeeze or a long hold."""
        path = self._path
        still = path.spread_um <= _STILL_UM
        hard = still and path.force_mN >= _SQUEEZE_MN
        path.hard_since_s = min(path.hard_since_s, self._now_s) if hard else math.inf
        if self._now_s - path.hard_since_s >= _SQUEEZE_S:
            self._decide(SQUEEZE, above(path.hardest_mN, _SQUEEZE_MN), path.stillness)
        elif still and self._now_s - path.began_s >= 2 * _HOLD_S:
            self._decide(HOLD, 1.0, path.stillness)

    def _decide_late(self) -> None:
        """Classify a touch that has ended; drop a touch that fits no gesture."""
        path = self._path
        lasted_s, far_um = path.end_s - path.began_s, abs(path.moved_um)
        if path.spread_um <= _STILL_UM:
            if lasted_s >= _HOLD_S:
                self._decide(HOLD, above(lasted_s, _HOLD_S), path.stillness)
            elif lasted_s <= _TAP_S:
                self._tapped(self._gesture(TAP, below(lasted_s, _TAP_S), path.stillness))
        elif far_um > _STILL_UM and not (self._two and self._two.pair):  # one finger has moved
            away = path.moved_um > 0
            rested_s = path.left_s - path.began_s
            went_s = max(path.arrived_s() - path.left_s, 1e-3)
            if rested_s >= _REST_S:
                name = SLIDE_PLUS if away else SLIDE_MINUS
                self._decide(name, above(rested_s, _REST_S), above(far_um, _STILL_UM))
            elif far_um >= _SWIPE_UM and went_s <= _SWIPE_S:
                name = SWIPE_PLUS if away else SWIPE_MINUS
                quick = min(below(went_s, _SWIPE_S), below(rested_s, _REST_S))
                self._decide(name, above(far_um, _SWIPE_UM), quick)

    def _tapped(self, second: Gesture) -> None:
        first = self._tap
        if first and abs(second.position_um - first.position_um) <= _AGAIN_UM:
            self._tap = None
            sure = min(first.confidence, second.confidence)
            self._found.append(second._replace(name=DOUBLE_TAP, confidence=sure))
        else:
            self._report_tap()
            self._tap = second

    def _decide(self, name: str, *margins: float) -> None:
        self._path.decided = True
        self._report_tap()
        self._found.append(self._gesture(name, *margins))

    def _report_tap(self) -> None:
        if self._tap:
            self._found.append(self._tap)
            self._tap = None

    def _gesture(self, name: str, *margins: float) -> Gesture:
        path = self._path
        return Gesture(
            name, min(margins), path.begin_um, path.moved_um, path.hardest_mN, self._now_s
        )


class _Path:
    """Path of a finger, updated with each reading at constant cost.

    `left_s` is the time of the finger's departure from its first position. `hard_since_s` is the
    time at which a still finger began to press hard; infinity if it does not press hard. If
    `decided`, the path cannot give another gesture: it has given one, or two fingers touch.
    """

    def __init__(self, now_s: float, x_um: int):
        self.began_s = self.left_s = self.end_s = now_s
        self.begin_um = self.end_um = self._low_um = self._high_um = x_um
        self.force_mN = self.hardest_mN = 0
        self.hard_since_s = math.inf
        self.decided = self._left = False
        # The latest readings, enough for the longest swipe: 4 s at 1000 readings a second.
        self._lately: deque[tuple[float, int]] = deque(maxlen=_KEPT)

    def extend(self, now_s: float, x_um: int, force_mN: int) -> None:
        """Add a reading: time `now_s`, position `x_um`, force `force_mN`."""
        self.end_s, self.end_um, self.force_mN = now_s, x_um, force_mN
        self.hardest_mN = max(self.hardest_mN, force_mN)
        self._low_um, self._high_um = min(self._low_um, x_um), max(self._high_um, x_um)
        if not self._left:
            self.left_s = now_s
            self._left = abs(x_um - self.begin_um) > _STILL_UM / 2
        self._lately.append((now_s, x_um))

    @property
    def spread_um(self) -> int:
        """Distance between the lowest and the highest position, in um."""
        return self._high_um - self._low_um

    @property
    def moved_um(self) -> int:
        """Distance from the first to the last position in um; positive away from the sensor."""
        return self.end_um - self.begin_um

    @property
    def stillness(self) -> float:
        """Confidence that the finger did not move, from 0 to 1."""
        return below(max(self.spread_um, 1), _STILL_UM)

    def arrived_s(self) -> float:
        """Return the time in s of the last reading that is not near the path's end position."""
        away_s = (
            time_s
            for time_s, x_um in reversed(self._lately)
            if abs(x_um - self.end_um) > _STILL_UM / 2
        )
        return next(away_s, self._lately[0][0])
