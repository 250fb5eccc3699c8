"""Detects gestures of two fingers: both press harder, or one rests while the other slides.

The first finger must be alone for a moment before the second one touches. While both touch, their
positions are estimates, which are wrong if both fingers move. So a slide is checked after one
finger has lifted: the measured position of the other finger must agree with its last estimate.
"""

import math
from collections.abc import Sequence

from spots_device.fingers.contacts import CONFIRMED
from spots_device.reading.decode import LED_OFF, SATURATED

from ..advice.contact_finder import ContactFinder
from ..link.frames import Contact, Touch
from .margins import above, below

TWO_FINGER_SQUEEZE, ANCHOR_AND_SLIDE = "two_finger_squeeze", "anchor_and_slide"

_SETTLED_S = 0.15  # a shorter overlap, as in typing, is no gesture
_RISE = 1.6  # least ratio of the light in a squeeze to the light before it
# Largest shift of the measured position in a squeeze, as a share of the distance between fingers.
_SHIFT = 0.12
_SQUEEZE_S = 0.1  # least duration of a squeeze
_SLIDE_UM = 8_000  # least distance of a slide
_OFF_UM = 4_000  # largest position error of the finger that remains after a slide
_SIGMA_UM = 3_000  # estimates of a position with a larger standard deviation are not used
_SIGMAS = 4.0  # distance of a slide in standard deviations that gives a confidence of 0.5


class TwoFingers:
    """Detects gestures of two fingers in the readings of one strip.

    Decay and cross-sensitivity are those of `advice.contact_finder.ContactFinder`. `both` is
    whether two fingers have touched together for at least 0.15 s (longer than fingers overlap in
    typing), and at least one of them still touches. `pair` is None unless two fingers touch.
    """

    def __init__(
        self, length_um: int, decay: int | None = None, cross: Sequence[int] | None = None
    ):
        self._finder = ContactFinder(length_um, decay, cross)
        self.pair: _Pair | None = None
        self.both = False

    def take(self, touch: Touch) -> tuple[str, float, int, int] | None:
        """Add a reading; return the gesture that is now complete, or None.

        A gesture is a tuple: name, confidence, position of the first finger in um, and distance
        that the second finger has moved in um.
        """
        contacts = self._finder.take(touch)
        there = [one for one in contacts if not one.ended]
        pair = self.pair
        self.both = bool(there) and (self.both or (pair is not None and pair.settled))
        if pair is None or not pair.ids & {one.id for one in there}:
            self.pair = pair = _Pair(*there, touch.time_s or 0.0) if len(there) == 2 else None
        if pair is None or touch.flags & (LED_OFF | SATURATED):
            return None
        if len(there) == 2:
            return pair.extend(touch, *there)
        self.pair = None if there[0].state == CONFIRMED else pair
        return pair.slide(there[0]) if there[0].state == CONFIRMED else None

    def release(self) -> None:
        """Forget the fingers."""
        self._finder.release()
        self.pair, self.both = None, False


class _Pair:
    def __init__(self, first: Contact, second: Contact, now_s: float):
        self.ids = {first.id, second.id}
        self.settled = False  # whether both have touched for longer than fingers overlap in typing
        self._began_s = now_s
        self._first, self._from, self._to = first, second, second
        self._before: tuple[float, int] | None = None  # light (log2) and position before a squeeze
        self._hard_since_s = math.inf
        self._decided = False

    def extend(
        self, touch: Touch, first: Contact, second: Contact
    ) -> tuple[str, float, int, int] | None:
        """Add a reading of both fingers; return a squeeze if it is complete.

        `first` and `second` are the contacts of the fingers in this reading. The result is that of
        `TwoFingers.take`.
        """
        now_s, light = touch.time_s or 0.0, touch.brightness_q20 / (1 << 20)
        self.settled = now_s - self._began_s >= _SETTLED_S
        if self._decided or not self.settled or {first.id, second.id} != self.ids:
            return None
        x_um = touch.integers[0]
        if self._before is None:
            self._from = second
        if self._before is None or light < self._before[0]:
            self._before = light, x_um
        if second.sigma_um <= _SIGMA_UM:
            self._to = second
        apart_um = max(abs(self._from.position_um - self._first.position_um), 1.0)
        rise = 2 ** (light - self._before[0])
        shift = abs(x_um - self._before[1]) / apart_um
        if rise < _RISE or shift > _SHIFT:
            self._hard_since_s = math.inf
            return None
        self._hard_since_s = min(self._hard_since_s, now_s)
        if now_s - self._hard_since_s < _SQUEEZE_S:
            return None
        self._decided = True
        confidence = min(above(rise, _RISE), below(shift, _SHIFT))
        return TWO_FINGER_SQUEEZE, confidence, round(self._first.position_um), 0

    def slide(self, left: Contact) -> tuple[str, float, int, int] | None:
        """Return a slide if the remaining finger is where it was estimated, else None.

        `left` is the contact of this finger; the other finger has just lifted. The result is that
        of `TwoFingers.take`.
        """
        moved_um = self._to.position_um - self._from.position_um
        before = self._to if left.id == self._to.id else self._first
        off_um = abs(left.position_um - before.position_um)
        if self._decided or self._before is None or abs(moved_um) < _SLIDE_UM or off_um > _OFF_UM:
            return None
        confidence = min(
            above(abs(moved_um), _SLIDE_UM),
            below(off_um, _OFF_UM),
            above(abs(moved_um) / max(self._to.sigma_um, 1.0), _SIGMAS),
        )
        return ANCHOR_AND_SLIDE, confidence, round(self._first.position_um), round(moved_um)
