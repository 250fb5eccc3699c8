"""The digital twin of a linkage: end point from two encoders, and its error with real firmware."""

from __future__ import annotations

import json
import math

import msgspec
import numpy as np
import pytest
from support.joints import JOINT
from support.joints import touch as reading
from support.refusals import refusal

from spots import cli
from spots.errors import SettingError
from spots_linkage import Encoder, Linkage, Twin
from spots_linkage import twin as twin_command
from spots_linkage.limits import Limit
from spots_sim.demo import linkage_demo
from spots_sim.measure import survey
from spots_sim.measure.simulated_linkage import START_S, Simulation
from spots_sim.person.mechanism import Mechanism, closed, guided
from spots_sim.strip.files import (
    LinkageFile,
    PathFile,
    SensorFile,
    load,
)

LINKAGE = Linkage(100, 80)


@pytest.fixture(scope="module")
def files():
    return load(SensorFile, "default"), load(LinkageFile, "default"), load(PathFile, "sust")


@pytest.fixture(scope="module")
def short(files):
    """Sensor file, linkage file, and a path file that has only the first letter."""
    sensor, linkage, path = files
    return sensor, linkage, msgspec.structs.replace(path, stroke=path.stroke[:1])


@pytest.fixture(scope="module")
def run(files):
    return survey.follow(*files)


def twin(joint=JOINT, linkage=LINKAGE):
    return Twin(linkage, (Encoder(joint), Encoder(joint)))


def at(theta_rad, time_s):
    """Return the reading of a joint with the angle `theta_rad` at `time_s`."""
    position_um = (math.degrees(theta_rad) + 20) / 0.002
    return reading(position_um, time_s / 0.03, time_s=time_s)


def test_a_terminal_is_that_of_one_moment():
    found = []
    one = twin()
    # Both joints turn with constant speed, and are read at different times.
    for i in range(20):
        for joint, time_s in ((0, 0.03 * i), (1, 0.03 * i + 0.011)):
            theta = -0.3 + 0.5 * time_s if joint == 0 else -0.6 - 0.2 * time_s
            found += one.take(joint, at(theta, time_s))
    assert len(found) == 38  # one for each reading except the first and the last one
    assert list(one.trail) == found
    for terminal in found:
        t = terminal.time_s
        x, y = LINKAGE.forward(-0.3 + 0.5 * t, -0.6 - 0.2 * t)
        assert (terminal.x_mm, terminal.y_mm) == pytest.approx((x, y), abs=0.005)
    speed = LINKAGE.jacobian(*found[-1].theta_rad) @ [0.5, -0.2]
    assert found[-1].velocity_mm_s == pytest.approx(speed, rel=0.01)
    assert found[0].velocity_mm_s is None
    times = [terminal.time_s for terminal in found]
    assert times == sorted(set(times))


def test_the_ellipse_is_that_of_the_covariance():
    one = twin()
    one.take(0, at(-0.3, 0.0))
    (terminal,) = one.take(1, at(-0.9, 0.0))
    sigma = math.radians(JOINT.resolution_deg)
    covariance = LINKAGE.covariance(*terminal.theta_rad, sigma**2 * np.eye(2))
    xx, xy, yy = terminal.covariance_mm2
    assert np.allclose([[xx, xy], [xy, yy]], covariance, rtol=1e-9)
    variances, ways = np.linalg.eigh(covariance)
    major, minor, angle = terminal.ellipse
    assert (minor, major) == pytest.approx(np.sqrt(variances))
    assert abs(ways[:, 1] @ [math.cos(angle), math.sin(angle)]) == pytest.approx(1)
    assert terminal.sigma_mm == pytest.approx(math.sqrt(variances.sum()))


def test_limits_are_told_and_not_drawn():
    apart = Linkage((100, 45, 45, 100), 80)
    one = twin(linkage=apart)
    one.take(0, at(-1.0, 0.0))
    (terminal,) = one.take(1, at(-1.0, 0.0))
    assert terminal.limit == Limit.ELBOWS_APART
    assert terminal.x_mm is terminal.y_mm is terminal.ellipse is terminal.sigma_mm is None
    assert Limit.ELBOWS_APART.sentence in twin_command.line(terminal, 0.0)
    near = twin()
    angle = -math.asin(0.6) + 0.003
    near.take(0, at(angle, 0.0))
    (terminal,) = near.take(1, at(angle, 0.0))
    assert terminal.singular
    assert "near singular" in twin_command.line(terminal, 0.0)


