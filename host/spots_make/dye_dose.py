"""``spots design --measure-dye``: computes the dose of dye from a clear and a dyed test piece.

Both pieces have the same length and are put between LED and sensor, one after the other. One piece
may be coupled better to LED and sensor than the other. So the ratio of their counts is the decay by
the dye times an unknown factor. This factor is the same for all channels, so only differences
between channels are used. The result is the dye strength whose decay (`optics`, Eq. 1 of the paper)
fits these differences best. A dye's strength is proportional to its dose, so the dose that gives
the wanted strength can be computed.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from spots.calibrate.session.dark import take_dark
from spots.calibrate.session.guide import Guide
from spots.calibrate.session.spectra import SpectrumReader
from spots.errors import CalibrationError
from spots.link.connect import open_named
from spots_sim.demo.virtual import VIRTUAL
from spots_sim.person.stage import Stage
from spots_sim.strip.change import NONE, Change
from spots_sim.strip.defaults import given
from spots_sim.strip.files import SensorFile, load
from spots_sim.strip.optics import Optics
from spots_sim.strip.scenario import Press

from .design import design
from .recipe import (
    TINT_SHARE,
    batches,
    checked,
    tint_g,
)
from .shape import StripShape, has_moulds

_SAMPLES = 64  # averaged for each piece
_AUTO_TIMEOUT_S = 60.0
_STRENGTHS_PER_MM = 1e-4, 1.0
_USUAL_PER_MM = 0.02  # strength of a red dye, to detect a colour change in the wrong direction
# Least difference between channels, in units of ln; the contact of the pieces can cause less.
_LEAST_DECAY = 0.05
_MISFIT_MAX = 0.1  # rms in units of ln; above this, the dye has another colour
_DOSES = 1e-3, 60.0  # g of tint in 100 g; more would replace all of the rubber's part B
_FULL_PRESS_MN = 1e6  # couples all light, as a test piece between LED and sensor does
_CLEAR = Change(dye_percent=-100.0)


@dataclass(frozen=True)
class Measured:
    """Strength of a test piece's dye.

    `per_mm` is a decay coefficient, as `files.Dye.strength_per_mm`. `misfit` is the root mean
    square of the differences from the fit, which uses natural logarithms of counts.
    """

    per_mm: float
    misfit: float


def strength(
    sensor: SensorFile, length_mm: float, plan: Sequence[str], clear: ArrayLike, dyed: ArrayLike
) -> Measured:
    """Compute the strength of a test piece's dye from counts through it and through a clear piece.

    The counts, shape (6,), are dark-subtracted. `sensor` has the spectra of LED and dye; its dye
    strength is ignored. CalibrationError if a channel is dark, the pieces differ too little or were
    swapped, or the dye is not red.
    """
    clear, dyed = np.asarray(clear, dtype=float), np.asarray(dyed, dtype=float)
    for name, counts in (("clear", clear), ("dyed", dyed)):
        if counts.min() < 1:
            dark = plan[int(counts.argmin())]
            less_dye = ", or cast it with a smaller dose" if name == "dyed" else ""
            raise CalibrationError(
                f"channel {dark} is dark through the {name} test piece: push the piece against LED "
                f"and chip, or cast both pieces shorter{less_dye}"
            )
    columns = [Optics.names.index(name) for name in plan]
    seen = _even(np.log(dyed / clear))
    if np.ptp(seen) < _LEAST_DECAY:
        raise CalibrationError(
            "both test pieces have the same colour: insert the dyed piece when asked, or cast it "
            "with more dye"
        )

    def decay(per_mm: float) -> np.ndarray:
        dye = msgspec.structs.replace(sensor.dye, strength_per_mm=per_mm)
        rates = Optics(msgspec.structs.replace(sensor, dye=dye)).press(length_mm, 0.0)
        return np.log(rates[columns])

    without = decay(0.0)
    if (_even(decay(_USUAL_PER_MM) - without) * seen).sum() < 0:
        raise CalibrationError(
            "the dyed test piece is bluer than the clear one: the dyed piece was put in first, or "
            "its dye is not red; start again"
        )

    def misfit(per_mm: float) -> float:
        return float(np.sqrt(np.mean((_even(decay(per_mm) - without) - seen) ** 2)))

    low, high = _STRENGTHS_PER_MM
    while high > 1.0001 * low:
        tried = np.geomspace(low, high, 25)
        best = int(np.argmin([misfit(one) for one in tried]))
        low, high = tried[max(best - 1, 0)], tried[min(best + 1, len(tried) - 1)]
    found = math.sqrt(low * high)
    return Measured(found, misfit(found))


def _even(logs: np.ndarray) -> np.ndarray:
    return logs - logs.mean()


def dose(test_dose: float, measured_per_mm: float, wanted_per_mm: float) -> float:
    """Return the dose of tint that gives the dye a wanted strength.

    Doses are in g of tint in 100 g of rubber. CalibrationError if the dose is out of range: then a
    tint with more or less pigment is needed.
    """
    found = test_dose * wanted_per_mm / measured_per_mm
    low, high = _DOSES
    if not low <= found <= high:
        change = "more" if found > high else "less"
        raise CalibrationError(
            f"the dose would be {found:.3g} g of tint in 100 g of rubber, but it must be "
            f"{low:g} to {high:g} g: make a tint with {change} pigment "
            f"(the present tint has {TINT_SHARE:.1%}), and cast another test piece"
        )
    return found


def read_pieces(
    reader: SpectrumReader, ask: Callable[[str], str], dark: Callable[[], object]
) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Ask for the clear and the dyed test piece, and read both with the same settings.

    ``ask(text)`` returns when the user has confirmed a request. `dark` takes a dark frame; it is
    called only if the LED is always on: then the board takes none itself. Returned are the names of
    the channels, and dark-subtracted counts through each piece, shape (6,). CalibrationError if a
    piece saturates the sensor.
    """
    counts = []
    for piece in ("clear", "dyed"):
        ask(f"put the {piece} test piece between the caps, then press Enter: ")
        if piece == "clear":
            reader.board.command("autoexpose", timeout_s=_AUTO_TIMEOUT_S)
            if reader.info.get("led") == "always":
                dark()
            reader.set_up()
        reading = reader.read(_SAMPLES)
        if reading.saturated:
            raise CalibrationError(
                f"the {piece} test piece saturates the sensor: start again with the clear piece, "
                "and push each piece against LED and chip before you press Enter"
            )
        counts.append(reading.counts)
    return reader.conditions.plan, *counts


