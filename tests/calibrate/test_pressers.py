"""A calibration knows with what it was pressed: tables for a finger and for an indenter."""

from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest
from support.refusals import refusal

from spots.advice.calibrated import finger_missing
from spots.calibrate import pressers
from spots.calibrate.calibration_file import FINGER, INDENTER, CalibrationFile, Marks, Rezero
from spots.calibrate.fit.points import Point
from spots.calibrate.fit.shift import drift_at, shifted
from spots.calibrate.session.carry import undrifted
from spots.calibrate.session.make import presser_of
from spots.calibrate.session.presser import Presser
from spots.calibrate.session.rezero import _drift, _evenly, marks_of
from spots.calibrate.session.session_file import Session
from spots.errors import CalibrationError, FileError
from spots_device.reading.calibration import Calibration
from spots_device.reading.calibration_lines import CalibrationError as LinesError
from spots_sim.strip.optics import Optics

PLACES = 8500.0, 42_500.0, 76_500.0
DAY = datetime(2026, 1, 1, tzinfo=timezone.utc)
SKIN = np.tile([-0.02, -0.01, 0.0, 0.0, 0.01, 0.02], (3, 1))


@pytest.fixture
def made(calibration, sensor):
    """A calibration by an indenter, not yet with a finger."""
    c = Calibration(calibration).conditions
    optics = Optics(sensor)
    columns = [optics.names.index(name) for name in c.plan]
    logs = np.log2([optics.press(x / 1000, 4.0)[columns] for x in PLACES])
    marks = Marks(place_um=PLACES, force_mN=6000.0, logs=tuple(map(tuple, logs.tolist())))
    lines = pressers.marked(calibration, INDENTER, chosen=False)
    return CalibrationFile(
        date=DAY, **c._asdict(), presser=INDENTER, lines=tuple(lines), marks=marks
    )


def rezeroed(made, presser, shifts, celsius=None, hours=1):
    """Return a calibration after a re-zero, as `session.rezero` makes it."""
    last = Rezero(
        date=DAY + timedelta(hours=hours),
        place_um=PLACES,
        shifts=tuple(map(tuple, np.asarray(shifts).tolist())),
        drift="",
        presser=presser,
        temperature_C=celsius,
    )
    original = made.original or made.lines
    new = CalibrationFile(
        **{name: getattr(made, name) for name in made.__struct_fields__}
        | {"original": original, "rezeros": [*made.rezeros, last]}
    )
    return pressers.used_by(new, presser)


def tables(lines):
    return [line for line in lines if not line.startswith("presser ")]


def test_the_file_gives_the_tables_for_each_presser(made):
    both = rezeroed(made, FINGER, SKIN)
    assert tables(both.lines) == tables(shifted(made.lines, PLACES, SKIN))
    back = pressers.used_by(both, INDENTER)
    assert tables(back.lines) == tables(made.lines)
    assert (pressers.used(both), pressers.used(back)) == (FINGER, INDENTER)
    assert pressers.used_by(back, FINGER).lines == both.lines
    with refusal(CalibrationError):
        pressers.used_by(made, FINGER)


def test_who_skips_the_finger_is_told_until_a_re_zero(made):
    def reply(one):
        return {"presser": Calibration(one.lines).presser}

    assert pressers.lacks_finger(made)
    assert "not yet with a finger; next: spots rezero" in finger_missing(reply(made))
    assert pressers.awaited(made) == FINGER
    for presser in (FINGER, INDENTER):
        new = rezeroed(made, presser, SKIN)
        assert not pressers.lacks_finger(new)
        assert finger_missing(reply(new)) is None
        assert pressers.awaited(new) == presser
    assert finger_missing({}) is None


def test_skin_is_not_told_as_drift(made):
    logs = np.array(made.marks.logs)
    assert _drift(made, FINGER, PLACES, logs, SKIN) == "first marks by a finger"
    assert _drift(made, INDENTER, PLACES, logs, SKIN) not in ("no drift", "first marks by a finger")
    once = rezeroed(made, FINGER, SKIN)
    assert _drift(once, FINGER, PLACES, logs, SKIN) == "no drift"
    paler = -0.02 * (logs - logs[0])
    assert "paler" in _drift(once, FINGER, PLACES, logs, SKIN + paler)
    assert "paler" in _drift(once, INDENTER, PLACES, logs, paler)


