"""Finds fingers in readings on the host, with the firmware's code.

A contact is one finger in one reading.
"""

import math
from collections.abc import Sequence
from typing import Any

from spots_device.fingers import contacts as fingers
from spots_device.fingers.state import TICKS
from spots_device.fingers.tracker import TICK_US
from spots_device.keys.layout import (
    default_lines,
    parse,  # pyright: ignore[reportUnknownVariableType]
)
from spots_device.reading.decode import (
    BRIGHTNESS,
    DROPPED,
    FORCE_MN,
    POSITION_UM,
)

from ..link.frames import Contact, Touch

TYPICAL_DECAY = 289  # log2 units per um, times 2**24; for boards that do not report the decay


def tracker_arguments(touch: Touch) -> tuple[int, int, int, int, int]:
    """Convert a reading to the arguments of `ContactTracker.take` and `Keypad.take`.

    These are: flags, position in um, force in mN, brightness times 2**20, time in units of
    `TICK_US`. The flag `DROPPED` is cleared, because these methods get no such flag on a board.
    """
    t = touch.t_us // TICK_US % TICKS
    return touch.flags & ~DROPPED, *touch.integers, touch.brightness_q20, t


class ContactFinder:
    """Finds one or two fingers in the readings of a strip, as the firmware does for CONTACT frames.

    The arguments are from the board's reply to ``hello``. `decay` is the attenuation of the light
    by the dye in log2 units per um, times 2**24; without it, or if it is 0, a typical value is
    used. `cross` is the cross-sensitivity of the strip.
    """

    def __init__(
        self, length_um: int, decay: int | None = None, cross: Sequence[int] | None = None
    ):
        self._fingers: Any = fingers.Fingers(self)
        self._tracker: Any = self._fingers.tracker
        self._tracker.set_layout(
            parse(["stuck_ms 0", *default_lines()]), length_um, decay or TYPICAL_DECAY, cross
        )
        self._found: list[Contact] = []
        self._touch: Touch | None = None

    def take(self, touch: Touch) -> list[Contact]:
        """Add a reading, and return a contact for each finger; see `Board.contacts`."""
        self._touch, self._found = touch, []
        flags, position_um, force_mN, brightness, t = tracker_arguments(touch)
        self._tracker.take(flags, position_um, force_mN, brightness, t)
        reading = {POSITION_UM: position_um, FORCE_MN: force_mN, BRIGHTNESS: brightness}
        self._fingers.send(touch.sensor, reading)
        return self._found

    def release(self) -> None:
        """Forget the fingers; those that still touch are ignored until they are lifted."""
        self._fingers.release()

    def contact(
        self, sensor: int, number: int, state: int, x_um: int, sigma_um: int, force_mN: int
    ) -> None:
        """Handle a contact that `spots_device.fingers.contacts.Fingers` sends; force 0: unknown."""
        touch = self._touch
        if touch is not None:
            force = force_mN or math.nan
            place = number, state, x_um, sigma_um, force
            self._found.append(Contact(sensor, touch.sequence, touch.t_us, *place, touch.time_s))
