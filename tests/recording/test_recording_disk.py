"""Errors of the disk during a recording reach the user once, and the file stays readable."""

import errno
import os
from types import SimpleNamespace

import pytest
from support.refusals import refusal

from spots import SpotsError
from spots.errors import FileError
from spots.link.board import Board
from spots.recording import disk
from spots.recording.recorder import Recorder
from spots.recording.recording import Recording
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.scenario import Held

pytestmark = pytest.mark.board


@pytest.fixture
def board(sensor):
    with Board(LockstepLink(sensor, Held())) as board:
        board.command("stream touch")
        yield board


def refuse_sync(monkeypatch, number):
    def fsync(handle):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(disk, "os", SimpleNamespace(fsync=fsync))


@pytest.mark.parametrize("number", [errno.EDQUOT, errno.EIO, errno.ENOSPC])
def test_a_disk_that_does_not_store_is_reported_while_recording(
    board, tmp_path, monkeypatch, number
):
    refuse_sync(monkeypatch, number)
    monkeypatch.setattr(disk, "_SYNC_EVERY_S", 0.001)
    path = tmp_path / "a.spots"
    with pytest.raises(SpotsError) as raised, Recorder(board, path):
        list(board.frames(1000.0))
    assert os.strerror(number) in str(raised.value)
    assert "its last seconds may be missing" in str(raised.value)
    assert len(list(Recording(path))) < 90_000
    assert list(board.frames(0.1))  # the board is still read


def test_a_disk_that_does_not_store_the_end_is_reported(board, tmp_path, monkeypatch):
    refuse_sync(monkeypatch, errno.EDQUOT)
    recorder = Recorder(board, tmp_path / "a.spots")
    list(board.frames(0.2))
    with refusal(FileError):
        recorder.stop()
    recorder.stop()  # reported once


def test_a_file_system_without_sync_is_no_error(board, tmp_path, monkeypatch):
    refuse_sync(monkeypatch, errno.EINVAL)
    with Recorder(board, tmp_path / "a.spots"):
        list(board.frames(0.2))
    assert Recording(tmp_path / "a.spots").header


def test_a_program_can_take_the_error_and_read_on(board, tmp_path, full_disk):
    path, errors = tmp_path / "a.spots", []
    recorder = Recorder(board, path)
    recorder.on_error = errors.append
    with full_disk(path.stat().st_size + 2000):
        frames = len(list(board.frames(5.0)))
    assert frames > 400
    (error,) = errors
    assert "nothing more can be written (File too large); the file has everything" in str(error)
    assert 10 < len(list(Recording(path))) < frames
