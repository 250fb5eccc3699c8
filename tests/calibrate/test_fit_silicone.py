"""Hysteresis and creep are fitted to a recording, and the board corrects forces for them.

The compensation consists of play operators and exponentials. So that this is a real test, most
tests use the material `power`, which follows other laws, see `spots_sim.strip.silicone`.
"""

import numpy as np
import pytest
from msgspec import structs
from support.refusals import refusal

from spots.calibrate.fit.silicone import fit_silicone
from spots.errors import CalibrationError
from spots_device.reading.calibration import Calibration
from spots_device.reading.decode import FLAGS, FORCE_MN, POSITION_UM
from spots_sim.board.identity import board_id
from spots_sim.person.loading import (
    SESSION,
    loaded,
    points,
    record,
)
from spots_sim.strip.contact import coupling
from spots_sim.strip.scenario import Press
from spots_sim.strip.silicone import Memory, Silicone

EFFECTS = {
    "creep_percent": 5.2,
    "hysteresis_percent": 3.0,
    "softening_percent": 15.0,
    "preload_mN": 10_000.0,
}
SPEEDS = (0.5, 9000.0, 0.5, 0.0), (0.5, 9000.0, 2.0, 0.0), (0.5, 9000.0, 8.0, 0.0)
HELD = ((0.5, 5000.0, 0.05, 62.0),)
MODELS = ["spectrum", "power"]
STEP_S = 0.0105


class Strip:
    """A strip with creep and hysteresis; computes the readings of a calibrated board directly.

    It simulates neither the chip nor its noise.
    """

    def __init__(self, sensor, lines, model):
        self._contact, self._lines = sensor.contact, lines
        self._silicone = Silicone(model=model, **EFFECTS)
        # As in a calibration: presses with rising forces, each on recovered silicone.
        forces_mN = np.geomspace(sensor.contact.threshold_mN + 5, 10_500, 60)
        memory, light = Memory(self._silicone), []
        for i, force_mN in enumerate(forces_mN):
            memory.effective_mN([], 0.5 * i)
            light.append(self._light(memory, 0.5, force_mN, 0.5 * i + 0.1))
        self._table = np.array(light), forces_mN

    def _light(self, memory, share, force_mN, time_s):
        presses = [Press(85 * share, float(force_mN), 4.0)] if force_mN else []
        effective = memory.effective_mN(presses, time_s)
        return coupling(self._contact, effective[0]) if effective else 0.0

    def recorded(self, loads):
        """Apply loads; return time in s, true and measured force in mN, and position of readings.

        The position is a share of the strip's length.
        """
        time_s = np.arange(0, points(loads)[-1][-1][0] + 1, STEP_S)
        force_mN, place = loaded(loads, time_s)
        memory = Memory(self._silicone)
        light = [self._light(memory, *now) for now in zip(place, force_mN, time_s)]
        read = np.interp(light, *self._table, left=0)
        noise = np.random.default_rng(1).normal(0, 3, len(read))
        return time_s, force_mN, np.round(read + (read > 0) * noise), place

    def compensated(self, recorded, line):
        """Return the forces in mN that a board computes with a line ``silicone`` of a calibration.

        `recorded` is a result of the method `recorded`.
        """
        compensation = Calibration([*self._lines, line]).compensation
        found = []
        for time_s, _, read, share in zip(*recorded):
            reading = {FORCE_MN: int(read), POSITION_UM: round(85_000 * share), FLAGS: 0}
            compensation.take(reading, int(time_s * 1e6) >> 10)
            found.append(reading[FORCE_MN])
        return np.array(found)


def off_by(line, factor):
    """Return a calibration line ``silicone`` with all effects multiplied by `factor`."""
    name, *words = line.split()
    values = [int(word) for word in words]
    values[0] = round(4096 + factor * (values[0] - 4096))
    for i in (4, 5, 6, 10, 11, 12):
        values[i] = round(factor * values[i])
    return " ".join(map(str, (name, *values)))


def loop_error_mN(recorded, read_mN):
    force_mN = recorded[1]
    inside = (force_mN > 500) & (force_mN < 9000)
    return np.abs(read_mN - force_mN)[inside].mean()


@pytest.fixture(scope="module", params=MODELS)
def strip(request, sensor, calibration):
    made = Strip(sensor, calibration, request.param)
    made.fitted = fit_silicone(*made.recorded(SESSION))
    return made


