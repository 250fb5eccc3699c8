"""Ctrl-C in a command that asks for presses: a sentence about what is stored and how to go on."""

import shutil
from pathlib import Path

import pytest

from spots.calibrate.session import calibrate, dark
from spots.cli import main
from spots.controller import controller_setup
from spots_linkage import twin
from spots_sim.person.stage_presser import StagePresser

FILES = Path(__file__).parents[1] / "data"


def stop(*arguments, **options):
    raise KeyboardInterrupt


@pytest.fixture(autouse=True)
def inside(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.board
@pytest.mark.parametrize(
    ("presses", "sentence"),
    [
        (0, "nothing is stored; the same command begins again"),
        (1, "strip.jsonl has 1 press; the same command goes on after the last one"),
        (3, "strip.jsonl has 3 presses; the same command goes on after the last one"),
    ],
)
def test_a_session_names_its_file_and_goes_on(presses, sentence, monkeypatch, capsys):
    press, left = StagePresser.press, [presses]

    def some(self, *arguments, **options):
        if not left[0]:
            raise KeyboardInterrupt
        left[0] -= 1
        return press(self, *arguments, **options)

    command = ["calibrate", "--rough", "--session", "strip.jsonl", "--port", "virtual"]
    with monkeypatch.context() as patched:
        patched.setattr(StagePresser, "press", some)
        assert main(command) == 130
    assert capsys.readouterr().err.endswith(f"spots: stopped: {sentence}\n")
    if presses == 3:
        stored = Path("strip.jsonl").read_text().splitlines()
        assert main(command) == 0
        assert Path("strip.jsonl").read_text().splitlines()[: len(stored)] == stored


@pytest.mark.board
def test_dark_names_the_led(monkeypatch, capsys):
    monkeypatch.setattr(dark, "take_dark", stop)
    assert main(["dark", "--port", "virtual"]) == 130
    assert "nothing is saved; plug the LED in again" in capsys.readouterr().err


def test_a_re_zero_names_the_unchanged_file(monkeypatch, capsys):
    shutil.copy(FILES / "joint.toml", "a.toml")
    monkeypatch.setattr(calibrate, "rezero", stop)
    assert main(["rezero", "a.toml", "--port", "virtual"]) == 130
    assert "a.toml and the board are unchanged; run the command again" in capsys.readouterr().err


@pytest.mark.board
def test_the_set_up_of_a_controller_has_written_nothing(monkeypatch, capsys):
    monkeypatch.setattr(controller_setup, "_touch", stop)
    command = ["controller", "--calibrate", "--settings", "c.toml", "--port", "virtual"]
    assert main(command) in (130, -2)
    assert "nothing is written; the same command begins again" in capsys.readouterr().err
    assert not Path("c.toml").exists()


@pytest.mark.parametrize(
    ("there", "sentence"), [(True, "p.csv keeps its points"), (False, "nothing is stored")]
)
def test_measured_points_stay(there, sentence, monkeypatch, capsys):
    if there:
        Path("p.csv").touch()
    monkeypatch.setattr(twin, "measure", stop)
    twin._measure(None, Path("p.csv"), "arm.toml")
    assert f"stopped: {sentence}; the same command adds more points" in capsys.readouterr().out
