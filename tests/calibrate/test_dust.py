"""Strips with dust: sessions subtract its light, and state where it is."""

import argparse
import io

import numpy as np
import pytest
from rich.console import Console
from support.hand_session import LONG
from support.refusals import refusal
from support.sensors import replaced

from spots.calibrate import calibration_file as file
from spots.calibrate.fit import fit as fitting
from spots.calibrate.fit.presses import Presses
from spots.calibrate.session import baseline, steps
from spots.calibrate.session.bench import Bench
from spots.calibrate.session.guide import Guide
from spots.calibrate.session.make import make
from spots.calibrate.session.presser import Presser
from spots.calibrate.session.rezero import rezero
from spots.calibrate.session.session_file import Session, settings
from spots.errors import CalibrationError
from spots.link.frames import Touch
from spots_device.reading.calibration import Calibration
from spots_device.reading.decode import DARK_SAMPLES
from spots_sim.person.person import Habits, Person, follow
from spots_sim.person.stage import Stage
from spots_sim.person.stage_presser import StagePresser

PLAN = "F3,F4,F5,F6,F7,F8"
PATIENCE_S = 25.0  # timeout of a press; longer than the delays of the simulated person
PLACES_MM = np.linspace(6.0, 79.0, 8)


class Room(io.StringIO):
    """A simulated person at a plain terminal, who reads ruler and scale exactly."""

    def __init__(self, stage, seed):
        super().__init__()
        self.held = stage.held
        self.person = Person(self.move, stage.length_um / 1000, Habits(), seed)
        self.question = ""

    def move(self, way):
        follow(self.held, way)

    def write(self, text):
        self.question = text.strip() or self.question
        for line in text.splitlines():
            self.person.hear(line)
        return super().write(text)

    def readline(self):
        if "draw marks" in self.question:
            return "later\n"  # only the presses of the indenter count
        return self.person.answer(self.question) + "\n"


def by_hand(stage, path, kind):
    room = Room(stage, 1)
    shown = Guide(Console(file=room, width=300), stdin=room)
    presser = Presser(shown)
    presser.patience_s = PATIENCE_S
    _session(stage, presser, shown, path, [kind])
    room.move([])
    del stage.held.presses
    return room.getvalue()


def by_stage(stage, path):
    shown = Guide(Console(file=io.StringIO(), width=300))
    _session(stage, StagePresser(stage), shown, path, ["position", "force"])
    return shown._console.file.getvalue()


def _session(stage, presser, shown, path, kinds):
    bench = Bench(stage.reader, presser, shown, stage.length_um, path.with_suffix(".toml"))
    options = argparse.Namespace(channels=PLAN, keep_settings=False)
    for kind in kinds:
        steps.calibrate(bench, Session(path), kind, steps.COUNTS[kind][0], None, options)


def errors_um(stage, path, force_mN=1000.0):
    """Return the errors of the board's readings, and the number of readings without a touch."""
    made = file.load(path.with_suffix(".toml"))
    stage.board.command("set " + settings(made.conditions))
    file.send(stage.board, made)
    stage.board.command("dark", timeout_s=5)
    stage.board.command("stream touch")
    found, missing = [], 0
    for place_mm in PLACES_MM:
        stage.release()
        for _ in stage.board.frames(0.3):
            pass
        stage.press(1000 * place_mm, force_mN)
        frames = [f for f in stage.board.frames(0.3) if isinstance(f, Touch)][3:]
        missing += sum(not f.touching for f in frames)
        found += [f.position_um - 1000 * place_mm for f in frames if f.touching]
    return np.array(found), missing


def dusty(sensor, percent, place_mm):
    return replaced(sensor, contact={"dust": ((place_mm, percent),)})


