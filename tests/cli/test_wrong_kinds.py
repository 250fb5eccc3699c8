"""A file of another kind is named as what it is, by every command that reads a file."""

import os
from pathlib import Path

import pytest

from spots import cli
from spots.common import kinds
from spots.controller import controller_settings
from spots.deploy.staging import BOARDS
from spots.keyboard.layout import FOLDER as LAYOUTS
from spots.wearable.wearable import FOLDER as GESTURES
from spots_sim.strip.files import DATA as SIMULATED

DATA = Path(__file__).parents[1] / "data"

FILES = {
    "a recording": [DATA / "run.spots"],
    "a session file": [DATA / "joint.jsonl"],
    "a calibration file": [DATA / "joint.toml"],
    "a layout file": [*LAYOUTS.glob("*.toml")],
    "a linkage file": [DATA / "linkage.toml", *(SIMULATED / "linkages").glob("*.toml")],
    "a sensor file": [*(SIMULATED / "sensors").glob("*.toml")],
    "a scenario file": [*(SIMULATED / "scenarios").glob("*.toml")],
    "a path file": [*(SIMULATED / "paths").glob("*.toml")],
    "a change file": [*(SIMULATED / "changes").glob("*.toml")],
    "a settings file": [controller_settings.DEFAULT],
    "a gestures file": [*GESTURES.glob("*.toml")],
    "a board file": [*BOARDS.glob("*/board.toml")],
}
# Command lines with FILE in the place of a file, by the kind of this file.
LINES = {
    "a recording": ["info FILE", "export FILE --to npz", "replay FILE", "monitor --port rec:FILE"],
    "a session file": ["calibrate --session FILE --out new.toml"],
    "a calibration file": ["record new.spots --calibration FILE", "rezero FILE"],
    "a layout file": ["keys show FILE", "keys push FILE", "keyboard --layout FILE"],
    "a linkage file": ["twin --linkage FILE --port a --port b", "serve --linkage FILE"],
    "a sensor file": ["demo --fast --sensor FILE", "monitor --port virtual --sensor FILE"],
    "a scenario file": ["demo --fast --scenario FILE"],
    "a path file": ["twin --path FILE"],
    "a change file": ["demo --fast --change FILE", "characterize --change FILE"],
    "a settings file": ["controller --settings FILE"],
    "a gestures file": ["wearable --gestures FILE"],
    "a table of points": ["twin --linkage LINKAGE --calibrate FILE"],
    "a Zenoh configuration": ["subscribe --zenoh-config FILE"],
}
CASES = [(kind, line) for kind, lines in LINES.items() for line in lines]
NAMES = [line for _, line in CASES]
OTHERS = {"an MCAP file": b"\x89MCAP0\r\n\1", "a ZIP or NPZ file": b"PK\3\4\0\0\xff"}


def refused(capsys, line, file):
    """Run ``spots`` with a file that it must refuse with one line; return this line."""
    words = line.replace("rec:", "recording:").replace("LINKAGE", str(DATA / "linkage.toml"))
    assert cli.main([word.replace("FILE", str(file)) for word in words.split()]) == 2
    output = capsys.readouterr()
    assert output.err.count("\n") == 1
    return output.err


@pytest.fixture(autouse=True)
def _working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("ZENOH_CONFIG", raising=False)


@pytest.mark.parametrize("kind", FILES)
def test_each_kind_of_file_is_recognised(kind):
    assert FILES[kind]
    for path in FILES[kind]:
        assert kinds.kinds_of(path.read_bytes()) == [kind], path


@pytest.mark.board
@pytest.mark.parametrize(("wanted", "line"), CASES, ids=NAMES)
def test_a_file_of_another_kind_is_named(wanted, line, capsys, tmp_path):
    for kind, content in OTHERS.items():
        (tmp_path / "other.toml").write_bytes(content)
        assert f"other.toml is {kind}, not {wanted}: " in refused(capsys, line, "other.toml")
    for kind, (path, *_) in FILES.items():
        if kind != wanted:
            (tmp_path / "other.toml").write_bytes(path.read_bytes())
            assert f"other.toml is {kind}, not {wanted}: " in refused(capsys, line, "other.toml")


@pytest.mark.parametrize(("wanted", "line"), CASES, ids=NAMES)
def test_what_is_not_a_readable_file_is_named(wanted, line, capsys, tmp_path):
    (tmp_path / "folder").mkdir()
    assert "folder is a folder, not a" in refused(capsys, line, "folder")
    assert "/dev/null is not a regular file: name" in refused(capsys, line, "/dev/null")
    (tmp_path / "latin.toml").write_bytes(b"caf\xe9 = 1\n")
    error = refused(capsys, line, "latin.toml")
    assert "latin.toml" in error
    assert "no such file" not in error.lower()


@pytest.mark.parametrize(("wanted", "line"), CASES, ids=NAMES)
def test_a_file_that_may_not_be_read_is_named(wanted, line, capsys, tmp_path, monkeypatch):
    real = os.open
    (tmp_path / "locked.toml").write_text("a = 1")

    def refuse(path, *more, **options):
        if str(path) == "locked.toml":
            raise PermissionError(13, "Permission denied", path)
        return real(path, *more, **options)

    monkeypatch.setattr(os, "open", refuse)
    error = refused(capsys, line, "locked.toml")
    assert "locked.toml" in error
    assert "Permission denied" in error
    assert "name" in error


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("run.spots", "is a recording, not a serial port: give recording:"),
        ("joint.toml", "is a calibration file, not a serial port: 'spots ports' lists the ports"),
        ("", "is a folder, not a serial port: 'spots ports' lists the ports"),
        ("/dev/null", "is another device, not a serial port: 'spots ports' lists the ports"),
    ],
)
@pytest.mark.parametrize("line", ["monitor", "command hello", "erase pico --yes"])
def test_a_port_that_is_no_port_is_named(line, name, says, capsys):
    assert says in refused(capsys, f"{line} --port FILE", DATA / name)
