"""Lets the simulated stage press the strip in a calibration session, in place of a person."""

from __future__ import annotations

import numpy as np

from spots.calibrate.presser import Presser
from spots.calibrate.presses import FIRM_MN
from spots.calibrate.session import Wanted
from spots.calibrate.spectra import SpectrumReader
from spots.link.board import Board

from .stage import Stage

_LEAST_STEP = 1.05  # relative error of the least force
_JOINT_SHARE = (0.1, 0.9)  # ends of the indenter's travel, as shares of the strip's length


class StagePresser(Presser):
    """Presses a simulated strip for a calibration session, see `spots.calibrate.presser`.

    Parameters
    ----------
    stage : Stage
        Stage with the simulated strip.
    """

    patience_s = 2.0
    steady = 1

    def __init__(self, stage: Stage):
        self._stage = stage

    def stretch(self, strain_ppm: int, length_um: float) -> None:
        self._stage.held.strain = strain_ppm * 1e-6

    def press(self, wanted: Wanted) -> None:
        if wanted.kind == "mark" and wanted.angle_deg is not None:
            wanted = self._turned(wanted.angle_deg, 1)
        self._stage.press(wanted.place_um, wanted.force_mN or FIRM_MN)

    def release(self) -> None:
        self._stage.release()

    def read_off(self, wanted: Wanted, length_um: float) -> Wanted:
        return wanted

    def dark(self, board: Board) -> None:
        self._stage.take_dark()

    def least_mN(self, wanted: Wanted, reader: SpectrumReader) -> float:
        low_mN, high_mN = 1.0, wanted.force_mN
        while high_mN > _LEAST_STEP * low_mN:
            middle_mN = (low_mN * high_mN) ** 0.5
            self._stage.press(wanted.place_um, middle_mN)
            if reader.read(8).dark:
                low_mN = middle_mN
            else:
                high_mN = middle_mN
        self._stage.release()
        return high_mN

    def turn(self, direction: int, share: float) -> Wanted:
        joint = self._stage.sensor.joint
        first_um, last_um = np.array(_JOINT_SHARE) * self._stage.length_um
        angle_deg = float(share * (last_um - first_um) / joint.um_per_deg)
        return self._turned(round(angle_deg, 3), direction)

    def _turned(self, angle_deg: float, direction: int) -> Wanted:
        joint = self._stage.sensor.joint
        first_um = _JOINT_SHARE[0] * self._stage.length_um
        place_um = first_um + joint.slid_um(angle_deg, direction)
        return Wanted(
            kind="joint",
            place_um=float(place_um),
            force_mN=joint.force_mN,
            angle_deg=angle_deg,
            direction=direction,
        )
