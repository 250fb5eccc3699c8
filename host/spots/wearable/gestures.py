"""Touches to gestures, with a confidence, for a strip that is worn.

Everything is relative to the touch itself (how far, how long, how much harder), for on an arm that
bends and stretches places and forces are less certain than on a desk.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from spots_device.contact import TICK_US, TICKS, Contact
from spots_device.decode import DROPPED, LED_OFF
from spots_device.layout import Layout, default_lines

from ..link.frames import Touch
from ..link.timeouts import RELEASE_S

TAP, DOUBLE_TAP, HOLD = "tap", "double_tap", "hold"
SQUEEZE = "squeeze"
SWIPE_MINUS, SWIPE_PLUS = "swipe_minus", "swipe_plus"  # to the sensor, and away from it
SLIDE_MINUS, SLIDE_PLUS = "slide_minus", "slide_plus"  # after a rest: press and slide
NAMES = (
    TAP, DOUBLE_TAP, HOLD, SQUEEZE, SWIPE_MINUS, SWIPE_PLUS, SLIDE_MINUS, SLIDE_PLUS
)  # fmt: skip

_STILL_UM = 4_000  # within so much a finger stays where it is
_TAP_S = 0.3  # a longer touch is no tap
_AGAIN_S = 0.3  # a second tap comes within this
_AGAIN_UM = 15_000  # and not farther off than this
_HOLD_S = 0.6
_SWIPE_UM = 14_000
_SWIPE_S = 0.45
_REST_S = 0.25  # a finger that rests so long before it moves presses and slides
_SQUEEZE_MN = 5_000
_SQUEEZE_S = 0.1
_KEPT = 4096  # readings of a touch
# Half as sure where a measure is at its limit; 88 % where it is a quarter beyond.
_STEEPNESS = 8.0
_TUNING = ["jump_um 12000", "release_ms 30", "stuck_ms 20000"]


class Gesture(NamedTuple):
    """A classified touch.

    Attributes
    ----------
    name : str
        One of `NAMES`.
    confidence : float
        0 to 1: how far the measured values lie from the limits to another gesture; 0.5 at a limit.
    position_um, distance_um : int
        Where it began, and how far it moved away from the sensor.
    force_mN : int
        At its hardest.
    time_s : float
        Host time of the reading that decided it.
    """

    name: str
    confidence: float
    position_um: int
    distance_um: int
    force_mN: int
    time_s: float


class Gestures:
    """Classifies touches; takes every reading of one strip.

    Attributes
    ----------
    rests : int
        How often an object that is not a finger was found on the strip.
    """

    def __init__(self):
        self._contact = Contact(self)
        self._contact.set_layout(Layout([*_TUNING, *default_lines()]), 0)
        self._found: list[Gesture] = []
        self._now_s = 0.0
        self._heard_s: float | None = None
        self._path: _Path | None = None  # while a finger is there
        self._decided = False
        self._hard_since_s: float | None = None
        self._tap: Gesture | None = None
        self.rests = 0

    @property
    def touching(self) -> bool:
        """Whether a finger is on the strip."""
        return self._path is not None

    def take(self, touch: Touch, now_s: float) -> list[Gesture]:
        """Take a reading and return the gestures that are complete.

        Parameters
        ----------
        touch : Touch
            The readings of one strip, in order.
        now_s : float
            When it arrived, in seconds by the clock of `tick`.

        Returns
        -------
        list of Gesture
        """
        self.tick(now_s)
        if not touch.flags & LED_OFF:  # a reading with the LED off sees no finger
            self._heard_s = now_s
        self._now_s = touch.time_s
        t = touch.t_us // TICK_US % TICKS
        flags = touch.flags & ~DROPPED
        self._contact.take(flags, touch.position_um, touch.force_mN, touch.brightness_q20, t)
        if self._tap and not self.touching and self._now_s - self._tap.time_s > _AGAIN_S:
            self._found.append(self._tap)
            self._tap = None
        found, self._found = self._found, []
        return found

    def tick(self, now_s: float) -> None:
        """Drop the touch and what is pending if no reading has come for `RELEASE_S`."""
        if self._heard_s is not None and now_s - self._heard_s > RELEASE_S:
            self._heard_s = None
            self.release()

    def release(self) -> None:
        """Drop the touch and the tap that waits for a second one."""
        self._contact.spend()
        self._path = None
        self._tap = None

    # Called by the contact.

    def down(self, x_um: int, t: int) -> None:
        """Take the start of a contact, as `spots_device.contact.Contact` reports it.

        Parameters
        ----------
        x_um : int
            Place on the strip, in um.
        t : int
            Time in ticks of the contact.
        """
        self._path = _Path(self._now_s, x_um)
        self._decided = False
        self._hard_since_s = None
        self.at(x_um, t)

    def at(self, x_um: int, t: int) -> None:
        """Take a place of a contact that lasts.

        Parameters
        ----------
        x_um : int
            Place on the strip, in um.
        t : int
            Time in ticks of the contact.
        """
        self._path.extend(self._now_s, x_um, self._contact.force_mN)
        if not self._decided:
            self._decide_early()

    def firm(self, t: int) -> None:
        pass

    def next(self, x_um: int, t: int) -> None:
        """Take another finger: the contact ends, and the next one begins.

        Parameters
        ----------
        x_um : int
            Place on the strip, in um.
        t : int
            Time in ticks of the contact.
        """
        self.up(t)
        self.down(x_um, t)

    def up(self, t: int) -> None:
        if not self._decided:
            self._decide_late()
        self._path = None

    def stuck(self) -> None:
        self._path = None
        self.rests += 1

    # Classification.

    def _decide_early(self) -> None:
        """Decide on a squeeze or a hold while the finger is still there."""
        path = self._path
        still = path.spread_um <= _STILL_UM
        if not (still and path.force_mN >= _SQUEEZE_MN):
            self._hard_since_s = None
        elif self._hard_since_s is None:
            self._hard_since_s = self._now_s
        elif self._now_s - self._hard_since_s >= _SQUEEZE_S:
            self._decide(SQUEEZE, _above(path.hardest_mN, _SQUEEZE_MN), self._certainly_still())
        if not self._decided and still and self._now_s - path.began_s >= 2 * _HOLD_S:
            self._decide(HOLD, 1.0, self._certainly_still())

    def _decide_late(self) -> None:
        path = self._path
        lasted_s = path.end_s - path.began_s
        if path.spread_um > _STILL_UM and abs(path.moved_um) > _STILL_UM:
            rested_s = path.left_s - path.began_s
            went_s = max(path.arrived_s() - path.left_s, 1e-3)
            away, far_um = path.moved_um > 0, abs(path.moved_um)
            if rested_s >= _REST_S:
                name = SLIDE_PLUS if away else SLIDE_MINUS
                self._decide(name, _above(rested_s, _REST_S), _above(far_um, _STILL_UM))
            elif far_um >= _SWIPE_UM and went_s <= _SWIPE_S:
                name = SWIPE_PLUS if away else SWIPE_MINUS
                quick = min(_below(went_s, _SWIPE_S), _below(rested_s, _REST_S))
                self._decide(name, _above(far_um, _SWIPE_UM), quick)
            return  # a finger that wandered is no gesture
        if path.spread_um > _STILL_UM:
            return
        if lasted_s >= _HOLD_S:
            self._decide(HOLD, _above(lasted_s, _HOLD_S), self._certainly_still())
        elif lasted_s <= _TAP_S:
            self._tapped(_below(lasted_s, _TAP_S))

    def _tapped(self, short: float) -> None:
        first = self._tap
        gesture = self._gesture(TAP, short, self._certainly_still())
        if first and abs(gesture.position_um - first.position_um) <= _AGAIN_UM:
            self._tap = None
            sure = min(first.confidence, gesture.confidence)
            self._found.append(gesture._replace(name=DOUBLE_TAP, confidence=sure))
            return
        if first:
            self._found.append(first)
        self._tap = gesture

    def _decide(self, name: str, *margins: float) -> None:
        self._decided = True
        if self._tap:
            self._found.append(self._tap)
            self._tap = None
        self._found.append(self._gesture(name, *margins))

    def _gesture(self, name: str, *margins: float) -> Gesture:
        path = self._path
        return Gesture(
            name, min(margins), path.begin_um, path.moved_um, path.hardest_mN, self._now_s
        )

    def _certainly_still(self) -> float:
        return _below(max(self._path.spread_um, 1), _STILL_UM)


class _Path:
    """The path of a finger; what is needed at every reading is stored, not searched for.

    Attributes
    ----------
    began_s, left_s, end_s : float
        When it came down, left that place (or has not yet), and was last seen.
    begin_um, end_um : int
        Where.
    force_mN, hardest_mN : int
        Now, and at most.
    """

    def __init__(self, now_s: float, x_um: int):
        self.began_s = self.left_s = self.end_s = now_s
        self.begin_um = self.end_um = self._low_um = self._high_um = x_um
        self.force_mN = self.hardest_mN = 0
        self._left = False
        # A finger that was swiped rests for less than these: 4 s at 1000 readings a second.
        self._lately: deque[tuple[float, int]] = deque(maxlen=_KEPT)

    def extend(self, now_s: float, x_um: int, force_mN: int) -> None:
        """Take a reading."""
        self.end_s, self.end_um, self.force_mN = now_s, x_um, force_mN
        self.hardest_mN = max(self.hardest_mN, force_mN)
        self._low_um, self._high_um = min(self._low_um, x_um), max(self._high_um, x_um)
        if not self._left:
            self.left_s = now_s
            self._left = abs(x_um - self.begin_um) > _STILL_UM / 2
        self._lately.append((now_s, x_um))

    @property
    def spread_um(self) -> int:
        """How far apart the places are that it was at."""
        return self._high_um - self._low_um

    @property
    def moved_um(self) -> int:
        """How far it has gone, away from the sensor if positive."""
        return self.end_um - self.begin_um

    def arrived_s(self) -> float:
        """Return when it came to where it is now, or the longest ago that is known."""
        away_s = (
            time_s
            for time_s, x_um in reversed(self._lately)
            if abs(x_um - self.end_um) > _STILL_UM / 2
        )
        return next(away_s, self._lately[0][0])


def _above(value: float, limit: float) -> float:
    return 1 / (1 + math.exp(-_STEEPNESS * (value / limit - 1)))


def _below(value: float, limit: float) -> float:
    return 1 / (1 + math.exp(_STEEPNESS * (value / limit - 1)))