def test_nothing_is_reported_across_a_gap():
    one = twin()
    one.take(0, at(-0.3, 0.0))
    assert len(one.take(1, at(-0.6, 0.0))) == 1
    assert one.take(1, at(-0.6, 0.03)) == []
    assert one.take(0, at(-0.3, 1.5)) == []  # the angle of joint 1 at 0.03 s is unknown
    assert len(one.take(1, at(-0.6, 1.5))) == 1
    dark = at(-0.3, 1.6)._replace(flags=0)
    assert one.take(0, dark) == []


def test_it_makes_no_difference_which_joint_is_heard_first():
    moments = [(0, 0.03 * i) for i in range(20)] + [(1, 0.011 + 0.07 * i) for i in range(8)]
    read = [(joint, at(-0.3 - 0.3 * joint + 0.5 * s, s)) for joint, s in moments]
    in_time = sorted(read, key=lambda pair: pair[1].time_s)
    expected = list(twin().follow(in_time))
    # For each reading between the first and the last reading of the other joint, in order.
    assert [terminal.time_s for terminal in expected] == sorted(
        s for _, s in moments if 0.011 <= s <= 0.011 + 0.07 * 7
    )
    assert list(twin().follow(read)) == expected
    assert list(twin().follow(read[20:] + read[:20])) == expected


def test_a_recording_that_is_played_again_is_told_again():
    one = twin()
    pairs = [(joint, at(-0.3, 0.03 * i)) for i in range(50) for joint in (0, 1)]
    first = list(one.follow(pairs))
    assert len(first) == 50
    assert list(one.follow(pairs))[-40:] == first[-40:]


def test_a_closed_path_is_repeated(files):
    sensor, linkage, path = files
    motion = guided(closed(path), START_S)
    assert motion.at(motion.seconds) == pytest.approx(motion.at(START_S), abs=0.2)
    period_s = motion.seconds - START_S
    for again, later in ((True, 1.0), (False, period_s)):
        for scenario in Mechanism(linkage, sensor).drive(motion, again):

            def at(time_s, scenario=scenario):
                (press,) = scenario.presses(time_s)
                return press.position_mm, scenario.pose(time_s).bend_deg

            assert at(START_S + period_s + 1.0) == pytest.approx(at(START_S + later))
            assert at(START_S + 1.0) != pytest.approx(at(motion.seconds), abs=0.1)


def test_two_encoders_it_is():
    with refusal(SettingError):
        Twin(LINKAGE, (Encoder(JOINT),))


@pytest.mark.board
def test_sust_is_followed(run, files):
    figures = run.summary()
    assert figures["lost"] == figures["beyond_limits"] == 0
    assert figures["seconds"] == pytest.approx(guided(files[2]).seconds, abs=0.1)
    assert 60 < figures["rate_hz"] < 70  # two boards at 30 ms
    assert figures["error_mm"]["mean"] < 0.1
    assert figures["error_mm"]["max"] < 0.4
    # The expected error does not include the errors of dark frames and calibrations, which are
    # constant during a run. In one of 16 runs with other noise, the ratio was 2.03.
    assert 0.7 < figures["error_mm"]["rms"] / figures["expected_rms_mm"] < 2


@pytest.mark.board
def test_the_subtle_vibrations_are_in_the_twin(files):
    # The twin differs more from the same path without the tremor than from the true path.
    sensor, linkage, path = files
    path = msgspec.structs.replace(path, stroke=path.stroke[5:6], tremor_mm=0.3, tremor_hz=3.0)
    run = survey.follow(sensor, linkage, path)
    told = np.array([(t.time_s, t.x_mm) for t in run.terminals])
    calm = guided(msgspec.structs.replace(path, tremor_mm=0.0), START_S)
    tremor = np.sin(2 * np.pi * 3.0 * told[:, 0])
    off = told[:, 1] - calm.at(told[:, 0])[0]
    seen_mm = (off * tremor).sum() / (tremor**2).sum()
    assert seen_mm == pytest.approx(0.3, abs=0.05)