@pytest.mark.board
@pytest.mark.parametrize(
    ("kind", "percent", "place_mm"),
    [
        ("stage", 2.0, 20.0),
        ("rough", 0.3, 70.0),
    ],
)
def test_dust_is_subtracted_and_located(sensor, tmp_path, kind, percent, place_mm):
    path = tmp_path / "a.jsonl"
    exposure = LONG if kind == "stage" else ""
    with Stage(dusty(sensor, percent, place_mm), seed=3, settings=exposure) as stage:
        said = by_stage(stage, path) if kind == "stage" else by_hand(stage, path, kind)
        off_um, missing = errors_um(stage, path)
    lines = file.load(path.with_suffix(".toml")).lines
    light = Calibration(lines).baseline
    assert max(light) > 64
    where = float(said.rpartition("light at ")[2].split(" mm without a press: dust, or")[0])
    assert where == pytest.approx(place_mm, abs=4.0)
    assert "light without a press, up to" in said
    assert missing == 0
    assert np.abs(off_um).mean() < {"stage": 110, "rough": 1000}[kind]


@pytest.mark.board
def test_a_rezero_measures_new_dust(sensor, tmp_path):
    path = tmp_path / "a.jsonl"
    with Stage(sensor, seed=3, settings=LONG) as stage:
        by_stage(stage, path)
        made = file.load(path.with_suffix(".toml"))
        stage.held.leak_share, stage.held.leak_mm = 0.003, 30.0
        shown = Guide(Console(file=io.StringIO()))
        bench = Bench(stage.reader, StagePresser(stage), shown, stage.length_um, path)
        new = rezero(bench, made)
        file.save(new, path.with_suffix(".toml"), made)
        off_um, missing = errors_um(stage, path)
    assert not Calibration(made.lines).baseline
    assert max(Calibration(new.lines).baseline) > 300
    assert new.original == made.original
    assert missing == 0
    assert np.abs(off_um).mean() < 110


def test_a_clean_strip_gets_no_line(staged):
    assert "without a press" not in (staged / "said").read_text()
    assert not any(line.startswith("rest") for line in file.load(staged / "a.toml").lines)
    assert "rest" not in (staged / "a.jsonl").read_text()


def test_a_calibration_without_room_for_spectra_says_so(staged, monkeypatch):
    for lines_max, count in ((360, 0), (100, 1)):
        monkeypatch.setattr(fitting, "_LINES_MAX", lines_max)
        said = []
        make(Session(staged / "a.jsonl"), said.append)
        assert "\n".join(said).count("no room for the spectra of presses") == count


@pytest.mark.board
def test_too_much_light_is_refused_with_its_place(sensor, tmp_path):
    path = tmp_path / "a.jsonl"
    strip = dusty(sensor, 12.0, 35.0)
    with Stage(strip, seed=3) as stage, refusal(CalibrationError) as refused:
        by_stage(stage, path)
    assert "light at 3" in str(refused.value)  # 35 mm, or near it
    assert len(Session(path).points) <= 9


@pytest.mark.board
def test_a_person_is_refused_too_much_light_at_the_third_press(sensor, tmp_path):
    path = tmp_path / "a.jsonl"
    strip = dusty(sensor, 12.0, 35.0)
    with Stage(strip, seed=3) as stage, refusal(CalibrationError) as refused:
        by_hand(stage, path, "fine")
    assert "light at 3" in str(refused.value)
    assert len(Session(path).points) == 3


def test_the_place_is_found_between_presses():
    places = np.array([0.0, 40_000.0, 80_000.0])
    logs = np.array([[10.0, 10.0, 11.0], [8.0, 9.0, 10.8], [6.0, 8.0, 10.6]])
    firm = Presses(places, np.full(3, 6000.0), 2**logs, logs, np.zeros(3, bool))
    light = 0.01 * 2 ** (logs[0] + (logs[1] - logs[0]) / 2)
    assert baseline._found(light, firm) == pytest.approx((20_000.0, 0.01), rel=0.01)


def test_the_line_is_replaced_and_omitted_without_light():
    assert baseline.line([1.0, 0.5, 0, 0, 0, 0]) == [f"rest {DARK_SAMPLES} 32 0 0 0 0"]
    assert baseline.line([0.0] * 6) == baseline.line(()) == []
    assert baseline.replaced(["made 9", "rest 1 2 3 4 5 6"], ()) == ["made 9"]
