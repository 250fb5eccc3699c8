"""Damaged, cut, joined and swapped recordings: what is wrong is printed, and never "complete"."""

import math
import warnings

import pytest
from support.recording_pieces import at, spread
from support.refusals import refusal

from spots import Recording, RecordingBlocks, cli, open_recording, read_arrays
from spots.errors import FileError
from spots.link.decoder import Decoder
from spots.link.frames import Note, Touch
from spots.recording import replay
from spots.recording.recorder import Recorder


@pytest.fixture(scope="module")
def pieces(seen):
    """Bytes of the recording `seen`, and pairs (frame, its bytes with the delimiter)."""
    data = seen.path.read_bytes()
    decoder = Decoder()
    found = [(decoder.feed(one + b"\0"), one + b"\0") for one in data.split(b"\0") if one]
    return data, [(frames[0] if frames else None, one) for frames, one in found]


def without(pieces, dropped):
    """Return the bytes of a recording without the frames of which `dropped` is true."""
    kept = []
    frames = 0
    for found, data in pieces[1]:
        is_frame = not isinstance(found, Note)
        if not (is_frame and dropped(frames)):
            kept.append(data)
        frames += is_frame
    return b"".join(kept)


def damaged(kind, pieces):
    data, found = pieces
    touch = next(one for frame, one in found if isinstance(frame, Touch))
    return {
        "cut": data[: len(data) // 2],
        "end": data[: -len(found[-1][1])],
        "hole at the start": without(pieces, lambda i: i < 7),
        "hole": without(pieces, lambda i: 40 <= i < 47),
        "flipped": data.replace(touch, touch[:5] + bytes([touch[5] ^ 1 or 1]) + touch[6:], 1),
        "appended": data + data,
    }[kind]


DOUBTS = {
    "cut": "it has no end mark: it was cut off, or is still being recorded",
    "end": "it has no end mark: it was cut off, or is still being recorded",
    "hole at the start": "7 of its frames are missing",
    "hole": "7 of its frames are missing",
    "flipped": "1 of its frames are damaged, and 1 of its frames are missing",
    "appended": "data follows its end mark: two recordings were joined",
}


@pytest.mark.parametrize("kind", DOUBTS)
def test_what_is_wrong_with_a_recording_is_printed(kind, pieces, tmp_path, capsys):
    path = tmp_path / "a.spots"
    path.write_bytes(damaged(kind, pieces))
    for line in (f"export {path} --to npz", f"replay {path} --speed inf"):
        assert cli.main(line.split()) == 0
        error = capsys.readouterr().err
        assert f"spots: {path} is read to its end, but " in error
        assert DOUBTS[kind] in error
        assert error.count("\n") == 1


@pytest.mark.parametrize("kind", ["cut", "hole", "appended"])
def test_a_command_that_plays_a_recording_prints_what_is_wrong(
    kind, pieces, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(replay, "open_port", lambda rest, *_: open_recording(rest, math.inf))
    path = tmp_path / "a.spots"
    path.write_bytes(damaged(kind, pieces))
    lines = ["monitor", "keyboard --dry-run", "wearable --dry-run", "controller --dry-run"]
    for line in lines:
        assert cli.main([*line.split(), "--port", f"recording:{path}"]) == 0
        error = capsys.readouterr().err
        assert f"spots: {path} is read to its end, but " in error
        assert DOUBTS[kind] in error
    assert cli.main(["monitor", "--seconds", "0.05", "--port", f"recording:{path}"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("kind", DOUBTS)
def test_arrays_of_a_recording_with_a_fault_come_with_a_warning(kind, pieces, tmp_path):
    path = tmp_path / "a.spots"
    path.write_bytes(damaged(kind, pieces))
    with pytest.warns(UserWarning, match=f"a.spots is read to its end, but .*{DOUBTS[kind]}"):
        assert len(read_arrays(path).touches)


def test_arrays_of_an_undamaged_recording_come_without_a_warning(seen):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(read_arrays(seen.path).touches)


def test_a_missing_end_is_no_doubt_before_the_end_is_read(seen):
    recording = Recording(seen.path)
    assert recording.doubts == []
    entries = iter(recording)
    next(entries)
    assert recording.doubts == []
    assert [*entries]
    assert recording.doubts == []


def test_nothing_is_printed_of_an_undamaged_recording(seen, tmp_path, capsys):
    for line in (f"export {seen.path} --to csv --out {tmp_path / 'a'}", f"replay {seen.path}"):
        assert cli.main([*line.split(), *["--speed", "inf"][: 2 * line.startswith("replay")]]) == 0
        assert capsys.readouterr().err == ""


@pytest.mark.board
def test_a_recording_that_begins_later_has_lost_nothing(opened, tmp_path):
    board = opened()
    board.stream("touch")
    for _ in zip(range(9), board.frames()):
        pass
    with Recorder(board, tmp_path / "a.spots"):
        for _ in zip(range(9), board.frames()):
            pass
    recording = Recording(tmp_path / "a.spots")
    assert len([*recording]) > 3
    assert recording.header.sequence
    assert (recording.stats.lost, recording.doubts) == (0, [])


@pytest.mark.parametrize("reader", [Recording, RecordingBlocks])
def test_joined_recordings_are_not_complete(reader, seen, tmp_path, capsys):
    path = tmp_path / "a.spots"
    path.write_bytes(2 * seen.path.read_bytes())
    recording = reader(path)
    for _ in recording:
        pass
    assert (recording.complete, recording.joined) == (False, True)
    assert cli.main(["info", str(path)]) == 0
    assert "end          data follows the end mark: two recordings" in capsys.readouterr().out


def test_swapped_files_of_a_recording_are_refused(tmp_path):
    path = tmp_path / "run.spots"
    spread(path, [at(1000 * i, i) for i in range(200)])
    first, second = (tmp_path / f"run-00{part}.spots" for part in (1, 2))
    contents = first.read_bytes(), second.read_bytes()
    second.write_bytes(contents[0])
    first.write_bytes(contents[1])
    with refusal(FileError, file="run-001.spots"):
        Recording(path)
