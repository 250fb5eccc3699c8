"""The API of a board: iterators, callbacks, asyncio, threads, and unknown values."""

from __future__ import annotations

import asyncio
import itertools
import math
import struct
import subprocess
import sys
import threading
from collections import deque
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from support.frames import encoded
from support.refusals import refusal
from support.stand_in_link import StandIn

import spots
import spots_linkage
from spots.errors import (
    BoardError,
    ClosedError,
    NoReplyError,
    PortError,
    PortLostError,
    SettingError,
)
from spots.link import readers
from spots.link.board import Board
from spots.link.frames import Spectrum, Touch
from spots.link.turn import Turn
from spots.recording.recorder import Recorder
from spots_device.reading.decode import (
    DROPPED,
    LED_OFF,
    NOT_CALIBRATED,
    TOO_DARK,
    TOUCHING,
)
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.files import ScenarioFile, load
from spots_sim.strip.scenario import Scenario

GIVE_UP_S = 60.0
ROOT = Path(__file__).parents[2]


class Strip(StandIn):
    """A substitute board that sends the requested streams, and KEY frames; one sample per read."""

    keys = 0

    def __init__(self):
        super().__init__(0)
        self.replies["hello"] = {"board": "pico", "keys": self.keys}

    def read(self, timeout_s):
        if not self._due and not self.gone and self.streams:
            self.time_s += 0.01
            if "spectrum" in self.streams:
                self._due += self._frame(2, struct.pack("<BB6H", 9, 5, *range(6)))
            if "touch" in self.streams:
                self._due += self._frame(1, struct.pack("<BiiiH", 9, 0, 0, 42_000, 900))
            if self.keys:
                self._due += self._frame(4, struct.pack("<BHBB", 7, 4, 0, 1))
        return super().read(timeout_s)


class Typing(Strip):
    keys = 1


class Busy(Strip):
    """A board on a busy computer: time passes between any two lines of the program."""

    def now_s(self):
        self.time_s += 0.003
        return self.time_s

    def read(self, timeout_s):
        assert timeout_s >= 0
        return super().read(timeout_s)


@pytest.fixture
def strip():
    link = Strip()
    return link, Board(link)


def take(frames, count):
    return list(itertools.islice(frames, count))


def test_a_link_never_waits_for_a_time_that_has_passed():
    with Board(Busy()) as board:
        assert len(take(board.touches(), 3)) == 3


def test_each_iterator_starts_its_stream_and_none_ends_another(strip):
    link, board = strip
    spectra = board.spectra()
    assert link.streams == ["spectrum"]
    touches = board.touches()
    assert link.streams == ["spectrum", "touch"]
    pairs = [(next(touches), next(spectra)) for _ in range(20)]
    assert all(isinstance(one, Touch) and isinstance(two, Spectrum) for one, two in pairs)
    for frames in zip(*pairs):
        assert {b.sequence - a.sequence for a, b in itertools.pairwise(frames[1:])} == {2}
    assert {type(frame) for frame in take(board.frames(), 10)} == {Touch, Spectrum}


def test_frames_starts_all_streams_unless_some_were_chosen(strip):
    _, board = strip
    take(board.touches(), 3)
    assert {type(frame) for frame in take(board.frames(), 10)} == {Touch, Spectrum}
    board.command("stream touch")
    assert {type(frame) for frame in take(board.frames(), 10)} == {Touch}
    board.command("stream off")
    assert list(board.frames(1.0)) == []


def test_what_one_iterator_leaves_is_for_the_next_one(strip):
    _, board = strip
    numbers = [touch.sequence for _ in range(20) for touch in take(board.touches(), 3)]
    assert {b - a for a, b in itertools.pairwise(numbers)} == {1}


def test_iterators_end_in_time(strip):
    link, board = strip
    began_s = link.now_s()
    assert 95 <= len(list(board.touches(seconds=1.0))) <= 101
    assert len(list(board.spectra(seconds=0.5))) > 40
    assert link.now_s() - began_s == pytest.approx(1.5, abs=0.1)