def measure_dye_command(options: argparse.Namespace) -> None:
    """Run ``spots design --measure-dye`` with the options that `cli` parsed."""
    options = given(options)
    strips = checked(options.strips)
    sensor = load(SensorFile, options.sensor)
    wanted = design(options.length_mm, options.resolution_um, options.rate_hz).dye_per_mm
    guide = Guide()
    # A simulated stage changes the pieces of a virtual board.
    with (_simulated if options.port == VIRTUAL else _by_hand)(options, sensor, guide) as pieces:
        found = strength(sensor, options.test_length_mm, *read_pieces(*pieces))
    amount = dose(options.test_dose, found.per_mm, wanted)
    if options.json:
        summary = {
            "measured_per_mm": round(found.per_mm, 5),
            "misfit": round(found.misfit, 4),
            "wanted_per_mm": round(wanted, 5),
            "dose_g_per_100g": round(amount, 3),
        }
        print(json.dumps(summary))
    else:
        print(f"test piece   {found.per_mm:.3g} per mm with {options.test_dose:g} g in 100 g")
        print(f"wanted       {wanted:.3g} per mm for {options.length_mm:g} mm")
        print(f"dose         {amount:.3g} g of tint in 100 g")
        if has_moulds(options.length_mm):
            guides = batches(StripShape(options.length_mm), strips)[2]
            tint = tint_g(guides.mixed_g, amount)
            print(
                f"dyed guides  {guides.mixed_g:.1f} g with {tint:.2f} g of tint, and {tint:.2f} g "
                "less of part B"
            )
    if found.misfit > _MISFIT_MAX:
        print(
            f"the colour differs from the assumed red dye (misfit {found.misfit:.2f}): the dose is "
            "only approximate; cast a test piece with this dose and measure again",
            file=sys.stderr,
        )


@contextmanager
def _by_hand(options: argparse.Namespace, sensor: SensorFile, guide: Guide) -> Iterator[tuple]:
    with open_named(options) as board:
        reader = SpectrumReader(board)
        yield reader, guide.ask, partial(take_dark, board, guide.ask)
        reader.restore()


@contextmanager
def _simulated(options: argparse.Namespace, sensor: SensorFile, guide: Guide) -> Iterator[tuple]:
    with Stage(sensor, options.seed) as stage:

        def put(text: str) -> None:
            guide.say(text)
            stage.held.changed = _CLEAR if "clear" in text else NONE
            stage.held.press = Press(options.test_length_mm, _FULL_PRESS_MN, 0.0)

        yield stage.reader, put, stage.take_dark
