"""Optics, contact and scenarios of the simulator, with the units of the sensor files."""

import numpy as np
import pytest
from support.refusals import refusal

from spots.errors import FileError, SpotsError
from spots_sim.strip import files
from spots_sim.strip.contact import coupling
from spots_sim.strip.files import ScenarioFile, SensorFile, load
from spots_sim.strip.optics import Optics, decay_per_mm
from spots_sim.strip.scenario import Scenario


def test_a_log_ratio_falls_nearly_straight_along_the_strip(sensor):
    optics = Optics(sensor)
    x = np.linspace(0, sensor.length_mm, 50)
    rates = np.array([optics.press(at, 4.0) for at in x])
    ratio = np.log(rates[:, optics.names.index("F4")] / rates[:, optics.names.index("F8")])
    line = np.polyval(np.polyfit(x, ratio, 1), x)
    r2 = 1 - ((ratio - line) ** 2).sum() / ((ratio - ratio.mean()) ** 2).sum()
    assert 0.996 < r2 < 1  # value in the paper; below 1, because a channel is a band of wavelengths


def test_blue_decays_faster_than_red(sensor):
    decay = decay_per_mm(sensor.dye)
    assert decay[0] == decay.max()
    assert decay[-1] == decay.min()


def test_a_wide_press_is_the_mean_of_narrow_ones(sensor):
    optics = Optics(sensor)
    parts = np.mean([optics.press(at, 0.0) for at in np.linspace(35, 45, 1001)], axis=0)
    assert optics.press(40, 10.0) == pytest.approx(parts, rel=1e-5)


def test_nothing_couples_below_the_threshold_and_more_force_couples_more(sensor):
    threshold = sensor.contact.threshold_mN
    assert coupling(sensor.contact, threshold) == 0
    shares = [coupling(sensor.contact, threshold + f) for f in (1, 100, 1000, 10_000, 1e9)]
    assert shares == sorted(shares)
    assert 0 < shares[0] < shares[-1] < 1


def test_a_scenario_repeats_and_moves_its_fingers_in_straight_lines():
    file = ScenarioFile(
        seconds=4.0, touch=[files.Finger(points=[(1.0, 10.0, 0), (2.0, 20.0, 1000)])]
    )
    scenario = Scenario(file)
    for start_s in (0, 4, 400):
        (press,) = scenario.presses(start_s + 1.5)
        assert (press.position_mm, press.force_mN) == pytest.approx((15.0, 500.0))
        assert scenario.presses(start_s + 0.9) == []
        assert scenario.presses(start_s + 2.0) == []


def test_flicker_averages_out_over_whole_periods():
    ambient = files.Ambient(steps=[(0.0, 10.0)], flicker_percent=50.0)
    scenario = Scenario(ScenarioFile(seconds=10.0, ambient=ambient))
    assert scenario.ambient_uW_cm2(0.0, 0.05) == pytest.approx(10.0)
    assert scenario.ambient_uW_cm2(0.0, 0.0025) > 13


@pytest.mark.parametrize("kind", [SensorFile, ScenarioFile])
def test_every_file_of_the_package_loads(kind):
    folder = files.DATA / ("sensors" if kind is SensorFile else "scenarios")
    names = [path.stem for path in folder.glob("*.toml")]
    assert names
    for name in names:
        assert isinstance(load(kind, name), kind)


GOOD = "seconds = 5.0\n[[touch]]\npoints = [[0, 1.0, 2.0], [1, 2.0, 3.0]]\n"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (GOOD + "speed = 3", "unknown key 'speed'"),
        (GOOD.replace("seconds = 5.0", ""), "the key 'seconds' is missing: add it"),
        (GOOD.replace("5.0", "0"), "seconds must be a number of at least 0.01"),
        (GOOD.replace("5.0", "'long'"), "seconds must be a number, not text"),
        (GOOD.replace("[1, 2.0", "[0, 2.0"), "ascend"),
        (GOOD.replace("2.0]", "-2.0]"), "must be a number of at least 0"),
        ("seconds = \n", "line 1"),
        (GOOD.replace("2.0]", "nan]"), "not a finite number"),
        (GOOD.replace("2.0]", "inf]"), "not a finite number"),
        (GOOD.replace("1.0, 2.0]", "-1.0, 2.0]"), "must be a number of at least 0"),
        (GOOD.replace("[1, 2.0", "[6, 2.0"), r"beyond the end of the scenario \(5 s\)"),
        (GOOD + "[ambient]\nsteps = [[1, 1.0], [1, 2.0]]", "must ascend"),
    ],
)
def test_a_mistake_in_a_file_is_one_sentence_with_its_place(tmp_path, text, says):
    path = tmp_path / "my.toml"
    path.write_text(text)
    with pytest.raises(SpotsError, match=says) as caught:
        load(ScenarioFile, path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_unknown_name_lists_the_known_ones():
    with refusal(FileError, file="nope"):
        load(SensorFile, "nope")
