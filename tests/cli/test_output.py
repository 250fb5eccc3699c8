"""Broken output pipes, interrupted starts and wrong options."""

import errno
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from support.refusals import refusal

import spots_sim
from spots import cli
from spots.errors import SettingError
from spots_sim.demo import virtual

pytestmark = pytest.mark.board

FULL = Path("/dev/full")
# Commands with short output; the last one prints with rich.
SHORT = [["--help"], ["keys", "check", "mini"], ["keys", "show", "mini"]]
TIMEOUT_S = 120


def said(arguments, stdout, unbuffered=""):
    """Run ``spots`` with `stdout` as standard output; return exit code and error message.

    `unbuffered` is the value of PYTHONUNBUFFERED.
    """
    run = subprocess.run(
        [sys.executable, "-m", "spots", *arguments],
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
        timeout=TIMEOUT_S,
        check=False,
    )
    return run.returncode, run.stderr


@pytest.fixture
def closed():
    """Writing end of a pipe whose reading end is closed."""
    reader, writer = os.pipe()
    os.close(reader)
    yield writer
    os.close(writer)


@pytest.mark.parametrize("arguments", SHORT)
def test_nobody_reads_the_output(arguments, closed):
    assert said(arguments, closed) == (0, "")


def test_a_mistake_is_told_where_nobody_reads_the_output(closed):
    code, told = said(["keys", "check", "nope.toml"], closed)
    assert code == 2
    assert "nope.toml" in told


@pytest.mark.skipif(not FULL.exists(), reason="this system has no file that is always full")
@pytest.mark.parametrize("arguments", SHORT)
def test_there_is_no_room_for_the_output(arguments):
    with FULL.open("w") as full:
        code, told = said(arguments, full)
    assert code == 2
    assert told.startswith(f"spots: cannot write the output: {os.strerror(errno.ENOSPC)}; free")
    assert told.count("\n") == 1


@pytest.mark.skipif(not FULL.exists(), reason="this system has no file that is always full")
def test_there_is_no_room_for_an_output_without_a_buffer():
    with FULL.open("w") as full:
        code, told = said(["keys", "check", "mini"], full, unbuffered="1")
    assert code == 2
    assert told.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--page", "--seconds", "3"], "--page always runs in real time"),
        (["--page", "--json"], "--page always runs in real time"),
        (["--page", "--fast"], "--page always runs in real time"),
        (["--page", "--rezero"], "leave out --seconds, --json, --fast, --rezero"),
        (["--use", "fivebar", "--page", "--warm"], "leave out --seconds, --json, --fast, --rezero"),
        (["--use", "fivebar", "--scenario", "nope"], "leave out --scenario"),
        (["--use", "fivebar", "--page", "--scenario", "nope"], "leave out --scenario"),
        (["--use", "fivebar", "--fast", "--seconds", "3"], "leave out --seconds"),
    ],
)
def test_options_of_the_demo_that_do_not_go_together(arguments, words, monkeypatch, capsys):
    for shows in ("spots_sim.demo.demo.demo", "spots_sim.demo.demo.show_page"):
        monkeypatch.setattr(shows, lambda *_: pytest.fail("shown before"))
    assert cli.main(["demo", *arguments]) == 2
    told = capsys.readouterr().err
    assert words in told
    assert told.count("\n") == 1


def test_a_virtual_board_that_is_interrupted_as_it_starts_ends_quietly(monkeypatch, capfd):
    started = []

    class Interrupted(subprocess.Popen):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            started.append(self)
            self.stdout = SimpleNamespace(readline=self._interrupt, close=self.stdout.close)

        def _interrupt(self):
            raise KeyboardInterrupt

    monkeypatch.setattr(virtual.subprocess, "Popen", Interrupted)
    with pytest.raises(KeyboardInterrupt):
        virtual.start_simulator("default", "demo", 0)
    (process,) = started
    assert process.returncode == 0
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(("sensor", "code"), [("default", 0), ("nope", 2)])
def test_a_virtual_board_whose_starter_is_gone_ends_quietly(sensor, code, closed):
    run = subprocess.run(
        [sys.executable, "-m", "spots_sim.board.realtime", sensor, "demo", "0", "virtual", "", "1"],
        stdin=subprocess.DEVNULL,
        stdout=closed,
        stderr=subprocess.PIPE,
        env=os.environ | {"PYTHONUNBUFFERED": ""},
        timeout=TIMEOUT_S,
        check=False,
    )
    assert run.stderr == b""
    assert run.returncode == code


def test_a_seed_that_is_none():
    with refusal(SettingError):
        spots_sim.open(seed=-1)


def test_a_folder_for_calibrations_that_does_not_exist_is_one_sentence(
    monkeypatch, capsys, tmp_path
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SPOTS_CALIBRATIONS", str(tmp_path / "missing"))
    assert cli.main(["calibrate", "--rough", "--port", "virtual"]) == 2
    assert "SPOTS_CALIBRATIONS names" in capsys.readouterr().err
