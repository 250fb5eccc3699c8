"""Calibration sessions by hand: a simulated person follows them, with errors and mistakes."""

import argparse
import io
import re

import msgspec
import numpy as np
import pytest
from rich.console import Console
from support.hand_session import LONG, PLAN, Room, calibrate, errors_um
from support.refusals import refusal

from spots import SpotsError
from spots.calibrate.fit.decoded import Decoded
from spots.calibrate.session import hand, steps
from spots.calibrate.session.bench import Bench
from spots.calibrate.session.guide import Guide
from spots.calibrate.session.session_file import Session, settings
from spots.calibrate.session.typed import typed
from spots.errors import CalibrationError, SettingError
from spots_device.reading.calibration import Calibration
from spots_sim.person.person import Habits
from spots_sim.person.stage import Stage
from spots_sim.person.stage_presser import StagePresser
from spots_sim.strip.files import SensorFile, load


def relative_forces(stage, made):
    """Return the measured forces and the sums of counts of presses with 1, 2, 4 and 8 N."""
    decode = Decoded()
    decode.calibration = Calibration(made.lines)
    found = []
    for force_mN in (1000.0, 2000.0, 4000.0, 8000.0):
        stage.press(0.4 * stage.length_um, force_mN)
        counts = stage.reader.read(16).counts
        decode.update_mean(counts)
        found.append((decode.force_mN, counts.sum()))
    return np.array(found).T


@pytest.fixture(scope="module")
def rough(sensor, tmp_path_factory):
    path = tmp_path_factory.mktemp("rough") / "a.jsonl"
    with Stage(sensor, seed=3) as stage:
        room = Room(stage, Habits())
        made = calibrate(room, path, "rough", steps.COUNTS["rough"][0], plan=None)
        assert stage.board.command("hello")["relative_force"] is True
        return path, made, room, errors_um(stage, made), relative_forces(stage, made)


@pytest.mark.board
def test_a_rough_calibration_takes_twelve_presses_and_is_good_to_a_millimetre(rough):
    _, made, room, errors, _ = rough
    assert room.person.presses <= 12
    assert np.abs(errors).mean() < 1000
    assert "relative" in made.lines
    assert not any("scale" in question for question, _ in room.asked)
    assert not re.search(r"press at .*\d (g|N)\b", room.getvalue())
    assert made.residuals[0].force_rms_mN is None
    assert made.marks is not None


def test_a_calibration_has_no_common_error_of_rounded_positions(rough):
    session = Session(rough[0])
    plain = hand._surface(session, session.length_um)
    at_um, force_mN = np.linspace(0, session.length_um, 5), np.full(5, 3000.0)
    made = hand.material(session, session.length_um)[0].logs(at_um, force_mN)
    assert made == pytest.approx(plain.moved().logs(at_um, force_mN))
    assert made != pytest.approx(plain.logs(at_um, force_mN), abs=1e-4)


def test_a_relative_force_is_proportional_to_the_light(rough):
    forces, light = rough[4]
    assert forces / light == pytest.approx(np.mean(forces / light), rel=0.02)
    assert 2000 < forces[2] < 4000  # 3000 is the mean light of the presses, of 2.5 to 6 N


@pytest.mark.board
def test_a_rough_calibration_gets_forces_from_presses_with_a_scale(sensor, rough, tmp_path):
    path = tmp_path / "a.jsonl"
    path.write_bytes(rough[0].read_bytes())
    with Stage(sensor, seed=3) as stage:
        stage.board.command("set " + settings(Session(path).conditions))
        stage.reader.set_up()
        room = Room(stage, Habits(place_mm=0.1, force_share=0.01, slips=0))
        made = calibrate(room, path, "fine", 22)
        assert "relative" not in made.lines
        assert stage.board.command("hello")["relative_force"] is False
        assert np.abs(errors_um(stage, made)).mean() < 200
    assert len(Session(path).of("hand")) == 22
    assert made.residuals[0].force_rms_mN < 300


@pytest.mark.board
def test_wrong_answers_are_named_and_their_presses_asked_for_again(sensor, tmp_path):
    path = tmp_path / "a.jsonl"
    with Stage(msgspec.structs.replace(sensor, length_mm=60.0), seed=3) as stage:
        room = Room(stage, Habits(place_mm=0.3, slips=0))
        room.answers = ["again", "", "40", "300N", "9g", "80mm", *[""] * 10, "25mm", "", "undo"]
        made = calibrate(room, path, "fine", 20)
        assert np.abs(errors_um(stage, made)).mean() < 300
    said = room.getvalue()
    assert "'40' is not valid: type numbers with units" in said
    assert "300N is not a possible force of a press: did you mean 300 g?" in said
    assert "9g is not a possible force of a press: did you mean 9 N?" in said
    assert "80mm is beyond the end of the strip at 60 mm" in said
    assert "25.0 mm with" in said
    assert said.count("is removed: its light fits a press at") == 1
    assert said.count("undone: ") == 1
    unseen = said.count("no press is seen")  # a press that was too weak, by the noise
    assert room.person.presses == 20 + 5 + unseen
    assert len(Session(path).of("hand")) >= 18


@pytest.mark.board
@pytest.mark.parametrize(("kind", "most"), [("rough", 12)])
def test_repeated_presses_replace_others(sensor, tmp_path, kind, most):
    path = tmp_path / "a.jsonl"
    with Stage(sensor, seed=3, settings=LONG) as stage:
        room = Room(stage, Habits())
        room.answers = ["", "", "", *["again"] * 3, *[""] * 9, *["again"] * 6]
        calibrate(room, path, kind, steps.COUNTS[kind][0], plan=None)
    assert room.person.presses <= most
    assert len(Session(path).of("hand")) >= steps.COUNTS[kind][1]


