"""Changes a calibrated simulated strip, then corrects its calibration with presses (re-zero)."""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from msgspec.structs import replace
from rich.console import Console

from spots.calibrate.calibration_file import FINGER, INDENTER, CalibrationFile, Marks, now
from spots.calibrate.fit.presses import ALL_MARKS, FIRM_MN, MARKS
from spots.calibrate.session.bench import Bench
from spots.calibrate.session.guide import Guide
from spots.calibrate.session.judge import samples_of
from spots.calibrate.session.rezero import rezero
from spots.calibrate.session.spectra import DARK_S
from spots.errors import SettingError
from spots_device.sensor.exposure import DEFAULT_US

from ..person.kept import kept
from ..person.stage import Stage
from ..person.stage_presser import StagePresser
from ..strip.change import Change
from ..strip.files import SensorFile
from .rig import Rig

# Tremor of a resting finger as a share of its force, assumed. As in reality, it averages out the
# rounding of small counts.
_TREMOR = 0.02
_NOBODY = Path("characterize")  # stands for the calibration file in error messages


@dataclass(frozen=True)
class Hand:
    """Options of a re-zero: the person presses marked positions again to correct a calibration.

    `marks` is the number of marks, 0 for no re-zero; `presses` are those on each mark. `error_um`
    is the standard deviation of the position of such a press; the presses of the calibration have
    no position error. With `scale`, a scale shows the force of each press, so that the force is
    corrected too. With `by_hand`, a hand and not a stage presses the strip after the calibration.
    """

    marks: int = 0
    presses: int = 1
    error_um: float = 0.0
    scale: bool = False
    by_hand: bool = False

    def check(self) -> None:
        """Raise SettingError if `marks` or `error_um` is invalid."""
        if self.marks not in (0, 1, 3, 5, 9):
            raise SettingError(f"--rezero must be 0, 1, 3, 5 or 9 marks, not {self.marks}")
        if not 0 <= self.error_um < math.inf:
            raise SettingError(f"--mark-error-um must be 0 or more, not {self.error_um:g}")


NO_HAND = Hand()


class _ShakyPresser(StagePresser):
    def __init__(self, stage, error_um: float, rng):
        super().__init__(stage)
        self._error_um, self._rng = error_um, rng

    def press(self, wanted) -> None:
        off_um = self._error_um * self._rng.standard_normal()
        super().press(replace(wanted, place_um=wanted.place_um + off_um))


def silent_bench(stage: Stage, presser: StagePresser) -> Bench:
    """Return board, strip and presser for a re-zero that prints nothing."""
    guide = Guide(Console(file=io.StringIO()))
    return Bench(stage.reader, presser, guide, stage.length_um, _NOBODY)


@kept(tuple[str, ...])
def recalibrated(sensor: SensorFile) -> tuple[str, ...]:
    """Calibrate a simulated sensor, change the sensor, and correct the calibration (re-zero).

    The table ``[change]`` of the sensor file describes the change. A stage calibrates the strip,
    and a finger presses the marks of the re-zero. Returned are the text lines of the corrected
    calibration. SpotsError if the sensor's readings do not allow a calibration.
    """
    with Rig(sensor, 0, DEFAULT_US, 1) as rig:
        age(rig, sensor.change, Hand(len(MARKS), by_hand=True), 0)
        return rig.shifted_lines


def age(
    rig: Rig, change: Change, hand: Hand, seed: int, wear: Callable[[], None] = lambda: None
) -> str | None:
    """Change a calibrated strip, then correct its calibration with a few presses (re-zero).

    `wear` is called when the strip changes, after the marks of the calibration: it bends the strip,
    for example. Returned is a description of the drift; None without a re-zero.
    """
    if not hand.marks:
        wear()
        rig.stage.held.changed = change
        rig.stage.by_hand = hand.by_hand
        return None
    rig.stage.held.tremor = _TREMOR
    presser = _ShakyPresser(rig.stage, hand.error_um, np.random.default_rng((seed, 2)))
    bench, reader = silent_bench(rig.stage, presser), rig.stage.reader
    places_um = [share * rig.stage.length_um for share in ALL_MARKS]
    reader.set_up(dark_s=DARK_S)
    samples = samples_of("mark", rig.conditions.exposure_us)
    logs = rig.stage.read(places_um, [FIRM_MN], samples).logs
    marks = Marks(
        place_um=tuple(places_um), force_mN=FIRM_MN, logs=tuple(map(tuple, logs.tolist()))
    )
    made = CalibrationFile(
        date=now(),
        **rig.conditions._asdict(),
        presser=INDENTER,
        lines=rig.lines,
        marks=marks,
    )
    wear()
    rig.stage.held.changed = change
    rig.stage.by_hand = hand.by_hand
    force_mN = FIRM_MN if hand.scale else None
    presser = FINGER if hand.by_hand else INDENTER
    done = rezero(bench, made, hand.presses, hand.marks, force_mN, presser=presser).rezeros[-1]
    rig.stage.held.tremor = 0.0
    rig.shift(done.place_um, done.shifts)
    return done.drift
