"""Marks: moments that a program or a person names during a recording; they are in every export."""

from __future__ import annotations

import csv
import io
import json
import os
import pty
import select
import signal
import sys
from contextlib import suppress

import numpy as np
import pytest
from mcap.reader import make_reader
from support.refusals import refusal

import spots
from spots import cli
from spots.errors import SettingError, StateError
from spots.recording.export import export
from spots.recording.recorder import Recorder

pytestmark = pytest.mark.board


@pytest.fixture(scope="module")
def marked(opened, tmp_path_factory):
    """A recording with two marks, and the times at which they were made, from its beginning."""
    path = tmp_path_factory.mktemp("marked") / "run.spots"
    board, made_s = opened(), []
    with Recorder(board, path):
        begun_s = board.now_s()
        board.stream("touch", "spectrum")
        for text in ("trial 1", "trial 2, förster"):
            for _ in board.frames(0.7):
                pass
            board.mark(text)
            made_s.append(board.now_s() - begun_s)
        for _ in board.frames(0.7):
            pass
    return path, made_s


def test_marks_are_read_with_their_times(marked):
    path, made_s = marked
    begun_s = spots.Recording(path).header.host_s
    marks = spots.read_arrays(path).marks
    assert [one.text for one in marks] == ["trial 1", "trial 2, förster"]
    assert [one.time_s - begun_s for one in marks] == pytest.approx(made_s, abs=1e-5)
    recording = spots.Recording(path)
    for _ in range(2):
        assert len(list(recording)) > 100
        assert recording.marks == marks
        assert not recording.doubts


def test_csv_npz_and_mcap_contain_the_marks(marked, tmp_path):
    path, made_s = marked
    export(path, "csv", tmp_path / "run.csv")
    rows = list(csv.DictReader((tmp_path / "run-mark.csv").open(encoding="utf-8")))
    assert [row["mark"] for row in rows] == ["trial 1", "trial 2, förster"]
    assert [float(row["time_s"]) for row in rows] == pytest.approx(made_s, abs=1e-5)
    export(path, "npz", tmp_path / "run.npz")
    with np.load(tmp_path / "run.npz") as arrays:
        assert arrays["mark"]["mark"].tolist() == ["trial 1", "trial 2, förster"]
        assert arrays["mark"]["time_s"] == pytest.approx(made_s, abs=1e-5)
    export(path, "mcap", tmp_path / "run.mcap")
    with (tmp_path / "run.mcap").open("rb") as file:
        found = [
            json.loads(message.data)["mark"]
            for _, _, message in make_reader(file).iter_messages("/spots/marks")
        ]
    assert found == ["trial 1", "trial 2, förster"]


def test_a_table_of_pandas_has_nan_and_marks(marked):
    path, made_s = marked
    table = spots.read_dataframe(path)
    touches = spots.read_arrays(path).touches
    assert len(table) == len(touches)
    assert (table.position_um.isna().to_numpy() == ~touches["known"]).all()
    known = touches["known"]
    assert (table.position_um.to_numpy()[known] == touches["position_um"][known]).all()
    assert not table.force_mN.isna().all()
    assert [*dict.fromkeys(table.mark)] == ["", "trial 1", "trial 2, förster"]
    assert table.time_s[table.mark == "trial 1"].min() == pytest.approx(made_s[0], abs=0.02)
    spectra = spots.read_dataframe(path, "spectrum")
    assert next(name for name in spectra if name.startswith("counts")) == "counts_F3"
    counts = spots.read_arrays(path).spectra["counts"]
    assert (spectra[["counts_F3", "counts_F8"]].to_numpy() == counts[:, [0, 5]]).all()
    assert spots.read_dataframe(path, "mark").mark.tolist() == ["trial 1", "trial 2, förster"]
    assert spots.read_dataframe(path, "text").content[0]["re"] == "stream"
    assert not len(spots.read_dataframe(path, "contact"))
    with refusal(SettingError):
        spots.read_dataframe(path, "touches")


def test_the_columns_of_pandas_are_those_of_the_exports(marked, tmp_path):
    export(marked[0], "npz", tmp_path / "run.npz")
    with np.load(tmp_path / "run.npz") as arrays:
        for kind in ("touch", "spectrum", "text", "mark"):
            table = spots.read_dataframe(marked[0], kind)
            names = [name for name in table.columns if name != "mark" or kind == "mark"]
            assert names == [*arrays[kind].dtype.names]
            for name in set(names) - {"content", "mark"}:
                if kind == "touch" and name in ("position_um", "force_mN"):
                    continue
                assert np.array_equal(table[name], arrays[kind][name], equal_nan=True), name


def test_a_mark_needs_a_text_and_a_recording(opened, tmp_path):
    board = opened()
    with refusal(StateError):
        board.mark("trial")
    with Recorder(board, tmp_path / "run.spots"):
        for wrong in ("", "  ", 3, "x" * 65):
            with refusal(SettingError):
                board.mark(wrong)
        board.mark("😀" * 64)
    assert len(spots.read_arrays(tmp_path / "run.spots").marks[0].text) == 64


def test_lines_of_standard_input_mark_a_recording(opened, tmp_path, monkeypatch, capsys):
    board = opened()
    board.close = lambda: None
    monkeypatch.setattr(cli.arguments, "open_board", lambda options: board)
    monkeypatch.setattr(sys, "stdin", io.StringIO("first\n\n"))
    path = tmp_path / "run.spots"
    assert cli.main(["record", str(path), "--seconds", "1", "--marks"]) == 0
    assert [one.text for one in spots.read_arrays(path).marks] == ["first", "mark 2"]
    assert "marked: mark 2" in capsys.readouterr().err


def test_the_key_m_marks_a_recording_of_monitor(tmp_path):
    path = tmp_path / "run.spots"
    pid, terminal = pty.fork()
    if not pid:
        command = ["monitor", "--port", "virtual", "--seconds", "60", "--record"]
        os.execv(sys.executable, [sys.executable, "-m", "spots", *command, str(path)])
    try:
        pressed = False
        while select.select([terminal], [], [], 60)[0]:
            try:
                shown = os.read(terminal, 65536)
            except OSError:
                break
            if path.exists() and path.stat().st_size > 20_000 and not pressed:
                os.write(terminal, b"xm")
                pressed = True
            elif pressed and b'"mark"' in path.read_bytes():
                os.kill(pid, signal.SIGINT)
        assert pressed, shown
    finally:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        os.close(terminal)
    assert [one.text for one in spots.read_arrays(path).marks] == ["mark 1"]