@pytest.mark.board
def test_the_loop_is_a_fifth_and_with_wrong_parameters_two_fifths(strip):
    recorded = strip.recorded(SPEEDS)
    before = loop_error_mN(recorded, recorded[2])
    for factor, least in ((1.0, 5.0), (1.15, 2.5), (0.85, 2.5)):
        read = strip.compensated(recorded, off_by(strip.fitted.line, factor))
        ratio = before / loop_error_mN(recorded, read)
        print(strip._silicone.model, factor, round(before), round(ratio, 1))
        assert ratio >= least


def test_a_held_force_drifts_by_less_than_50_mN(strip):
    recorded = strip.recorded(HELD)
    held = np.flatnonzero(recorded[1] == 5000)
    drifts = []
    for read in (recorded[2], strip.compensated(recorded, strip.fitted.line)):
        at = read[held]
        second = round(1 / STEP_S)
        drifts.append(at[60 * second : 61 * second].mean() - at[: second // 2].mean())
    print(strip._silicone.model, drifts)
    assert drifts[0] > 150
    assert abs(drifts[1]) <= 50


def test_the_errors_of_the_weights_are_known(strip):
    fitted = strip.fitted
    assert fitted.after_mN < fitted.before_mN / 5
    assert fitted.sigma.shape == (7,)
    assert (fitted.sigma > 0).all()
    # The sum of the three parts of the creep is significant; a single part may not be.
    creep = sum(int(word) for word in fitted.line.split()[-3:])
    assert creep > 3 * np.linalg.norm(fitted.sigma[-3:])
    hysteresis, sigma = fitted.hysteresis_percent
    assert abs(hysteresis - EFFECTS["hysteresis_percent"]) < 1
    assert 0 < sigma < 0.5
    assert abs(fitted.creep_percent[0] - EFFECTS["creep_percent"]) < 1.5


def test_an_ideal_strip_needs_no_compensation(sensor, calibration, monkeypatch):
    monkeypatch.setitem(EFFECTS, "creep_percent", 0.0)
    monkeypatch.setitem(EFFECTS, "hysteresis_percent", 0.0)
    ideal = Strip(sensor, calibration, "spectrum")
    assert fit_silicone(*ideal.recorded(SESSION)).line == ""


def test_a_short_recording_is_refused():
    with refusal(CalibrationError):
        fit_silicone([0, 1, 2], [1000] * 3, [1000] * 3, [0] * 3)


@pytest.mark.board
def test_the_board_and_the_host_correct_alike(sensor, calibration):
    real = structs.replace(sensor, silicone=Silicone(**EFFECTS))
    calibration = [f"board {board_id(real)}", *calibration[1:]]
    line = "silicone 4300 300 1000 3000 400 0 150 400 4000 40000 60 50 0"
    loads = (0.5, 6000.0, 1.0, 0.5), (0.5, 3000.0, 0.3, 0.0), (0.2, 3000.0, 0.3, 0.2)
    plain = record(real, calibration, loads)
    board = record(real, [*calibration, line], loads)
    begin = max(plain[0, 0], board[0, 0])  # the uploads of the two calibrations differ in duration
    plain, board = (rows[:, rows[0] >= begin] for rows in (plain, board))
    assert np.array_equal(plain[0], board[0])
    compensation, host = Calibration([*calibration, line]).compensation, []
    for time_s, _, read, _, x_um in plain.T:
        reading = {FORCE_MN: int(read), POSITION_UM: int(x_um), FLAGS: 0}
        compensation.take(reading, round(time_s * 1e6) >> 10)
        host.append(reading[FORCE_MN])
    assert max(abs(board[2] - plain[2])) > 100
    # The host does not get the dark samples, so its steps of creep are at other times.
    assert np.abs(board[2] - host).max() <= 3
    assert np.array_equal(board[4], plain[4])  # positions are those without compensation


def test_a_fit_with_an_impossible_sign_is_refused():
    # The measured force decreases while the true one is constant: the opposite of creep.
    time_s = np.arange(0.0, 120.0, 0.05)
    place = time_s // 30
    held_s = time_s % 30
    force_mN = np.where(held_s < 25, 2000.0 + 1500.0 * (place % 3), 0.0)
    read_mN = force_mN * (1 + 0.15 * np.expm1(-held_s / 4))
    fitted = fit_silicone(time_s, force_mN, read_mN, place)
    assert fitted.creep_percent[0] < -5
    assert fitted.impossible
    assert fitted.line == ""
    assert "no silicone has a negative value" in str(fitted)
