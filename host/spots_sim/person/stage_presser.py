"""Lets the simulated stage press the strip in a calibration session, in place of a person."""

from __future__ import annotations

from spots.calibrate.calibration_file import FINGER
from spots.calibrate.calibration_file import Presser as Kind
from spots.calibrate.fit.points import Wanted
from spots.calibrate.fit.presses import FIRM_MN
from spots.calibrate.session.presser import Presser
from spots.calibrate.session.spectra import SpectrumReader
from spots.link.board import Board

from .stage import Stage

_LEAST_STEP = 1.05  # the search ends when the limits of the force differ by less than this factor


class StagePresser(Presser):
    """Presses a simulated strip in a calibration session, see `spots.calibrate.session.presser`."""

    patience_s = 2.0
    steady = 1

    def __init__(self, stage: Stage):
        self._stage = stage

    def stretch(self, strain_ppm: int, length_um: float) -> None:
        self._stage.held.strain = strain_ppm * 1e-6

    def press(self, wanted: Wanted) -> None:
        if wanted.angle_deg is None:
            finger = wanted.kind == "mark" and not wanted.force_mN
            self._stage.press(wanted.place_um, wanted.force_mN or FIRM_MN, finger)
        else:
            self._stage.turn(wanted.angle_deg, wanted.direction or 1)

    def change(self, wanted: Wanted) -> None:
        self._stage.press(wanted.place_um, wanted.then_mN)

    def release(self) -> None:
        self._stage.release()

    def read_off(self, wanted: Wanted, length_um: float) -> Wanted:
        return wanted

    def next_presser(self) -> Kind | None:
        return FINGER

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
        sensor = self._stage.sensor
        angle_deg = round(float(share * sensor.joint_travel_deg), 3)
        return Wanted(
            kind="joint",
            place_um=sensor.indenter_um(angle_deg, direction),
            force_mN=sensor.joint.force_mN,
            angle_deg=angle_deg,
            direction=direction,
        )
