"""Writes ``build.md``: which rubbers to mix, and in which order to cast a number of strips.

Volumes are those of the mould's cavities (shape.py). Each statement has its source, or the
words *not tried*: nobody has cast a strip with these moulds yet.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from spots.common import atomic
from spots.errors import SettingError

from .shape import (
    BEYOND,
    CLEARANCE,
    LED_DIAMETER,
    TEST_LENGTH,
    StripShape,
    guide_mm3,
)

STRIPS_MAX = 100
KIND = atomic.begins("the instructions of a strip", b"# A strip of ")
SPARE = 0.3  # share of the cavities' volume for overflow and for parts that break; not tried
CUP_ML = 2.0  # volume of rubber that stays in the mixing cup; not tried
LEAST_ML = 15.0  # smaller amounts are hard to stir and to weigh; not tried
STEP_ML = 0.5
TINT_G = 100.0  # g of tint that are stirred at once
TINT_SHARE = 1e-3  # share of pigment paste in the tint
TEST_DOSE = 2.0  # g of tint in 100 g, for the first test piece


@dataclass(frozen=True)
class Rubber:
    """A castable rubber.

    `parts` has the volume share of each component, such as A and B. The density is assumed for
    every component; the maker's bulletin has the exact values.
    """

    name: str
    parts: dict[str, float]
    density_g_ml: float


GUIDE = Rubber("Clear Flex 50", {"A": 1 / 3, "B": 2 / 3}, 1.04)
SUPPORT = Rubber(
    "Dragon Skin 30 and Ecoflex 00-30",
    {
        "Dragon Skin 30 A": 1 / 3,
        "Dragon Skin 30 B": 1 / 3,
        "Ecoflex 00-30 A": 1 / 6,
        "Ecoflex 00-30 B": 1 / 6,
    },
    1.08,
)


@dataclass(frozen=True)
class Batch:
    """An amount of rubber that is mixed together, to fill cavities for parts of the strip."""

    what: str
    rubber: Rubber
    cavities_ml: float

    @property
    def mixed_ml(self) -> float:
        """Volume of rubber to mix, in ml: more than the cavities need, and at least `LEAST_ML`."""
        wanted = max(self.cavities_ml * (1 + SPARE) + CUP_ML, LEAST_ML)
        return math.ceil(wanted / STEP_ML) * STEP_ML

    @property
    def mixed_g(self) -> float:
        """Mass of rubber to mix, in g."""
        return self.mixed_ml * self.rubber.density_g_ml

    def portions(self) -> list[tuple[str, float, float]]:
        """Return name, volume in ml and mass in g of each component of the rubber."""
        density = self.rubber.density_g_ml
        return [
            (name, share * self.mixed_ml, share * self.mixed_ml * density)
            for name, share in self.rubber.parts.items()
        ]


def checked(strips: int) -> int:
    """Return the number of strips to cast; raise SettingError if the number is out of range."""
    if not 1 <= strips <= STRIPS_MAX:
        raise SettingError(f"--strips must be from 1 to {STRIPS_MAX}, not {strips}")
    return strips


def batches(shape: StripShape, strips: int) -> list[Batch]:
    """Return the amounts of rubber to mix for a number of strips, and for the two test pieces."""
    test_ml, guide_ml = guide_mm3(TEST_LENGTH) / 1000, shape.guide_mm3 / 1000
    return [
        Batch("clear guides and the clear test piece", GUIDE, strips * guide_ml + test_ml),
        Batch("dyed test piece", GUIDE, test_ml),
        Batch("dyed guides", GUIDE, strips * guide_ml),
        Batch("supports", SUPPORT, strips * shape.support_mm3 / 1000),
    ]


def consumption_g(shape: StripShape, strips: int) -> dict[str, float]:
    """Return the mass of each component that the recipe consumes, in g, with the tint of the dye.

    The tint in a batch replaces part B; so the sum is a little more than what is needed.
    """
    used = {"red pigment paste": TINT_G * TINT_SHARE, "B": TINT_G * (1 - TINT_SHARE)}
    for batch in batches(shape, strips):
        for name, _, mass_g in batch.portions():
            used[name] = used.get(name, 0.0) + mass_g
    return used


def tint_g(mixed_g: float, dose: float) -> float:
    """Return the mass of tint for tinted rubber; `dose` is g of tint in 100 g of it."""
    return mixed_g * dose / 100


def text(shape: StripShape, strips: int, dye_per_mm: float, command: str) -> str:
    """Return the build instructions as Markdown: the template ``build.md.in``, filled in.

    The instructions show the command line of the design with ``--measure-dye`` added. `dye_per_mm`
    is the designed decay coefficient.
    """
    mixed = batches(shape, strips)
    return (
        (Path(__file__).parent / "build.md.in")
        .read_text(encoding="utf-8")
        .format(
            length_mm=shape.length_mm,
            count="one" if strips == 1 else strips,
            strips=strips,
            breakout=shape.breakout,
            source=shape.board.source,
            rows="\n".join(_row(batch) for batch in mixed),
            spare=SPARE,
            cup_ml=CUP_ML,
            least_ml=LEAST_ML,
            guide_g_ml=GUIDE.density_g_ml,
            support_g_ml=SUPPORT.density_g_ml,
            dye_per_mm=dye_per_mm,
            pigment_g=TINT_G * TINT_SHARE,
            part_b_g=TINT_G * (1 - TINT_SHARE),
            consumed="\n".join(
                f"| {name if len(name) > 1 else f'{GUIDE.name} {name}'} | {mass_g:.3g} g |"
                for name, mass_g in sorted(consumption_g(shape, strips).items())
            ),
            test_mm=TEST_LENGTH,
            test_dose=TEST_DOSE,
            test_tint_g=tint_g(mixed[1].mixed_g, TEST_DOSE),
            command=command,
            film_mm=CLEARANCE,
            beyond_mm=BEYOND,
            led_mm=LED_DIAMETER,
        )
    )


def _row(batch: Batch) -> str:
    parts = ", ".join(f"{name}: {ml:.1f} ml, {g:.1f} g" for name, ml, g in batch.portions())
    cavities = f"{batch.cavities_ml:.2f} ml"
    return f"| {batch.what} | {cavities} | {batch.mixed_ml:g} ml, {batch.mixed_g:.1f} g | {parts} |"