def test_only_the_same_presser_shows_the_effect_of_the_temperature(made):
    cool = rezeroed(made, INDENTER, 0 * SKIN, 15.0, 1)
    warm = rezeroed(cool, FINGER, SKIN, 30.0, 2)
    assert not any(line.startswith("warm") for line in warm.lines)
    warmer = rezeroed(warm, INDENTER, SKIN / 4, 25.0, 3)
    assert sum(line.startswith("warm") for line in warmer.lines) == 3


def test_presses_of_the_indenter_do_not_get_the_shift_of_the_finger(made):
    both = rezeroed(made, FINGER, SKIN)
    after = (DAY + timedelta(days=1)).isoformat()
    counts = (500.0,) * 6
    point = Point(
        kind="strain", place_um=40_000, force_mN=6000, counts=counts, variance=counts,
        saturated=False, board="ab", plan=both.plan, gain=9, exposure_us=9999, led_mA=20,
        time=after,
    )  # fmt: skip
    assert undrifted(pressers.with_presser(both, INDENTER))(point) == point
    assert undrifted(both.rezeros)(point) != point


def test_a_session_without_a_scale_is_pressed_with_a_finger():
    data = Path(__file__).parents[1] / "data"
    assert presser_of(Session(data / "none.jsonl")) == INDENTER
    session = Session(data / "none.jsonl")
    counts = (500.0,) * 6
    rough = Point(
        kind="hand", place_um=40_000, force_mN=0, counts=counts, variance=counts, saturated=False,
        board="ab", plan=("F1",) * 6, gain=9, exposure_us=9999, led_mA=20, time="",
    )  # fmt: skip
    session.points.append(rough)
    assert presser_of(session) == FINGER


class Answers:
    def __init__(self, *answers):
        self.answers, self.said = list(answers), []

    def ask(self, question):
        self.said.append(question)
        return self.answers.pop(0)

    def say(self, text):
        self.said.append(text)


@pytest.mark.parametrize(
    ("answers", "presser"),
    [([""], FINGER), (["later"], None), (["Indenter"], INDENTER), (["yes", "now"], FINGER)],
)
def test_a_person_says_what_will_press_the_strip(answers, presser):
    dialog = Answers(*answers)
    assert Presser(dialog).next_presser() == presser
    assert len(dialog.said) == 2 * len(answers) - 1


# ---- more than three marks


def test_five_marks_give_a_quadratic_drift_as_three_do():
    x_um = np.array([8500.0, 25_500, 42_500, 59_500, 76_500])
    drift = np.outer(0.01 + x_um * 2e-7 + x_um**2 * 3e-12, np.arange(1, 7))
    for place_um in (0.0, 30_000.0, 85_000.0):
        three = drift_at(place_um, x_um[::2], drift[::2])
        assert drift_at(place_um, x_um, drift) == pytest.approx(three, abs=1e-12)
    local = drift + np.outer([0, 0, 0, 0.01, 0.01], np.ones(6))
    for place_um, one in zip(x_um, local):
        assert drift_at(place_um, x_um, local) == pytest.approx(one, abs=1e-12)


def test_marks_are_chosen_at_equal_distances():
    assert [_evenly(9, count) for count in (1, 3, 5, 9)] == [
        [4], [0, 4, 8], [0, 2, 4, 6, 8], [*range(9)]
    ]  # fmt: skip
    assert _evenly(3, 5) == _evenly(9, 7) == []


def test_a_file_with_three_marks_says_that_it_has_no_five(made):
    marks_of(made, "a.toml", 3, False, None)
    with refusal(FileError):
        marks_of(made, "a.toml", 5, False, None)


# ---- the line of the board


def test_a_board_refuses_an_unknown_presser(calibration):
    for line in ("presser", "presser toe", "presser a finger", "presser finger finger"):
        with pytest.raises(LinesError):
            Calibration([*calibration, line])