def test_keys_come_from_a_board_whose_keys_are_on_and_else_a_sentence_does(strip):
    with refusal(BoardError, why="keys_off"):
        strip[1].keys()
    link = Typing()
    keys = take(Board(link).keys(), 3)
    assert [key.usage for key in keys] == [4, 4, 4]
    assert link.streams == ["touch"]


def test_the_newest_reading_of_a_fresh_board():
    link = Strip()
    board = Board(link)
    assert board.read_latest().position_um == 42_000
    link.sleep(5.0)
    assert link.now_s() - board.read_latest().time_s < 0.05


def test_the_latest_reading_is_what_is_there_and_costs_no_time():
    link = Strip()
    board = Board(link)
    link.read, read = (lambda timeout_s: b""), link.read
    began_s = link.now_s()
    board.channel.wanted = {0: ["touch"]}
    link.streams = ["touch"]
    assert [board.latest() for _ in range(5)] == [None] * 5
    assert link.now_s() == began_s
    link.read = read
    first = board.latest()
    assert first.position_um == 42_000
    link.read = lambda timeout_s: b""
    assert board.latest() is first
    with refusal(SettingError):
        board.latest(sensor=1)
    board.channel.loss.expect(link.now_s() - 10)  # no reading for ten seconds
    assert board.latest() is None


def test_the_latest_reading_never_waits_for_a_thread_that_reads(strip):
    _, board = strip
    board.latest()
    taken, release = threading.Event(), threading.Event()

    def reads():
        with board.channel.turn:
            taken.set()
            release.wait(GIVE_UP_S)

    thread = threading.Thread(target=reads)
    thread.start()
    taken.wait(GIVE_UP_S)
    assert board.latest() is not None
    assert thread.is_alive()
    release.set()
    thread.join()


def arrive(board):
    """Let readings arrive that no iterator waits for, as during a command."""
    for _ in range(3):
        board.channel.pump(0.01)


def test_an_iterator_yields_what_arrives_from_its_creation_on(strip):
    _, board = strip
    first = take(board.touches(), 1)[0]
    arrive(board)
    touches, spectra = board.touches(), board.spectra()
    created_us = board.channel.newest.touches[0].t_us
    arrive(board)
    assert touches.unread
    touch = next(touches)
    assert touch.t_us > created_us > first.t_us
    assert next(spectra).t_us > created_us


def test_a_loop_with_other_work_loses_no_frame_between_its_turns(strip):
    _, board = strip
    touches, found = board.touches(), []
    for _ in range(5):
        found += touches.within(0.05)
        arrive(board)
    numbers = [touch.sequence for touch in found]
    assert len(found) > 20
    assert not any(touch.flags & DROPPED for touch in found)
    assert numbers == sorted(numbers)


def test_an_iterator_that_is_never_advanced_needs_bounded_memory_and_only_while_it_lives(
    strip, monkeypatch
):
    monkeypatch.setattr(readers, "FRAMES_MAX", 50)
    _, board = strip
    idle = board.touches()
    list(board.touches(1.0))
    log = board.channel.frames
    assert len(log._frames) == 50
    del idle
    list(board.touches(0.05))
    assert len(log._frames) < 10


def test_in_asyncio_too_readings_count_from_the_creation_on(strip):
    _, board = strip
    take(board.touches(), 1)

    async def first():
        touches = board.atouches()
        arrive(board)
        newest_us = board.channel.newest.touches[0].t_us
        async for touch in touches:
            return touch.t_us, newest_us

    t_us, newest_us = asyncio.run(first())
    assert t_us <= newest_us


def test_readings_of_which_only_the_latest_is_wanted_are_not_kept(strip):
    _, board = strip
    for _ in range(300):
        board.latest()
    assert len(board.channel.frames) == 0
    assert board.stats.overrun == 0
    keeps = board.touches()
    for _ in range(10):
        board.latest()
    assert len({touch.sequence for touch in take(keeps, 10)}) == 10


