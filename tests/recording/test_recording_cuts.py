"""Cut and damaged recordings: all complete frames are read, and no wrong frame."""

import contextlib
import itertools
import multiprocessing
import os
import random
import signal
import struct
import sys
import threading
import time

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support import kills
from support.frames import encoded, touch
from support.reels import INFO, clock, record, recorder, replayed

import spots
from spots.link.decoder import Decoder, note
from spots.recording.recording import Recording
from spots.recording.writer import Writer

_FRAMES = 60
_KILLS = 200
RECORDER = os.path.join("spots", "recording")


def key(sequence):
    fields = (4, sequence, 1000 * sequence, 7, 30, 0, 1)
    return encoded(struct.pack("<BHIBHBB", *fields))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Bytes of a recording of TOUCH and KEY frames, these frames, and the index of their ends."""
    path = tmp_path_factory.mktemp("whole") / "whole.spots"
    pieces = [key(i) if i % 3 else touch(i) for i in range(_FRAMES)]
    frames, _ = record(path, pieces, step_s=0.002)
    data = path.read_bytes()
    ends = [data.index(piece) + len(piece) for piece in pieces]
    return data, frames, ends


@pytest.mark.board
def test_cut_at_every_byte_the_whole_frames_are_there(whole, tmp_path):
    data, frames, ends = whole
    path = tmp_path / "cut.spots"
    path.write_bytes(data)
    header_ends = 0
    for size in range(len(data), -1, -1):
        os.truncate(path, size)
        try:
            got, recording = replayed(path)
        except spots.SpotsError:
            header_ends = header_ends or size
            continue
        assert not header_ends, "a header that is whole does not get less so"
        count = sum(end <= size for end in ends)
        assert got == frames[:count]
        assert recording.stats.bad_crc == 0
        assert recording.cut_bytes == size - 1 - data.rfind(b"\0", 0, size)
        assert recording.complete == (size == len(data))
    assert 0 < header_ends < ends[0] / 2  # one of the two copies of the header is enough


def test_a_stop_in_another_thread_waits_for_the_frame_in_work(tmp_path):
    path, stops = tmp_path / "run.spots", []

    def describe():  # the recorder calls this in the middle of a write
        for stop in stops:
            stop.start()
            stop.join(0.2)  # without a lock, the recording has ended by then
        return {"info": INFO, "clock": clock().state(), "calibration": None}

    one = Writer(time.monotonic, path, describe)
    stops.append(threading.Thread(target=one.stop))
    one.take(touch(0), time.monotonic())
    stops[0].join()
    one.take(touch(1), time.monotonic())
    frames, recording = replayed(path)
    assert [frame.sequence for frame in frames] == [0]
    assert recording.complete


@contextlib.contextmanager
def ctrl_c_at_line(count):
    """Raise KeyboardInterrupt before the recorder executes its line number `count` in the block."""
    left = [count]

    def line(frame, event, argument):
        if event == "line":
            left[0] -= 1
            if not left[0]:
                raise KeyboardInterrupt
        return line

    def call(frame, event, argument):
        return line if RECORDER in frame.f_code.co_filename else None

    tracing = sys.gettrace()
    sys.settrace(call)
    try:
        yield
    finally:
        sys.settrace(tracing)


@pytest.mark.board
@pytest.mark.parametrize("rotate_bytes", [None, 1000])
def test_ctrl_c_at_any_line_of_the_recorder_leaves_a_recording_with_an_end(tmp_path, rotate_bytes):
    pieces = [key(0), key(1), b"\x55" * 400, b"\0", key(2), b"".join(map(key, range(3, 9))), key(9)]
    for i in itertools.count(1):
        path = tmp_path / str(i) / "a.spots"  # in its own folder, with all parts of the set
        path.parent.mkdir()
        tap = recorder(path, pieces, step_s=0.002, rotate_bytes=rotate_bytes)
        handed, interrupted = b"", False
        try:
            with ctrl_c_at_line(i):
                for _ in pieces:
                    handed += tap.read(1.0)
        except KeyboardInterrupt:
            interrupted = True
        tap.stop()
        frames, recording = replayed(path)
        assert recording.complete, i
        assert [frame.sequence for frame in frames] == list(range(len(frames)))
        read = len(Decoder().feed(handed))
        assert read <= len(frames) <= read + 6, i  # a block is written before it is delivered
        if not interrupted:
            break
    assert i > 100
    assert rotate_bytes is None or len(recording.paths) > 1


@pytest.mark.board
def test_a_killed_recorder_keeps_all_that_it_handed_on(tmp_path, monkeypatch):
    # A fork server has imported all modules, so that each new process starts in milliseconds. It
    # finds the modules only by PYTHONPATH.
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["support.kills"])
    rng = random.Random(0)
    inside = told_of = 0
    for i in range(_KILLS):
        path = tmp_path / f"{i}.spots"
        told, telling = context.Pipe(duplex=False)
        process = context.Process(target=kills.run, args=(path, telling))
        process.start()
        telling.close()
        for _ in range(rng.choice([1, 3, 10, 30, 100])):
            handed = told.recv()
        time.sleep(rng.uniform(0, 0.002))
        os.kill(process.pid, signal.SIGKILL)
        process.join()
        with contextlib.suppress(EOFError):
            while True:
                handed = told.recv()
        told.close()
        got, recording = replayed(path)
        assert [frame.position_um for frame in got] == list(range(1000, 1000 + len(got)))
        assert len(got) >= handed > 0
        assert not recording.complete
        told_of += handed
        inside += len(recording.paths) > 1
    print(f"{_KILLS} kills at random moments: of {told_of} frames handed on, 0 were missing")
    assert inside > _KILLS / 10  # includes kills near a change to the next file


damages = st.lists(
    st.tuples(st.sampled_from(["flip", "cut", "double", "noise"]), st.integers(0, 1 << 30)),
    min_size=1,
    max_size=12,
)


def damaged(data, damage):
    for how, at in damage:
        at %= len(data) or 1
        size = 1 + at % 40
        if how == "flip":
            data = data[:at] + bytes(b ^ 1 << at % 8 for b in data[at : at + 1]) + data[at + 1 :]
        elif how == "cut":
            data = data[:at] + data[at + size :]
        elif how == "double":
            data = data[: at + size] + data[at:]
        else:
            data = data[:at] + random.Random(at).randbytes(size) + data[at + size :]
    return data


@pytest.mark.board
@settings(max_examples=200)
@given(damages)
@example([("cut", 0)])
@example([("flip", 0), ("flip", 1)])
def test_damage_gives_a_sentence_or_true_frames(whole, tmp_path_factory, damage):
    data, frames, _ = whole
    path = tmp_path_factory.mktemp("damaged") / "a.spots"
    path.write_bytes(damaged(data, damage))
    try:
        got, _ = replayed(path)
        list(spots.open_recording(path, float("inf")).frames())
    except spots.SpotsError:
        return
    assert set(got) <= set(frames)


@pytest.mark.board
@settings(derandomize=True, max_examples=300)
@given(st.binary(max_size=3000), st.booleans())
def test_any_bytes_give_a_sentence_or_nothing(whole, tmp_path_factory, content, headed):
    path = tmp_path_factory.mktemp("bytes") / "a.spots"
    path.write_bytes((whole[0][: whole[2][0] - 40] if headed else b"") + content)
    try:
        assert replayed(path)[0] == []
    except spots.SpotsError:
        assert not headed


@pytest.mark.board
def test_every_flipped_byte_of_the_header_is_made_good_by_its_copy(tmp_path):
    path = tmp_path / "a.spots"
    frames, _ = record(path, [touch(0)])
    data = path.read_bytes()
    for at in range(data.index(touch(0)) - len(note(0))):
        path.write_bytes(data[:at] + bytes([data[at] ^ 0x55]) + data[at + 1 :])
        assert replayed(path)[0] == frames


def test_what_a_live_board_says_is_never_a_note(tmp_path):
    # A damaged byte destroys only its frame; the times of the other frames do not change.
    frames, _ = record(tmp_path / "a.spots", [touch(0), b"\x0f" + touch(1), touch(2)])
    assert [frame.sequence for frame in frames] == [0, 2]
    assert Recording(tmp_path / "a.spots").header.part == 0
    assert Decoder().feed(b"") == []
