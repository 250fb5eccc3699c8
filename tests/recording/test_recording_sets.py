"""Rotation of recordings: each file of a set is readable alone; all files are one recording."""

import time

import msgspec
import pytest
from support.frames import stream
from support.recording_pieces import at, spread
from support.reels import INFO, record, recorder, replayed
from support.refusals import refusal

from spots.errors import FileError
from spots.recording.recording import Recording
from spots.recording.writer import Writer


@pytest.fixture
def rotated(tmp_path):
    """Path of a recording with several files, in which the board's time wraps, and its frames."""
    path = tmp_path / "run.spots"
    seen, _ = spread(path, [at(1000 * i, i) for i in range(200)])
    return path, seen


def test_a_set_gives_every_frame_once_and_in_order(rotated):
    path, seen = rotated
    got, recording = replayed(path)
    names = [file.name for file in recording.paths]
    assert names[:3] == ["run.spots", "run-001.spots", "run-002.spots"]
    assert len(names) >= 3
    assert got == seen
    assert (recording.stats.lost, recording.stats.bad_crc) == (0, 0)
    assert recording.complete
    assert all(file.stat().st_size <= 2500 + 100 for file in recording.paths)  # and the last note
    arrived_s = [arrived_s for arrived_s, _ in recording]
    assert arrived_s == [pytest.approx(1000 + 1000 * i, abs=1e-5) for i in range(1, 201)]


def test_every_file_of_a_set_has_the_right_times_by_itself(rotated):
    path, seen = rotated
    files = Recording(path).paths
    one_by_one = []
    for file in files[1:]:
        frames, recording = replayed(file)
        assert recording.paths == [file]
        one_by_one += frames
    assert one_by_one == seen[-len(one_by_one) :]
    assert len(one_by_one) > 100


def test_a_missing_file_of_a_set_is_told(rotated):
    path, _ = rotated
    path.with_name("run-001.spots").unlink()
    with refusal(FileError, file="run-001.spots"):
        Recording(path)
    assert replayed(path.with_name("run-002.spots"))[0]
    alone = path.with_name("alone.spots")
    path.rename(alone)  # as the message advises
    assert replayed(alone)[0]


def test_files_of_another_recording_are_left_alone(rotated, tmp_path):
    path, _ = rotated
    path.unlink()
    seen, _ = record(path, stream(3))
    path.with_name("run-007.spots").write_bytes(b"no recording")
    assert replayed(path)[0] == seen


def test_a_file_that_breaks_off_within_a_set_costs_its_rest_alone(rotated):
    path, seen = rotated
    second = Recording(path).paths[1]
    inside = len(replayed(second)[0])
    second.write_bytes(second.read_bytes()[:-1])
    assert replayed(path)[0] == seen  # only the last delimiter is missing
    second.write_bytes(second.read_bytes()[:-1])
    got, recording = replayed(path)
    assert len(got) == len(seen) - 1
    assert set(got) < set(seen)
    assert recording.stats.lost == 1
    assert recording.cut_bytes == len(at(0, 0)) - 2
    assert len(replayed(second)[0]) == inside - 1


def test_a_set_never_writes_over_a_file(tmp_path):
    path = tmp_path / "run.spots"
    other = tmp_path / "run-001.spots"
    tap = recorder(path, stream(200), rotate_bytes=1800)
    other.write_text("mine")  # another program creates this file during the recording
    with refusal(FileError, file="run-001.spots"):
        all(tap.read(1) for _ in range(200))
    assert other.read_text() == "mine"
    assert tap.read(1)  # the link still works
    assert 10 < len(replayed(path)[0]) < 100


@pytest.mark.parametrize("name", ["run-001.spots", "run-017.spots", "run-1000.spots"])
def test_a_set_does_not_begin_where_one_of_its_later_files_is_in_the_way(tmp_path, name):
    (tmp_path / name).write_text("mine")
    for other in ("run-01.spots", "run-000.spots", "run-001.csv", "rerun-001.spots"):
        (tmp_path / other).write_text("in nobody's way")
    before = sorted(tmp_path.iterdir())
    with refusal(FileError, file=name):
        recorder(tmp_path / "run.spots", stream(1), rotate_bytes=1600)
    assert sorted(tmp_path.iterdir()) == before
    (tmp_path / name).unlink()
    recorder(tmp_path / "run.spots", stream(1), rotate_bytes=1600).stop()


def test_a_header_that_is_none_makes_no_file(tmp_path):
    with pytest.raises(msgspec.ValidationError):
        Writer(time.monotonic, tmp_path / "run.spots", lambda: {"info": INFO, "clock": {}})
    assert list(tmp_path.iterdir()) == []
