"""Recordings return all frames with their times, and the board's description."""

import json
import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.frames import encoded, stream, touch
from support.reels import AS_FAST_AS_POSSIBLE, cut, record, recorder, replayed
from support.refusals import refusal

import spots
from spots.cli import main
from spots.controller import controller as play
from spots.controller.controller_settings import load as load_settings
from spots.errors import BoardError, FileError, SettingError, StateError
from spots.keyboard.keyboard import type_on
from spots.keyboard.layout import load as load_layout
from spots.link.decoder import Decoder, note
from spots.link.frames import Contact, Key, Spectrum, Text, Touch
from spots.outputs.devices import PrintedGamepad, PrintedKeyboard
from spots.recording import replay
from spots.recording.recorder import Recorder
from spots.recording.writer import ARRIVAL_STEP_S
from spots.wearable import wearable


def test_every_frame_comes_back_with_its_times(seen):
    with spots.open_recording(seen.path, AS_FAST_AS_POSSIBLE) as board:
        arrived_s, frames = [], []
        for frame in board.frames():
            frames.append(frame)
            arrived_s.append(board.now_s())
    assert frames == seen.frames
    assert {type(frame) for frame in frames} == {Touch, Spectrum, Key, Contact}
    assert all(frame.time_s is not None for frame in frames)
    for recorded, handed in zip(arrived_s, seen.handed_s):
        assert recorded <= handed <= recorded + ARRIVAL_STEP_S + 1e-6


def test_the_board_comes_back(seen, calibration):
    with spots.open(f"recording:{seen.path}") as board:
        live = seen.board
        assert board.info == live.command("hello") | {"keys": 0}
        assert board.calibration == calibration
        assert board.port == str(seen.path)
        assert board.command("hello") == board.info
        with refusal(BoardError, why="not_here"):
            board.command("save")


@pytest.mark.parametrize("use", ["keyboard", "controller", "wearable"])
def test_what_uses_a_recording_ends_with_it(seen, use):
    with spots.open_recording(seen.path, AS_FAST_AS_POSSIBLE) as board:
        if use == "keyboard":
            type_on(board, load_layout("digits"), PrintedKeyboard())
        elif use == "controller":
            with PrintedGamepad() as gamepad:
                play.play(board, play.controller_for(board, load_settings()), gamepad)
        else:
            wearable.play(board, print, None, False, wearable.Mapping())
        assert board.ended


def test_a_recording_is_not_recorded(seen, tmp_path):
    path = tmp_path / "again.spots"
    with spots.open_recording(seen.path) as board:
        assert not board.ended
        with refusal(SettingError):
            Recorder(board, path)
    assert not path.exists()


def test_replies_are_in_the_recording_too(seen):
    texts = [f.content for _, f in spots.Recording(seen.path) if isinstance(f, Text)]
    assert [text["re"] for text in texts] == ["set", "stream"]


def test_touches_latest_and_statistics_are_those_of_a_board(seen):
    touches = [frame for frame in seen.frames if isinstance(frame, Touch)]
    with spots.open_recording(seen.path, AS_FAST_AS_POSSIBLE) as board:
        assert board.read_latest() == touches[0]
        assert list(board.touches()) == touches[1:]
        assert board.stats.frames == len(seen.frames) + 2
        assert (board.stats.lost, board.stats.bad_crc) == (0, 0)
        with refusal(StateError):
            board.read_latest()
    with spots.open_recording(seen.path, AS_FAST_AS_POSSIBLE) as board:
        half = list(board.touches(1.0))
    assert half == touches[: len(half)]
    assert half[-1].time_s - half[0].time_s == pytest.approx(1.0, abs=0.05)


def test_a_plain_decoder_reads_a_recording(seen):
    frames = Decoder().feed(seen.path.read_bytes())
    bare = [frame._replace(time_s=None) for frame in seen.frames]
    # Without the calibration, the sigma of a touch is unknown.
    bare = [f._replace(sigma_um=math.nan) if isinstance(f, Touch) else f for f in bare]
    assert [f for f in frames if isinstance(f, (Touch, Spectrum, Key, Contact))] == bare


class Time:
    """Substitute for the module `time`: its clock advances only in `sleep`."""

    def __init__(self):
        self.now_s = 0.0

    def monotonic(self):
        return self.now_s

    def sleep(self, seconds):
        self.now_s += seconds


@pytest.mark.parametrize("speed", [0.5, 1.0, 4.0])
def test_frames_come_at_the_recorded_pace(monkeypatch, tmp_path, speed):
    time = Time()
    monkeypatch.setattr(replay, "time", time)
    record(tmp_path / "a.spots", stream(50), step_s=0.02)
    with spots.open_recording(tmp_path / "a.spots", speed) as board:
        at_s = [time.now_s for _ in board.frames()]
    assert at_s == [pytest.approx(0.02 * i / speed, abs=1e-5) for i in range(1, 51)]


def test_a_slow_reader_loses_nothing_of_a_recording(monkeypatch, tmp_path):
    time = Time()
    monkeypatch.setattr(replay, "time", time)
    monkeypatch.setattr("spots.link.readers.FRAMES_MAX", 1000)
    frames, _ = record(tmp_path / "a.spots", stream(3000), step_s=1e-3)
    got = []
    with spots.open_recording(tmp_path / "a.spots") as board:
        for frame in board.frames():
            got.append(frame)
            time.sleep(0.01)
    assert got == frames


