"""Re-zero of a strip whose colour depends on the force: light presses do as well as firm ones."""

from pathlib import Path

import numpy as np
import pytest
from support.press_model import Strip, has_cross

from evidence.effects import with_keys
from spots.calibrate.calibration_file import CalibrationFile, Marks, now
from spots.calibrate.fit.cross_lines import CrossLines
from spots.calibrate.fit.decoded import Decoded
from spots.calibrate.fit.presses import FIRM_MN, MARKS
from spots.calibrate.session.joint import fit_joint
from spots.calibrate.session.make import _joint
from spots.calibrate.session.rezero import rezero
from spots.calibrate.session.session_file import Session
from spots_device.reading.calibration import Calibration
from spots_sim.measure.rezeroed import silent_bench
from spots_sim.measure.rig import Rig
from spots_sim.person.stage_presser import StagePresser
from spots_sim.strip.change import Change

PLACES = np.linspace(0.08, 0.92, 8)


class Light(StagePresser):
    """Presses every mark with the same force, whatever force is asked for."""

    def __init__(self, stage, force_mN):
        super().__init__(stage)
        self._force_mN = force_mN

    def press(self, wanted):
        self._stage.press(wanted.place_um, self._force_mN)


@pytest.mark.board
@pytest.mark.parametrize("keys", [{"contact.gap_percent": 9.0, "contact.mode_percent": -2.0}])
def test_light_and_firm_presses_give_the_same_re_zero(sensor, keys):
    with Rig(with_keys(sensor, keys), 2, 50_000, 1) as rig:
        assert has_cross(rig.lines)
        stage = rig.stage
        places_um = [share * stage.length_um for share in MARKS]
        logs = stage.read(places_um, [FIRM_MN], 40).logs
        marks = Marks(place_um=tuple(places_um), force_mN=FIRM_MN, logs=tuple(map(tuple, logs)))
        made = CalibrationFile(date=now(), **rig.conditions._asdict(), lines=rig.lines, marks=marks)
        stage.held.changed = Change(phosphor_nm=0.6)
        spectra = stage.read(PLACES * stage.length_um, [3000.0], 20).counts
        found = {}
        for force_mN in (1000.0, 6000.0):
            new = rezero(silent_bench(stage, Light(stage, force_mN)), made)
            decode = Decoded()
            decode.calibration = Calibration(new.lines)
            found[force_mN] = []
            for counts in spectra:
                decode.update_mean(counts)
                found[force_mN].append(decode.position_um)
        light, firm = map(np.array, found.values())
        assert np.abs(light - firm).max() <= 50
        assert np.abs(firm - PLACES * stage.length_um).max() < 100


@pytest.mark.board
def test_without_a_cross_sensitivity_a_force_changes_no_colour(calibration):
    assert not CrossLines(calibration).logs(20_000, [900.0] * 6).any()


def test_a_joint_is_fitted_to_the_positions_of_the_corrected_table():
    session = Session(Path(__file__).parents[1] / "data" / "joint.jsonl")
    points = session.of("joint")
    plain, coloured = Strip(exposure_us=10_000).lines(), Strip(gap_percent=10.0).lines()
    assert _joint(session, plain, print)["joint"] == fit_joint(points)
    decode = Decoded()
    decode.calibration = Calibration(coloured)
    for point in (points[0], points[-1]):
        decode.update_mean(point.counts)
        assert abs(decode.position_um - point.position_um) > 5
    angle, joint = points[0].angle_deg, _joint(session, coloured, print)["joint"]
    decode.update_mean(points[0].counts)
    assert joint.zero_deg + joint.deg_per_um * decode.position_um == pytest.approx(angle, abs=1)