def test_a_timeout_that_is_too_short_names_the_call_that_does_not_wait(strip):
    link, board = strip
    board.channel.wanted = {0: ["touch"]}
    link.streams = None
    with refusal(SettingError):
        board.read_latest(0)


@pytest.mark.board
def test_a_strip_that_the_board_does_not_have_is_refused_by_its_number(sensor):
    link = LockstepLink(sensor, Scenario(load(ScenarioFile, "demo")))
    with refusal(PortError):
        Board(link, 1)


def test_a_slow_board_has_time_for_its_newest_reading(strip):
    link, board = strip
    link.exposure_us = 1_500_000
    board.command("hello")
    link.streams, link.deaf = None, {"stream", "sync"}
    board.channel.wanted = {0: ["touch"]}
    began_s = link.now_s()
    with refusal(PortError):
        board.read_latest()
    assert link.now_s() - began_s == pytest.approx(4.5, abs=0.3)


def test_any_number_of_subscribers_each_until_it_is_cancelled(strip):
    _, board = strip
    counts, enough = [0, 0, 0], [threading.Event() for _ in range(3)]

    def subscriber(i):
        def count(frame):
            assert isinstance(frame, Spectrum if i == 2 else Touch)
            counts[i] += 1
            if counts[i] > 20:
                enough[i].set()
            if i == 1:
                raise ValueError("a bug of the program")

        return count

    first, second = board.subscribe(subscriber(0)), board.subscribe(subscriber(1), Touch)
    third = board.subscribe(subscriber(2), Spectrum)
    assert all(event.wait(GIVE_UP_S) for event in enough)
    first.cancel()
    first._thread.join(GIVE_UP_S)
    seen = list(counts)
    enough[1].clear()
    assert enough[1].wait(GIVE_UP_S)
    assert counts[0] == seen[0]
    board.close()
    for subscription in (second, third):
        subscription._thread.join(GIVE_UP_S)
        assert not subscription._thread.is_alive()
        assert subscription.error is None


def test_a_subscriber_of_a_lost_board_has_its_error(strip, capsys):
    link, board = strip
    lost = board.subscribe(lambda touch: setattr(link, "gone", 1_000_000))
    lost._thread.join(GIVE_UP_S)
    assert "no such port" in str(lost.error)
    assert capsys.readouterr().err == f"spots: {lost.error}\n"


def test_handlers_of_state_and_end_do_not_replace_each_other(strip):
    link, board = strip
    first, second, ends = [], [], []
    handle = board.when_state_changes(first.append)
    board.when_state_changes(second.append)
    board.when_closed(lambda: ends.append(1))
    board.when_closed(lambda: ends.append(2))
    take(board.touches(), 3)
    link.gone = 1_000_000
    list(board.frames(0.05))
    handle.cancel()
    handle.cancel()
    link.gone = 1
    list(board.frames(1.0))
    board.close()
    board.close()
    assert (first, second, ends) == (["lost"], ["lost", "connected"], [1, 2])


def test_touches_in_asyncio_leave_its_loop_free(strip):
    _, board = strip

    async def both():
        turns, got = 0, []

        async def other():
            nonlocal turns
            while len(got) < 50:
                turns += 1
                await asyncio.sleep(0)

        task = asyncio.create_task(other())
        async for touch in board.atouches():
            got.append(touch)
            if len(got) == 50:
                break
        await task
        return turns, got

    turns, got = asyncio.run(asyncio.wait_for(both(), GIVE_UP_S))
    assert turns > 40
    assert {b.sequence - a.sequence for a, b in itertools.pairwise(got)} == {1}