@pytest.mark.board
def test_a_press_that_is_lifted_early_is_not_requested_again(sensor, tmp_path):
    path = tmp_path / "a.jsonl"
    with Stage(sensor, seed=3, settings=LONG) as stage:
        room = Room(stage, Habits(slips=1.0))
        calibrate(room, path, "rough", steps.COUNTS["rough"][0])
    assert not re.search("(press|try) again", room.getvalue())
    assert room.person.presses == len(Session(path).of("hand")) == 12


@pytest.mark.board
def test_a_rough_session_requests_the_press_of_the_exposure_again_if_it_ended(
    sensor, tmp_path, monkeypatch
):
    path = tmp_path / "a.jsonl"
    with Stage(sensor, seed=3, settings=LONG) as stage:
        room, command = Room(stage, Habits(slips=0)), stage.board.command

        def lifts(line, **options):
            reply = command(line, **options)
            if line == "autoexpose":
                room.move([])
            return reply

        monkeypatch.setattr(stage.board, "command", lifts)
        calibrate(room, path, "rough", steps.COUNTS["rough"][0], plan=None)
    assert re.findall(r"press at (.*) mm", room.getvalue())[:2] == ["2.0", "2.0"]
    assert room.person.presses == 1 + len(Session(path).of("hand")) == 12


class EnoughError(Exception):
    """Raised by a test to end a session early."""


@pytest.mark.board
def test_a_press_that_is_too_dark_is_asked_for_again_with_more_force(tmp_path, monkeypatch):
    following, asked = hand._next, []

    def with_a_weak_one(*state):
        asked.append(following(*state))
        if len(asked) > 7:
            raise EnoughError
        return hand._wanted(198_000, 230) if len(asked) == 7 else asked[-1]

    monkeypatch.setattr(hand, "_next", with_a_weak_one)
    with Stage(load(SensorFile, "long_200mm"), seed=3) as stage:
        room = Room(stage, Habits(slips=0))
        with pytest.raises(EnoughError):
            calibrate(room, tmp_path / "a.jsonl", "fine", 20)
    said = room.getvalue()
    assert "198.0 mm with 0.23 N: the press is too dark" in said
    assert "press at 198.0 mm with about 33 g (0.32 N) and hold" in said


@pytest.mark.parametrize(
    ("text", "place_um", "force_mN"),
    [
        ("", None, None),
        ("42mm", 42_000, None),
        ("4.2 cm, 120g", 42_000, 1176.8),
        ("1,18 N 42 mm", 42_000, 1180),
        ("1.18N", None, 1180),
        ("0.5kg", None, 4903.3),
        ("4cm 2mm 310g", 42_000, 3040.1),
        ("1kg 200g; 4 cm, 2.5 mm", 42_500, 11_768.0),
        ("1.250 kg 42.125mm", 42_125, 12_258.3),
        ("0,500 kg", None, 4903.3),
    ],
)
def test_places_and_forces_are_typed_as_they_are_read(text, place_um, force_mN):
    found = typed(text, 85_000)
    assert found == (place_um, force_mN and pytest.approx(force_mN, rel=1e-4))


@pytest.mark.parametrize(
    "text",
    [
        *("42", "42 km", "mm", "42mm and 3", "120mm", "120N", "2g", "1.18 mN", "-4mm", "nan mm"),
        *("42mm 43mm", "4.2cm 2mm", "4cm 12mm", "2mm 4cm", "4cm 310g 2mm", "4cm 2mm 1mm"),
        *("310g 320g", "1kg 2N", "1.5kg 200g", "1N 200mN", "1kg 1200g", "0.3kgf", "310gf"),
        *("1,200 N", "1,200g", "42,125mm", "1,200.5g", "1'200g", "1 200g", "1e1mm"),
    ],
)
def test_what_no_ruler_or_scale_shows_is_refused(text):
    with pytest.raises(SpotsError):
        typed(text, 85_000)


def test_the_scale_may_show_less_than_a_small_force_that_was_asked_for():
    assert typed("9g", 85_000, wanted_mN=108.0) == (None, pytest.approx(88.3, rel=1e-3))
    with refusal(SettingError):
        typed("9g", 85_000, wanted_mN=1000.0)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("1,200g", r"^'1,200' can be 1200 or 1\.2: type one of these$"),
        ("1.200 g", r"did you mean 1200 g\?$"),
        ("1.18 g", r"did you mean 1\.18 N\?$"),
        ("2kg 300g", r"^2kg 300g is not .*: it must be from 10 g"),
        ("42mm 310g 320g", "has two forces: type one"),
        ("42mm 4cm", "has two positions: type one"),
    ],
)
def test_a_measure_that_can_be_two_is_answered_with_both(text, says):
    with pytest.raises(SpotsError, match=says):
        typed(text, 85_000)


def test_a_force_that_is_impossible_in_both_units_is_answered_with_the_limits():
    with refusal(SettingError):
        typed("2500g", 85_000)


@pytest.mark.board
def test_a_strip_that_no_force_lights_ends_the_session(sensor, tmp_path):
    shown = Guide(Console(file=io.StringIO(), width=200))
    options = argparse.Namespace(channels=PLAN, keep_settings=True)
    with Stage(sensor, seed=3) as stage:
        presser = StagePresser(stage)
        presser.press = lambda wanted: None
        bench = Bench(stage.reader, presser, shown, stage.length_um, tmp_path / "a.toml")
        with refusal(CalibrationError):
            steps.calibrate(bench, Session(tmp_path / "a.jsonl"), "fine", 0, None, options)
