"""Results of `spots characterize`: near the Cramér-Rao bound on all strips, and as documented."""

import json

import msgspec
import numpy as np
import pytest
from support.sensors import replaced

from spots.calibrate.fit.presses import Noise, Presses
from spots.cli import main
from spots_sim.measure import figures
from spots_sim.measure.bound import Bound
from spots_sim.measure.measurements import (
    Run,
    _joint,
    _position,
    _threshold_mN,
    characterize,
    crb_ratio,
)
from spots_sim.measure.pair import OnePair
from spots_sim.measure.rig import Rig
from spots_sim.person.stage import Stage
from spots_sim.strip.files import DATA, SensorFile, load
from spots_sim.strip.silicone import Silicone

SENSORS = sorted(path.stem for path in (DATA / "sensors").glob("*.toml"))
# Strips that differ most from the default strip, each in another way. `spots characterize` prints
# the ratio of every strip.
EXTREME = "short_30mm", "long_200mm", "real"
PLAN = ("F3", "F4", "F5", "F6", "F7", "F8")


@pytest.fixture(scope="module")
def run(sensor):
    return characterize(sensor, seed=2, exposure_us=10_000)


def ratio(rig):
    # 35 presses at each of 19 positions: the ratio scatters by 1 / sqrt(2 * 19 * 34), or 2.8 %.
    return crb_ratio(rig, seed=1, jittered=35)


def test_there_are_sensors_of_every_kind():
    assert {"default", "short_30mm", "long_200mm", "noisy", "daylight", "bright", "dim"} <= {
        *SENSORS
    }


@pytest.mark.board
@pytest.mark.parametrize("name", EXTREME)
def test_near_the_bound_at_10_ms(name):
    # The bound does not depend on time, so the silicone must not creep.
    sensor = msgspec.structs.replace(load(SensorFile, name), silicone=Silicone())
    with Rig(sensor, 0, 10_000, 1) as rig:
        c = rig.conditions
        assert c.exposure_us == 10_000
        # The readings contain no dark counts and no daylight. The warm-up of the LED causes a small
        # difference.
        expected = Bound(sensor, c.plan, c.gain, c.exposure_us, c.led_mA).counts(10_000, 3000)
        _, counts = rig.readings(10_000, 3000, 40)
        assert counts.mean(axis=0) == pytest.approx(expected, rel=0.025, abs=0.5)
        assert 0.90 < ratio(rig) <= 1.10


@pytest.mark.board
def test_bright_and_dim_are_exposed_before_they_are_measured():
    gains = {}
    for name in ("bright", "dim"):
        with Stage(load(SensorFile, name), settings="exposure_us=10000") as stage:
            stage.expose(10_000)
            gains[name] = stage.reader.conditions.gain
    assert gains["bright"] < 9 < gains["dim"]


@pytest.mark.board
def test_six_channels_beat_the_best_pair(run):
    position = run.summary["position"]
    assert 0.94 < position["crb_ratio"] <= 1.10
    assert position["one_pair"]["crb_ratio"] > 1.3 * position["crb_ratio"]


@pytest.mark.board
def test_what_the_paper_publishes_is_reached_but_for_the_light_of_10_ms(run):
    found = run.summary
    assert found["position"]["r2"] > 0.996
    assert found["snr_db"] > 20
    assert found["force"]["accuracy_N"] < 0.14
    assert found["joint"]["r2"] > 0.999


@pytest.mark.board
def test_resolution_and_accuracy_agree_with_noise_that_is_nearly_normal(run):
    position = run.summary["position"]
    assert position["resolution_um"] == pytest.approx(position["bound_um"], rel=0.15)
    # The mean absolute value of a normal variable is 0.8 of its standard deviation.
    assert position["accuracy_um"] == pytest.approx(0.8 * position["bound_um"], rel=0.15)


@pytest.mark.board
def test_the_resolution_of_the_force_is_near_its_bound(run):
    force = run.summary["force"]
    # Repeated readings of a constant press have the same rounding error, which is not visible then.
    assert 0.8 * force["bound_mN"] < force["resolution_mN"] < 1.15 * force["bound_mN"]


def test_the_noise_of_the_led_alone_forbids_5_mN_at_10_ms_on_softened_silicone(sensor):
    soft = Silicone(softening_percent=15.0, preload_mN=10_000.0)
    quiet = {"read_noise_counts": 1e-3, "electrons_per_count_1x": 1e12, "ratio_noise_ppm": 0.0}
    found = []
    for silicone in (Silicone(), soft):
        converter = msgspec.structs.replace(sensor.converter, **quiet)
        strip = msgspec.structs.replace(sensor, silicone=silicone, converter=converter)
        bound = Bound(strip, PLAN, 9, 10_000, 20)
        found.append(np.mean([bound.force_sigma_mN(4e4, f) for f in np.linspace(600, 9500, 16)]))
    assert found[1] > 1.2 * found[0]
    assert found[1] > 5


@pytest.mark.board
def test_the_joints_play_is_found(sensor):
    with Rig(replaced(sensor, joint={"play_deg": 0.5}), 0, 10_000, 1) as rig:
        run = Run()
        _joint(rig, run)
    assert run.summary["joint"]["backlash_deg"] == pytest.approx(0.5, rel=0.15)
    assert run.summary["joint"]["accuracy_deg"] == pytest.approx(0.25, rel=0.15)


