"""Files of version 0.1.0 load in this version with the same meaning."""

import hashlib
import json
from collections import Counter
from pathlib import Path

import msgspec
import numpy as np
import pytest

from spots import RecordingBlocks, read_arrays
from spots.calibrate import calibration_file
from spots.calibrate.session import Session
from spots.cli import main
from spots.controller import controller_settings
from spots.keyboard import layout
from spots.link.frames import Touch
from spots.linkage import mounted
from spots.recording.recording import Recording
from spots.recording.replay import open_recording

DATA = Path(__file__).parents[1] / "data" / "0.1.0"
# Contents of these files as version 0.1.0 has read them.
EXPECTED = json.loads((DATA / "expected.json").read_text())
RUN = DATA / "run.spots"


@pytest.mark.parametrize(
    ("load", "name"),
    [
        (calibration_file.load, "calibration"),
        (calibration_file.load, "joint"),
        (controller_settings.load, "controller"),
        (mounted.load, "linkage"),
    ],
)
def test_a_file_of_settings_means_the_same(load, name):
    found = json.loads(msgspec.json.encode(load(DATA / f"{name}.toml")))
    added = {key: found.pop(key) for key in [*found] if key not in EXPECTED[name]}
    assert found == EXPECTED[name]
    assert not any(added.values())


@pytest.mark.parametrize(
    ("module", "name"),
    [
        (calibration_file, "calibration"),
        (calibration_file, "joint"),
        (controller_settings, "controller"),
        (mounted, "linkage"),
    ],
)
def test_a_file_of_settings_survives_being_written_again(tmp_path, module, name):
    loaded = module.load(DATA / f"{name}.toml")
    module.save(loaded, tmp_path / "again.toml", None)
    assert module.load(tmp_path / "again.toml") == loaded


def test_the_calibrations_of_a_linkage_are_found_beside_it():
    path = DATA / "linkage.toml"
    strips = mounted.load(path).strips(path)
    assert strips == [calibration_file.load(DATA / "joint.toml")] * 2


def test_a_layout_compiles_to_the_same_lines():
    assert list(layout.load(DATA / "layout.toml").lines) == EXPECTED["layout"]


def test_a_session_has_all_its_points():
    points = Session(DATA / "calibration.jsonl").points
    *first, count = EXPECTED["points"]
    assert len(points) == count
    found = json.loads(
        msgspec.json.encode([msgspec.structs.asdict(p) for p in points[: len(first)]])
    )
    added = [{key: p.pop(key) for key in [*p] if key not in was} for p, was in zip(found, first)]
    assert found == first
    assert not any(value for new in added for value in new.values())


def forces(lines):
    """Return the lines ``f`` of a calibration: brightness (Q20 of log2) and force in mN, (2, n)."""
    return np.array([line.split()[1:3] for line in lines if line.startswith("f ")], float).T


def test_a_session_gives_the_same_positions_and_balanced_forces(tmp_path):
    session = tmp_path / "calibration.jsonl"
    session.write_bytes((DATA / "calibration.jsonl").read_bytes())
    # All presses are in the session already, so the command only fits them.
    for kind, places in (("position", "12"), ("force", "14")):
        command = ["calibrate", kind, "--port", "virtual", "--session", str(session)]
        assert main([*command, "--places", places]) == 0
    again = calibration_file.load(tmp_path / "calibration.toml").lines
    before = EXPECTED["calibration"]["lines"]
    # Version 0.2.0 changed the knots of the force, and the force at which a touch begins.
    assert [line for line in again if line.split()[0] not in ("touch", "f")] == [
        line for line in before if line.split()[0] not in ("touch", "f")
    ]
    brightness, force_mN = forces(before)
    assert np.interp(brightness, *forces(again)) == pytest.approx(force_mN, rel=0.015, abs=2)


def test_a_recording_is_summarised_as_before(capsys, monkeypatch):
    monkeypatch.chdir(DATA)
    assert main(["info", "run.spots", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["frames"].pop("contact") == 0  # version 0.1.0 had no CONTACT frames
    for later in ("decay", "relative_force"):  # its firmware did not report these
        assert found["header"]["info"].pop(later) is None
    assert found["header"]["info"].pop("boot") == []
    assert found["header"].pop("dark") is None  # version 0.1.0 did not record it
    assert found == EXPECTED["info"]


def test_a_recording_is_exported_to_the_same_values(tmp_path):
    assert main(["export", str(RUN), "--to", "csv", "--out", str(tmp_path / "run.csv")]) == 0
    header = json.loads((tmp_path / "run-header.json").read_text(encoding="utf-8"))
    assert header["dark"] is None
    found = {
        path.name: hashlib.sha256(_as_before(path.read_bytes())).hexdigest()
        for path in tmp_path.glob("*.csv")
    }
    assert found == EXPECTED["exported_sha256"]


def _as_before(table):
    """Return a CSV file as version 0.1.0 wrote it: 0 for unknown values, names of ADCs."""
    lines = [line.split(b",") for line in table.split(b"\r\n")]
    if b"position_um" in lines[0]:
        floats = [name.endswith(b"_log2") for name in lines[0]]
        empty = [b"0.0" if is_float else b"0" for is_float in floats]
        lines = [[cell or other for cell, other in zip(line, empty)][:-1] for line in lines[:-1]]
        lines.append([b""])
    elif b"gain_code" in lines[0]:
        lines[0][-6:] = [b"counts_adc%d" % i for i in range(6)]
    return b"\r\n".join(b",".join(line) for line in lines)


def test_a_recording_is_read_by_every_reader():
    wanted = EXPECTED["info"]["frames"]
    frames = [frame for _, frame in Recording(RUN)]
    assert Counter(type(frame).__name__.lower() for frame in frames) == wanted
    arrays = read_arrays(RUN)
    sizes = len(arrays.touches), len(arrays.spectra), len(arrays.keys), len(arrays.texts)
    assert sizes == tuple(wanted[kind] for kind in ("touch", "spectrum", "key", "text"))
    assert sum(len(block.touches) for block in RecordingBlocks(RUN)) == wanted["touch"]
    with open_recording(RUN, speed=float("inf")) as board:
        assert board.info["firmware"] == "0.1.0"
        replayed = [frame for frame in board.frames() if isinstance(frame, Touch)]
    assert replayed == [frame for frame in frames if isinstance(frame, Touch)]
