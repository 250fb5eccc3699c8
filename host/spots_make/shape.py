"""Dimensions of a strip and its caps, from which moulds, drawings and recipe are made.

The cross-section is that of the SPOTS paper (section II.B): a strip 3 mm thick and 12 mm wide with
two guides of 8 x 1 mm in a support. Nobody has tried the dimensions that the paper does not give; a
comment marks them *not tried*. All lengths are in mm.

The cross-section, with the air gap that a press closes; the rest is the support::

    +--+================+--+   clear guide, flush with the upper face
    |  +--+          +--+  |   air gap; ledges of the support on both sides keep the guides apart
    +--+================+--+   dyed guide, flush with the lower face

Mould faces have a draft, so each width is measured on the wider side: the outer face of a guide,
the upper side of the support.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from spots.errors import SettingError, did_you_mean

# From the paper, section II.B and III.B.
STRIP_WIDTH, STRIP_THICKNESS = 12.0, 3.0
GUIDE_WIDTH, GUIDE_THICKNESS = 8.0, 1.0
LENGTHS_MM = 30.0, 200.0  # paper, section III.A

# Not tried: everything below.
GAP_WIDTH = 6.0  # leaves ledges of 1 mm under the guides
END_LENGTH = 4.0  # length of the support beyond the gap at each end; a cap covers it
DRAFT_DEG = 1.0
TEST_LENGTH = 60.0  # length of the test piece for the dye
BED = 220.0  # side of the printer's bed

FLOOR, END_WALL, LID = 3.0, 3.0, 3.0  # thicknesses of a mould
# The groove takes overflowing rubber; the land is the flat between cavity and groove.
LAND, GROOVE_WIDTH, GROOVE_DEPTH = 2.0, 2.0, 1.0
PIN_FOOT, PIN_TOP, PIN_HEIGHT, PIN_HOLE = 4.0, 3.0, 2.5, 4.4  # diameters and height
PIN_INSET = 4.0  # from the long edge to the axis of a pin
SIDE_WALL = LAND + GROOVE_WIDTH + 2 * PIN_INSET
MIDDLE_WALL = 2 * LAND + GROOVE_WIDTH

CLEARANCE = 0.2  # at each side of a part in a printed pocket
CAP_WALL, SEPTUM = 2.0, 1.2  # outer wall of a cap; wall between the strip and the breakout
PARTS_HEIGHT = 4.0  # room for the parts of a breakout; connectors are 3 mm high
CHIP_HEIGHT, CHIP_GAP = 1.0, 0.5  # height of the AS7341, and gap between it and the guide's end
# From the breakout to the nose, a tube around the end of the guide. Parts beside the chip are up to
# 1.5 mm high.
NOSE_GAP = CHIP_HEIGHT + 0.6
NOSE_WALL = 1.0
POST = 5.0, 4.0  # the corners of the breakout rest on posts
PCB, BACK = 1.6, 2.0  # thickness of a breakout, and room for solder and foam behind it
LID_PLUG, LID_PLATE = 1.0, 2.0
CABLE_NOTCH = 8.0
LED_DIAMETER, LED_DEPTH = 5.0, 9.0  # a round LED of 5 mm
RAIL = 1.0  # height and width of the rails on the base
TONGUE_WIDTH, TONGUE_HEIGHT = 8.0, 6.0

SLOPE = math.tan(math.radians(DRAFT_DEG))


@dataclass(frozen=True)
class Breakout:
    """Outline of a breakout with an AS7341, from the maker's file `source`.

    The centre of the chip's window is counted from the lower left corner.
    """

    width_mm: float
    height_mm: float
    window_mm: tuple[float, float]
    source: str


BREAKOUTS = {
    "adafruit-4698": Breakout(
        25.4, 17.78, (12.7, 9.18), "Adafruit_AS7341.brd, github.com/adafruit/Adafruit-AS7341-PCB"
    ),
    "sparkx-17719": Breakout(
        31.75,
        31.75,
        (16.51, 17.18),
        "Qwiic_Spectral_Sensor_AS7341.brd, github.com/sparkfunX/Qwiic_Spectral_Sensor-AS7341",
    ),
}


@dataclass(frozen=True)
class StripShape:
    """Dimensions of one strip, in mm.

    `length_mm` is that of the part that senses a finger: of the air gap between the caps.
    `breakout` is a key of `BREAKOUTS`.
    """

    length_mm: float
    breakout: str = "adafruit-4698"

    def __post_init__(self):
        if not has_moulds(self.length_mm):
            low, high = LENGTHS_MM
            raise SettingError(
                f"moulds are for strips of {low:g} to {high:g} mm, not {self.length_mm:g} mm"
            )
        if self.breakout not in BREAKOUTS:
            raise SettingError(
                f"--breakout: there is no '{self.breakout}': "
                f"{did_you_mean(self.breakout, BREAKOUTS)}"
            )

    @property
    def board(self) -> Breakout:
        """Outline of the AS7341 breakout that the cap is made for."""
        return BREAKOUTS[self.breakout]

    @property
    def support_mm(self) -> float:
        """Length of the black support in mm: the air gap, and the two ends inside the caps."""
        return self.length_mm + 2 * END_LENGTH

    @property
    def guide_mm(self) -> float:
        """Length of a light guide in mm; it reaches through the wall of one cap."""
        return self.support_mm + BEYOND

    @property
    def base_mm(self) -> float:
        """Height in mm of the strip's lower face above the table on which the sensor cap stands."""
        return (
            self.board.window_mm[1]
            + CLEARANCE
            + CAP_WALL
            - GUIDE_THICKNESS / 2  # from the guide's middle to its lower face
        )

    @property
    def guide_mm3(self) -> float:
        """Volume of a light guide in mm3."""
        return guide_mm3(self.guide_mm)

    @property
    def support_mm3(self) -> float:
        """Volume of the black support in mm3."""

        def area(z: float) -> float:
            below_top = STRIP_THICKNESS - z
            width = STRIP_WIDTH - 2 * SLOPE * below_top
            length = self.support_mm - 2 * SLOPE * below_top
            if GUIDE_THICKNESS < z < STRIP_THICKNESS - GUIDE_THICKNESS:
                z -= GUIDE_THICKNESS
                return width * length - (GAP_WIDTH - 2 * SLOPE * z) * (
                    self.length_mm - 2 * SLOPE * z
                )
            # The core of the upper pocket, on the lid, has clearance at both ends.
            free = 2 * CLEARANCE if z > STRIP_THICKNESS / 2 else 0.0
            return width * length - (GUIDE_WIDTH - 2 * SLOPE * min(z, below_top)) * (length - free)

        edges = 0.0, GUIDE_THICKNESS, STRIP_THICKNESS - GUIDE_THICKNESS, STRIP_THICKNESS
        return sum(_simpson(area, low, high) for low, high in zip(edges, edges[1:]))


def has_moulds(length_mm: float) -> bool:
    """Return whether moulds can be made for a strip that is `length_mm` long."""
    low, high = LENGTHS_MM
    return low <= length_mm <= high


# Length of a guide beyond the support: through the cap's wall and nose to the chip or the LED.
BEYOND = SEPTUM + PARTS_HEIGHT - CHIP_HEIGHT - CHIP_GAP
TEST_JIG = TEST_LENGTH - 2 * BEYOND  # the test piece extends beyond the jig at both ends


def guide_mm3(length_mm: float) -> float:
    """Return the volume of a guide in mm3, for its length in mm."""

    def area(z: float) -> float:
        return (GUIDE_WIDTH - 2 * SLOPE * z) * (length_mm - 2 * SLOPE * z)

    return _simpson(area, 0.0, GUIDE_THICKNESS)


def _simpson(area: Callable[[float], float], low: float, high: float) -> float:
    """Return the integral of a quadratic `area` from `low` to `high`, by Simpson's rule (exact)."""
    # Evaluated just inside the limits, because the area jumps at a ledge.
    inside = (high - low) * 1e-9
    ends = area(low + inside) + area(high - inside)
    return (ends + 4 * area((low + high) / 2)) * (high - low) / 6
