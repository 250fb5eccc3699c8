"""`spots design`: the promised resolution is the Cramér-Rao bound, and a simulated strip has it."""

import json

import numpy as np
import pytest
from support.sensors import replaced

from spots.cli import main
from spots_make import design
from spots_sim.measure.measurements import FORCE_MN, PLACES
from spots_sim.measure.rig import Rig
from spots_sim.strip.files import SensorFile, load


def command(capsys, length_mm, resolution_um, rate_hz, *options):
    line = ["design", "--length-mm", length_mm, "--resolution-um", resolution_um, "--rate-hz"]
    code = main([str(word) for word in [*line, rate_hz, *options]])
    return code, capsys.readouterr()


@pytest.mark.board
def test_the_designed_strip_resolves_what_was_predicted(capsys, tmp_path):
    code, output = command(capsys, 60, 40, 100, "--json", "--out", tmp_path)
    assert code == 0
    found = json.loads(output.out)
    sensor = load(SensorFile, tmp_path / "sensor.toml")
    with Rig(sensor, 3, found["exposure_us"], found["average"]) as rig:
        assert (rig.conditions.gain, rig.conditions.led_mA) == (found["gain"], found["led_mA"])
        sigma_um = [
            np.std([r.position_um for r in rig.readings(x, FORCE_MN, 60)[0]], ddof=1)
            for x in PLACES * rig.stage.length_um
        ]
    assert np.mean(sigma_um) == pytest.approx(found["resolution_um"], rel=0.15)
    assert (tmp_path / "resolution.png").read_bytes()[:4] == b"\x89PNG"
    code, output = command(capsys, 70, 40, 100, "--out", tmp_path)
    assert (code, output.err.count("\n")) == (2, 1)
    assert "has a design: name another folder, or remove it" in output.err
    assert load(SensorFile, tmp_path / "sensor.toml") == sensor


@pytest.mark.board
def test_no_other_dye_is_better():
    best = design.best(85, 100)
    for times in (0.7, 0.9, 1.1, 1.4):
        sensor = load_dyed(best.sensor, times)
        other = design._predicted(sensor, best.exposure_us, best.average)
        assert other.resolution_um > best.resolution_um


def load_dyed(sensor, times):
    return replaced(sensor, dye={"strength_per_mm": times * sensor.dye.strength_per_mm})


@pytest.mark.board
def test_the_sensor_file_is_the_whole_design(tmp_path):
    found = design.design(85, 50, 100)
    path = tmp_path / "sensor.toml"
    path.write_text(design.sensor_toml(found))
    assert load(SensorFile, path) == found.sensor


@pytest.mark.parametrize(
    ("rate_hz", "exposure_us", "average"),
    [(1000, 1001, 1), (100, 10_000, 1), (10, 99_999, 1), (2, 166_667, 3)],
)
def test_the_exposure_fills_the_time_of_a_reading(rate_hz, exposure_us, average):
    assert design.timing(rate_hz) == (pytest.approx(exposure_us, abs=3), average)


@pytest.mark.board
def test_what_is_impossible_is_said_with_a_rate_that_is_not(capsys):
    code, output = command(capsys, 85, 7, 100)
    assert code == 2
    assert output.out == ""
    assert output.err.count("\n") == 1
    assert "the best resolution is" in output.err
    rate_hz = float(output.err.rsplit("a rate of at most ", 1)[1].split()[0])
    assert design.best(85, rate_hz).resolution_um <= 7
    assert design.best(85, 1.05 * rate_hz).resolution_um > 7


@pytest.mark.board
def test_what_no_rate_would_do(capsys):
    code, output = command(capsys, 85, 0.001, 100)
    assert code == 2
    assert "no rate" in output.err


@pytest.mark.parametrize(
    ("numbers", "says"),
    [
        ((0, 50, 100), "--length-mm"),
        ((0.085, 50, 100), "--length-mm must be from 1 to 10000 mm, not 0.085"),
        ((85_000, 50, 100), "--length-mm must be from 1 to 10000 mm, not 85000"),
        ((85, 5e-5, 100), "--resolution-um must be from 0.001 to 85000 um, not 5e-05"),
        ((85, 90_000, 100), "--resolution-um must be from 0.001 to 85000 um, not 90000"),
        ((85, -1, 100), "--resolution-um"),
        ((85, 50, 2000), "--rate-hz"),
        ((85, 50, 0), "--rate-hz"),
        ((5000, 50, 100), "too dark at 100 Hz with any dye"),
    ],
)
def test_a_mistake_is_one_sentence(capsys, numbers, says):
    code, output = command(capsys, *numbers)
    assert code == 2
    assert output.out == ""
    assert says in output.err
    assert output.err.count("\n") == 1


@pytest.mark.board
def test_the_limits_in_a_message_are_accepted(capsys):
    _, output = command(capsys, 85, 50, 0)
    low_hz, high_hz = output.err.split("must be from ")[1].split(" Hz")[0].split(" to ")
    for rate_hz in low_hz, high_hz:
        _, output = command(capsys, 85, 5000, rate_hz)
        assert "must be from" not in output.err


def test_a_sensor_file_that_cannot_be_written_is_one_sentence(tmp_path, capsys):
    (tmp_path / "sensor.toml").mkdir()
    line = ["design", "--length-mm", "85", "--resolution-um", "60", "--rate-hz", "100"]
    assert main([*line, "--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert "cannot write" in said
    assert said.count("\n") == 1