def test_touches_in_asyncio_end_in_time_and_are_cancelled(strip):
    link, board = strip
    threads = threading.active_count()

    async def listen():
        assert len([touch async for touch in board.atouches(seconds=1.0)]) > 90
        link.streams = []  # no more readings: the host waits for them
        link.deaf = {"sync"}
        board.patience_s = math.inf

        async def read():
            async for _ in board.atouches():
                pass

        task = asyncio.create_task(read())
        await asyncio.sleep(0.01)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task

    asyncio.run(asyncio.wait_for(listen(), GIVE_UP_S))
    for thread in threading.enumerate():
        if thread is not threading.current_thread():
            thread.join(1.0)
    assert threading.active_count() <= threads


def test_a_lost_board_ends_asyncio_with_its_error(strip):
    link, board = strip

    async def read():
        async for _ in board.atouches():
            link.gone = 1_000_000

    with refusal(PortError):
        asyncio.run(asyncio.wait_for(read(), GIVE_UP_S))


class Broken(Strip):
    def read(self, timeout_s):
        if self.streams:
            raise ZeroDivisionError("put in by a test")
        return super().read(timeout_s)


def test_a_fault_in_a_thread_is_raised_in_asyncio_and_reported_by_a_subscription(capsys):
    async def read(board):
        async for _ in board.atouches():
            pass

    link = Broken()
    board = Board(link)
    board.channel.wanted = {0: ["touch"]}
    link.streams = ["touch"]
    with pytest.raises(ZeroDivisionError):
        asyncio.run(asyncio.wait_for(read(board), GIVE_UP_S))
    subscription = board.subscribe(print)
    subscription._thread.join(GIVE_UP_S)
    assert isinstance(subscription.error, ZeroDivisionError)
    assert "a subscriber of a board failed: please report" in capsys.readouterr().err


def test_a_second_thread_gets_all_readings_while_the_first_one_sends_commands(strip):
    link, board = strip
    got, enough = [], threading.Event()

    def read():
        for reading in board.touches():
            got.append(reading)
            if len(got) > 200:
                enough.set()

    take(board.touches(), 1)
    thread = threading.Thread(target=ended, args=(read,), daemon=True)
    thread.start()
    for _ in range(100):
        assert board.command("hello")["id"] is None
    link.deaf = {"autoexpose"}
    with refusal(NoReplyError):
        board.command("autoexpose", 5.0)
    assert enough.wait(GIVE_UP_S)
    board.close()
    thread.join(GIVE_UP_S)
    assert not thread.is_alive()
    assert {round((b.time_s - a.time_s) * 1e3) for a, b in itertools.pairwise(got)} == {10}


def ended(read):
    with pytest.raises(ClosedError):
        read()


def test_a_closed_board_is_said_to_be_closed(strip):
    _, board = strip
    touches = board.touches()
    next(touches)
    board.close()
    assert board.state == "closed"
    for use in (
        lambda: board.command("hello"),
        board.touches,
        board.read_latest,
        board.latest,
        lambda: take(touches, 9999),
        lambda: Recorder(board, "x.spots"),
    ):
        with refusal(ClosedError):
            use()


def test_the_end_of_an_iterator_runs_no_python_code(strip):
    """Python ignores exceptions in callbacks of weak references: Ctrl-C would have no effect."""
    _, board = strip
    frames, called = board.frames(), []
    sys.setprofile(lambda frame, event, what: called.append((event, frame.f_code.co_name)))
    del frames
    sys.setprofile(None)
    assert [name for event, name in called if event == "call"] == []


def test_ctrl_c_while_a_thread_waits_for_the_lock_leaves_the_lock_usable():
    class Interrupted(deque):
        """The signal arrives during the first call of `append`; its handler runs afterwards."""

        signals = 1

        def append(self, ticket):
            super().append(ticket)
            if self.signals:
                self.signals = 0
                raise KeyboardInterrupt

    turn = Turn()
    turn._queue = Interrupted()
    with pytest.raises(KeyboardInterrupt):
        turn.take()
    assert turn.take(0.1)