@pytest.mark.board
def test_a_recording_can_begin_in_the_middle_of_a_frame_and_of_a_stream(opened, tmp_path):
    board = opened()
    touches, frames = board.touches(), board.frames()
    next(touches)
    rest, read = b"", board._link.read

    def late(timeout_s):
        nonlocal rest
        rest += read(timeout_s)
        data, rest = rest[:-30], rest[-30:]  # more than the zeros that complete a block
        return data

    board._link.read = late
    next(touches)
    assert board.channel.decoder.pending
    with Recorder(board, tmp_path / "a.spots"):
        while frames.unread:
            next(frames)
        live = list(frames.within(0.2))
    assert live == [f for f in replayed(tmp_path / "a.spots")[0] if not isinstance(f, Text)]
    assert len(live) > 10


noise = st.binary(min_size=1, max_size=1200)


@pytest.mark.board
@given(
    st.lists(noise | st.integers(0, 50_000).map(touch), max_size=12),
    st.lists(st.integers(1, 700), max_size=12),
)
def test_whatever_comes_in_whatever_pieces_decodes_the_same(tmp_path_factory, parts, sizes):
    path = tmp_path_factory.mktemp("pieces") / "a.spots"
    data = b"".join(parts) + b"\0" + touch(5)
    frames, stats = record(path, cut(data, sizes), step_s=100.0)  # no frame before its time
    got, recording = replayed(path)
    assert got == frames
    assert recording.stats.lost == stats.lost
    assert recording.stats.frames == stats.frames
    assert recording.stats.bad_crc == stats.bad_crc
    assert recording.complete


def at(seconds, sequence=0):
    t_us = 1_000_000 * seconds & 0xFFFFFFFF
    return encoded(struct.pack("<BHIBHBB", 4, sequence, t_us, 7, 30, 0, 1))


def test_the_time_of_the_board_wraps_in_a_recording_as_on_the_link(tmp_path):
    frames, _ = record(tmp_path / "a.spots", [at(1000 * i) for i in range(20)], step_s=1000.0)
    got, _ = replayed(tmp_path / "a.spots")
    assert got == frames
    assert frames[-1].time_s - frames[0].time_s == pytest.approx(19_000)


@pytest.mark.board
def test_a_board_that_restarts_has_its_new_clock_in_the_recording(opened, tmp_path):
    board = opened()
    with Recorder(board, tmp_path / "a.spots"):
        frames = board.frames()
        board.command("stream touch")
        live = list(frames.within(0.5))
        board.command("reboot")
        live += frames.within(3.0)
    assert board.stats.restarts == 1
    assert len(live) > 200
    assert live == [f for f in replayed(tmp_path / "a.spots")[0] if not isinstance(f, Text)]


def test_a_clock_that_is_none_is_told(tmp_path):
    path = tmp_path / "a.spots"
    record(path, stream(1))
    path.write_bytes(path.read_bytes() + note(1, {"clock": {"low_s": "x"}}))
    with refusal(FileError):
        replayed(path)


def test_frames_that_reads_cut_in_two_have_their_times_too(tmp_path):
    data = b"".join(stream(30))
    record(tmp_path / "a.spots", cut(data, [7] + [28] * 29))  # each read ends 7 bytes into a frame
    arrived_s = [arrived_s for arrived_s, _ in spots.Recording(tmp_path / "a.spots")]
    assert arrived_s == [pytest.approx(1000.01 + 0.01 * i, abs=1e-5) for i in range(1, 31)]


def test_noise_is_written_as_it_comes_and_does_not_swallow_the_end(tmp_path):
    path = tmp_path / "a.spots"
    tap = recorder(path, [touch(0), b"\x55" * 1000])
    tap.read(1)
    size = path.stat().st_size
    tap.read(1)
    assert path.stat().st_size >= size + 1000
    tap.stop()
    frames, recording = replayed(path)
    assert len(frames) == 1
    assert recording.complete


def test_a_stopped_recorder_records_no_more(tmp_path):
    tap = recorder(tmp_path / "a.spots", stream(4))
    assert tap.read(1) == touch(0, 1000)
    tap.stop()
    tap.stop()
    assert tap.read(1)
    assert len(replayed(tmp_path / "a.spots")[0]) == 1


def test_the_newest_keys_of_a_header_and_unknown_notes_do_no_harm(tmp_path):
    path = tmp_path / "a.spots"
    record(path, stream(3))
    data = path.read_bytes()
    path.write_bytes(data + note(10**14, {"marker": [1, 2]}) + touch(3))
    got, recording = replayed(path)
    assert len(got) == 4
    assert recording.end_s - recording.header.host_s == pytest.approx(1e8)


def test_info_as_json_is_what_was_seen(seen, capsys):
    assert main(["info", "--json", str(seen.path)]) == 0
    found = json.loads(capsys.readouterr().out)
    for kind in (Touch, Spectrum, Key):
        count = sum(isinstance(frame, kind) for frame in seen.frames)
        assert found["frames"][kind.__name__.lower()] == count > 0
    assert found["frames"]["text"] == 2
    assert (found["lost"], found["bad"], found["cut_bytes"], found["complete"]) == (0, 0, 0, True)
    assert found["duration_s"] == pytest.approx(2.0, abs=0.05)
    assert found["header"]["info"]["id"] == seen.board.info["id"]
    assert found["bytes"] == seen.path.stat().st_size
    assert main(["info", str(seen.path)]) == 0
    assert seen.board.info["id"] in capsys.readouterr().out
