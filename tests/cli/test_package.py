"""The wheel contains everything that an installed package needs: firmware, boards, data files."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from test_readme import LINES, WALKED

REPOSITORY = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def folder(installed, tmp_path_factory):
    """A folder with a recording, for commands that need one."""
    folder = tmp_path_factory.mktemp("work")
    run = command(installed, folder, "record", "a.spots", "--port", "virtual", "--seconds", "0.5")
    assert run.returncode == 0, run.stderr
    return folder


def command(installed, folder, *arguments):
    program = "import sys, spots.cli; print(spots.__file__); sys.exit(spots.cli.main())"
    run = subprocess.run(
        [sys.executable, "-c", program, *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(installed)},
        capture_output=True,
        text=True,
        timeout=120,
        stdin=subprocess.DEVNULL,
    )
    assert run.stdout.startswith(str(installed))
    return run


BOARD = ("--port", "virtual", "--seconds", "0.5")
# Commands that test_readme.py does not run from the wheel, by name: exit code, arguments, and words
# of the output.
RUNS = {
    "build": (0, ["virtual"], "build/virtual"),
    "erase": (0, ["virtual", "--yes"], "nothing to remove"),
    "keys": (0, ["show", "mini"], "ENTER"),
    "wearable": (0, [*BOARD, "--dry-run"], ""),
    "dark": (2, ["--port", "recording:none.spots"], "there is no file none.spots"),
    "rezero": (2, ["--port", "virtual"], "there is no file calibration.toml"),
    "replay": (0, ["a.spots"], " s  "),
    "subscribe": (2, ["--zenoh-config", "none.json"], "none.json"),
}


README = {line.split()[1] for line in (*LINES, *WALKED)}


@pytest.mark.parametrize("name", RUNS)
def test_every_command_runs_from_the_wheel_alone(installed, folder, name):
    code, arguments, words = RUNS[name]
    run = command(installed, folder, name, *arguments)
    assert run.returncode == code, run.stderr
    assert words in run.stdout + run.stderr
    assert "Traceback" not in run.stderr


def test_no_command_is_left_out(installed, tmp_path):
    said = command(installed, tmp_path, "--help").stdout
    assert set(re.findall(r"^    ([a-z]+)\b", said, re.MULTILINE)) == {*RUNS, *README}


def test_every_board_of_the_checkout_is_in_the_wheel(installed):
    def boards(root):
        return sorted(str(p.relative_to(root)) for p in (root / "boards").rglob("*.[pt]*[yl]"))

    assert boards(installed / "spots" / "_device") == boards(REPOSITORY) != []