@pytest.mark.board
def test_a_run_repeats_and_its_recording_gives_the_same_result(short):
    sensor, linkage, path = short
    first = survey.follow(*short, seed=5)
    motion = guided(path, START_S)
    with Simulation(sensor, linkage, motion, 5, 30_000) as simulation:
        kept = sorted(simulation.readings(), key=lambda pair: pair[1].time_s)
        encoders = simulation.encoders()
        true = Linkage(simulation.mechanism.bar_mm, simulation.mechanism.base_mm)
    again = [
        terminal
        for terminal in Twin(true, encoders).follow(kept)
        if START_S <= terminal.time_s <= motion.seconds
    ]
    assert again == first.terminals
    assert len(again) > 60


@pytest.mark.board
def test_the_workspace_is_within_the_papers_deviation_and_a_calibration_finds_the_lengths(files):
    sensor, linkage, _ = files
    found = survey.survey(sensor, linkage, pitch_mm=16.0)
    assert len(found.x_mm) > 60
    assert found.drawn.max_mm > 1.5  # the nominal lengths cause a large error
    assert found.given.max_mm <= 0.64
    assert found.calibrated.max_mm <= 0.25
    # Not much more than the errors that the encoders cause.
    assert found.given.max_mm < 1.5 * found.expected_max_mm
    assert found.calibrated.mean_mm < 1.5 * found.expected_mean_mm
    assert found.kinematics.unidentified == found.kinematics.outliers == ()
    mechanism = Mechanism(linkage, sensor)
    for name, true in zip(("bar1_mm", "bar2_mm", "bar3_mm", "bar4_mm"), mechanism.bar_mm):
        told, error = found.kinematics.values[name], found.kinematics.standard_errors[name]
        assert abs(told - true) < 4 * error


def test_a_path_beyond_the_linkage_is_refused(capsys, tmp_path):
    path = tmp_path / "far.toml"
    path.write_text("speed_mm_s = 10\n[[stroke]]\npoints = [[40, 150], [40, 250]]\n")
    assert cli.main(["twin", "--path", str(path)]) == 2
    err = capsys.readouterr().err
    assert "cannot follow the path" in err
    assert err.count("\n") == 1


@pytest.fixture
def quick(short, tmp_path):
    """Command-line options of a short run."""
    path = tmp_path / "letter.toml"
    points = [list(point) for point in short[2].stroke[0].points]
    path.write_text(f"speed_mm_s = 40\n[[stroke]]\nsmooth = true\npoints = {points}\n")
    return ["twin", "--path", str(path)]


@pytest.mark.board
def test_the_command_prints_errors_and_lines_and_draws(quick, capsys, tmp_path):
    picture = tmp_path / "s.png"
    assert cli.main([*quick, "--json", "--picture", str(picture)]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["error_mm"]["mean"] < 0.15
    assert picture.read_bytes()[:4] == b"\x89PNG"
    assert cli.main(quick) == 0
    *lines, last = capsys.readouterr().out.splitlines()
    assert len(lines) >= 3
    assert all("end point" in line and "+-" in line for line in lines)
    assert f"error: {figures['error_mm']['mean']:.3f} mm mean" in last


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--path", "nope"], "cannot read the path file nope"),
        (["--linkage", "nope"], "cannot read the linkage file nope"),
        (["--picture", "a.jpg"], "ends in .png, not 'a.jpg'"),
        (["--picture", "no/such/a.png"], "no folder no/such"),
    ],
)
def test_mistakes_are_one_sentence(arguments, words, capsys, monkeypatch):
    monkeypatch.setattr(linkage_demo, "follow", lambda *_: pytest.fail("simulated before"))
    assert cli.main(["twin", *arguments]) == 2
    err = capsys.readouterr().err
    assert words in err
    assert err.count("\n") == 1
