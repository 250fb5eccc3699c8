"""The wheel holds all that an installed package needs: firmware, boards, data files."""

import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The wheel's content, unpacked."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder)]
    subprocess.run([*build, str(REPOSITORY)], check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    zipfile.ZipFile(wheel).extractall(folder / "site")
    return folder / "site"


@pytest.fixture(scope="module")
def folder(installed, tmp_path_factory):
    """A folder with a recording, for the commands that take one."""
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
# Its exit code, what each command is given, and words of what it prints. No code: what a doctor
# finds depends on how busy the machine is.
RUNS = {
    "ports": (0, ["--json"], "["),
    "boards": (0, [], "virtual"),
    "build": (0, ["virtual"], "build/virtual"),
    "flash": (0, ["virtual", "--dry-run"], "copy main.py"),
    "erase": (0, ["virtual", "--yes"], "nothing to remove"),
    "doctor": (None, ["--port", "virtual"], "ok       hello"),
    "command": (0, ["--port", "virtual", "hello"], '"board": "virtual"'),
    "monitor": (0, BOARD, " s  "),
    "serve": (2, ["--linkage", "none.toml"], "cannot read the linkage file none.toml"),
    "keys": (0, ["show", "mini"], "ENTER"),
    "keyboard": (0, [*BOARD, "--dry-run"], ""),
    "wearable": (0, [*BOARD, "--dry-run"], ""),
    "controller": (0, [*BOARD, "--dry-run"], ""),
    "twin": (0, BOARD, "joints"),
    "calibrate": (2, ["joint", "--port", "virtual"], "there is no file calibration.toml"),
    "dark": (2, ["--port", "recording:none.spots"], "there is no file none.spots"),
    "rezero": (2, ["--port", "virtual"], "there is no file calibration.toml"),
    "record": (0, ["b.spots", *BOARD], "b.spots"),
    "replay": (0, ["a.spots"], " s  "),
    "info": (0, ["a.spots"], "virtual"),
    "export": (0, ["a.spots", "--to", "npz"], "a.npz"),
    "publish": (2, ["--port", "recording:none.spots"], "there is no file none.spots"),
    "subscribe": (2, ["--zenoh-config", "none.json"], "none.json"),
    "demo": (0, ["--fast", "--seconds", "1", "--json"], '"touches"'),
    "characterize": (2, ["--sensor", "none"], "cannot read the sensor file none"),
    "design": (0, ["--length-mm", "85", "--resolution-um", "20", "--rate-hz", "10"], "mm"),
}


@pytest.mark.parametrize("name", RUNS)
def test_every_command_runs_from_the_wheel_alone(installed, folder, name):
    code, arguments, words = RUNS[name]
    run = command(installed, folder, name, *arguments)
    assert code is None or run.returncode == code, run.stderr
    assert words in run.stdout + run.stderr
    assert "Traceback" not in run.stderr


def test_no_command_is_left_out(installed, tmp_path):
    said = command(installed, tmp_path, "--help").stdout
    assert set(re.findall(r"^    ([a-z]+)\b", said, re.MULTILINE)) == set(RUNS)


def test_every_board_of_the_checkout_is_in_the_wheel(installed):
    def boards(root):
        return sorted(str(p.relative_to(root)) for p in (root / "boards").rglob("*.[pt]*[yl]"))

    assert boards(installed / "spots" / "_device") == boards(REPOSITORY) != []