@pytest.mark.board
def test_the_dead_zone_is_the_contacts(run, sensor):
    assert sensor.contact.threshold_mN < run.summary["force"]["threshold_mN"] < 230


@pytest.mark.board
def test_bending_and_strain_keep_the_accuracy(run):
    best = run.summary["position"]["accuracy_um"]
    rows = run.summary["bend"] + run.summary["strain"]
    assert [row.get("degrees") for row in rows[:5]] == [0, 45, 90, 135, 180]
    assert [row.get("percent") for row in rows[5:]] == [0, 5, 10, 15, 20, 25]
    assert all(0.5 * best < row["accuracy_um"] < 1.6 * best for row in rows)


def test_the_bound_falls_with_the_root_of_the_average(sensor):
    one, four = (Bound(sensor, PLAN, 9, 10_000, 20, n).sigma(40_000, 3000)[0] for n in (1, 4))
    assert one == pytest.approx(2 * four)


def test_the_bound_is_what_least_squares_reaches(sensor):
    # Computed by simulation, not by the equations of the bound: exact model, normal noise, and two
    # unknowns.
    bound = Bound(sensor, PLAN, 9, 10_000, 20)
    sigma = np.sqrt(sensor.converter.read_noise_counts**2 + 1 / 12)
    true = bound.counts(40_000, 3000)
    noisy = true + sigma * np.random.default_rng(0).standard_normal((4000, 6))
    step = (bound.counts(40_100, 3000) - true) / 100
    estimates = np.linalg.lstsq(np.stack([step, true], axis=1), (noisy - true).T, rcond=None)[0]
    assert estimates[0].std() == pytest.approx(bound.sigma(40_000, 3000)[0], rel=0.05)


def test_the_best_pair_is_chosen():
    x_um = np.linspace(0, 85_000, 30)
    decays = np.array([0.02, 0.02, 0.02, 0.02, 0.02, 0.004])
    brightness = np.array([100, 100, 3000, 100, 100, 100])
    counts = brightness * np.exp(-x_um[:, None] / 1000 * decays)
    along = Presses(x_um, np.full(30, 3000.0), counts, np.full((30, 6), 0.1), np.zeros(30, bool))
    pair = OnePair(along, Noise(0.1, 0.0))
    assert pair.channels == (2, 5)
    assert pair.position_um(counts[11]) == pytest.approx(x_um[11], abs=1)


@pytest.mark.board
def test_signal_to_noise_is_that_of_a_sample_whatever_the_average(sensor):
    found = []
    for average in (1, 4):
        with Rig(sensor, 0, 10_000, average) as rig:
            run = Run()
            _position(rig, np.random.default_rng(0), run, places=np.array([0.2, 0.5, 0.8]))
        found.append(run.summary["snr_db"])
    assert found[0] == pytest.approx(found[1], abs=2.0)


def test_json_is_one_object(capsys, monkeypatch):
    seen = {}

    def fake(*arguments):
        seen["arguments"] = arguments
        run = type("Run", (), {})()
        run.summary = {"exposure_us": arguments[2], "average": arguments[3]}
        return run

    monkeypatch.setattr("spots_sim.measure.characterize.characterize", fake)
    line = ["characterize", "--exposure-us", "20000", "--average", "2", "--json"]
    assert main(line) == 0
    output = capsys.readouterr()
    assert json.loads(output.out) == {"exposure_us": 20000, "average": 2}
    assert output.err == ""


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--exposure-us", "999"], "--exposure-us must be from 1000 to 1000000"),
        (["--exposure-us", "1000001"], "1000 to 1000000"),
        (["--average", "0"], "1 to 64"),
        (["--average", "65"], "--average must be from 1 to 64"),
        (["--sensor", "nosuch"], "cannot read the sensor file"),
    ],
)
def test_a_mistake_is_one_sentence(capsys, options, says):
    assert main(["characterize", *options]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert says in output.err
    assert output.err.count("\n") == 1


def test_without_matplotlib_nothing_is_measured(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(figures, "find_spec", lambda name: None)
    measured = []
    monkeypatch.setattr(
        "spots_sim.measure.characterize.characterize", lambda *words: measured.append(words)
    )
    assert main(["characterize", "--out", str(tmp_path / "figures")]) == 2
    assert not measured
    assert '[plots]"' in capsys.readouterr().err
    assert not (tmp_path / "figures").exists()


@pytest.mark.board
def test_each_part_of_the_rig_leaves_it_as_it_was(sensor, monkeypatch):
    with Rig(sensor, 0, 10_000, 1) as rig:
        _threshold_mN(rig)
        assert rig.stage.held.press is None
        # The indenter calibrates the strained strip, although a finger presses it before and after.
        along, seen = rig.stage.along, []
        monkeypatch.setattr(rig.stage, "along", lambda: seen.append(rig.stage.by_hand) or along())
        rig.stage.by_hand = True
        rig.learn_strains([15])
        assert (seen, rig.stage.by_hand) == ([False], True)