def test_the_repr_has_name_port_state_and_rate(strip):
    link, board = strip
    assert repr(board) == "<Board pico on stand-in: connected, no readings yet>"
    assert math.isnan(board.rate_hz)
    take(board.touches(), 1)
    assert repr(board) == "<Board pico on stand-in: connected, one reading>"
    take(board.touches(), 99)
    assert repr(board) == "<Board pico on stand-in: connected, 100.0 Hz>"
    link.gone = 1_000_000
    list(board.frames(0.05))
    assert "lost" in repr(board)
    board.close()
    assert "closed" in repr(board)


def test_what_was_set_is_in_the_info(strip):
    link, board = strip
    link.replies["set"] = {"exposure_us": 20_000, "average": 2}
    assert board.set(exposure_us=20_000, channels=["F3", "F4"])["average"] == 2
    assert link.lines[-1] == "set exposure_us=20000 channels=F3,F4"
    board.set(exposure_us=np.int64(10_000))
    assert link.lines[-1] == "set exposure_us=10000"
    board.set(exposure_us="20000", led="ldr", channels="F3,F4")
    assert link.lines[-1] == "set exposure_us=20000 led=ldr channels=F3,F4"
    assert (board.info["exposure_us"], board.info["average"]) == (20_000, 2)
    assert (board.info["board"], board.info["re"]) == ("pico", "hello")


@pytest.mark.parametrize(
    ("flags", "place", "force", "contrast"),
    [
        (TOUCHING, True, True, True),
        (0, False, True, True),
        (TOO_DARK, False, True, False),
        (NOT_CALIBRATED, False, False, False),
        (TOUCHING | LED_OFF, False, False, False),
    ],
)
def test_what_is_not_known_of_a_reading_is_nan(flags, place, force, contrast):
    frame = struct.pack("<BHIBiiiH", 1, 0, 0, flags, 0, 0, 0, 0)
    (reading,) = spots.Decoder().feed(encoded(frame))
    known = [not math.isnan(value) for value in reading[6:8]]
    assert known == [place, force]
    assert [not math.isnan(reading.contrast), not math.isnan(reading.brightness)] == [contrast] * 2


def test_touches_are_a_table(strip):
    _, board = strip
    table = pd.DataFrame(board.touches(seconds=2))
    assert list(table.columns) == list(Touch._fields)
    assert len(table) > 190
    assert (table.position_um == 42_000).all()
    assert pd.DataFrame(board.spectra(seconds=0.1)).counts[0] == (0, 1, 2, 3, 4, 5)


def test_an_encoder_of_a_file_and_a_port_that_is_a_path(tmp_path):
    file = ROOT / "tests/data/joint.toml"
    assert spots_linkage.Encoder(file).joint == spots_linkage.Encoder(str(file)).joint
    with refusal(PortError):
        spots.open(tmp_path / "ttyNONE")


LEFT_OPEN = """
import threading
from spots import Board
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.files import ScenarioFile, SensorFile, load
from spots_sim.strip.scenario import Scenario

link = LockstepLink(load(SensorFile, "default"), Scenario(load(ScenarioFile, "demo")))
board, read = Board(link), threading.Event()
board.subscribe(lambda touch: read.set())
read.wait()
"""


@pytest.mark.board
def test_a_program_that_leaves_a_virtual_board_open_ends_without_a_message():
    command = [sys.executable, "-c", LEFT_OPEN]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=GIVE_UP_S)
    assert done.stderr == ""


@pytest.mark.board
def test_the_info_of_a_virtual_board_has_its_calibration():
    with spots.open("virtual") as board:
        assert board.info == board.command("hello")
        assert board.info["calibration"]
        board.command("cal clear")
        assert board.command("hello")["calibration"] is board.info["calibration"] is None


def test_a_board_that_is_lost_while_nothing_streams_is_lost_at_once(strip):
    link, board = strip
    link.gone = 2
    with pytest.raises(PortLostError):
        board.command("hello")
