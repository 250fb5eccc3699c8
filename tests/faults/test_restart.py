"""Restarts of a board and their effects on the host, with a substitute for the board."""

import math
import os
import pty
import random
import struct
import tty
from types import SimpleNamespace

import pytest
from support.refusals import refusal
from support.stand_in_link import StandIn

from spots.errors import NoReplyError, PortError, PortLostError
from spots.link import readers
from spots.link import reconnect as module
from spots.link.board import Board
from spots.link.frames import Touch
from spots.link.serial_link import SerialLink
from spots.link.timeouts import CONNECTED, LOST, SEARCH_S, STALLED
from spots.recording import replay
from spots.recording.info import summary
from spots.recording.recorder import Recorder
from spots.recording.recording import Recording
from spots.recording.replay import open_recording
from spots_device.reading.decode import DROPPED


def reading(board, count):
    return [touch for touch, _ in zip(board.frames(), range(count))]


def streaming(sequence=60_000):
    link = StandIn(sequence)
    board = Board(link)
    board.touches()
    reading(board, 50)
    return link, board


def test_a_restart_is_one_restart_and_no_loss_wherever_the_sequence_was():
    for sequence in (100, 30_000, 60_000):
        link, board = streaming(sequence)
        link.restart()
        readings = reading(board, 50)
        assert board.stats.restarts == 1
        assert board.stats.lost == 0
        assert all(0 <= link.now_s() - touch.time_s < 1.5 for touch in readings)
        assert link.now_s() - readings[-1].time_s < 0.05


def test_a_computer_that_slept_counts_what_it_missed_and_no_restart(tmp_path, monkeypatch):
    # The board's port stays open, and its clock runs on; the link's clock stands still.
    utc_s = [1.0e9]  # of a computer without a battery clock
    monkeypatch.setattr("time.time", lambda: utc_s[0] + link.now_s())
    link, board = streaming(60_000)
    path = tmp_path / "run.spots"
    with Recorder(board, path):
        reading(board, 50)
        began_s = link.now_s()
        for slept_s in (20, 600, 3600):
            before = board.stats.lost
            link.booted_s -= slept_s
            link.lose(100 * slept_s)
            utc_s[0] += slept_s
            some = zip(board.frames(), range(100))
            ages_s = [link.now_s() - touch.time_s for touch, _ in some]
            assert all(-0.02 < age_s < 0.02 for age_s in ages_s), slept_s
            assert board.stats.lost - before == pytest.approx(100 * slept_s, rel=0.01)
            assert board.time_error_s < 0.1
        utc_s[0] += 7e8  # the network has set it
        reading(board, 600)
        utc = 1.7e9 + 4220 + began_s
    assert board.stats.restarts == 0
    assert summary(path)["lost"] == board.stats.lost
    recording = Recording(path)
    times_s = [touch.time_s for _, touch in recording if isinstance(touch, Touch)]
    assert times_s == pytest.approx(sorted(times_s), abs=0.02)
    assert recording.utc.begun_s(began_s + 60) + began_s - recording.header.host_s == pytest.approx(
        utc, abs=0.1
    )
    assert recording.utc.begun_s(began_s) == pytest.approx(1.7e9 + recording.header.host_s, abs=0.1)


def test_an_idle_board_has_not_restarted_while_the_computer_slept():
    link = StandIn(60_000)
    board = Board(link)
    link.booted_s -= 3000
    board.command("get")
    assert (board.stats.restarts, board.stats.lost) == (0, 0)
    link.restart()
    board.command("get")
    assert board.stats.restarts == 1


def test_keys_do_not_hide_that_the_streams_have_ended():
    link, board = streaming()
    link.restart()
    link.typing = True
    list(board.frames(0.4))
    assert link.streams
    assert board.stats.restarts == 1
    list(board.frames(0.4))
    assert board.state == STALLED


def test_what_a_board_says_at_its_start_makes_no_loss_either():
    link, board = streaming(60_000)
    link.lose(7)
    reading(board, 10)
    link.restart()
    link.complain()
    reading(board, 10)
    assert board.log[-1]["log"] == "error"
    assert (board.stats.restarts, board.stats.lost) == (1, 7)


@pytest.mark.parametrize("rotate_bytes", [None, 2500])
def test_a_recording_counts_the_losses_and_restarts_that_the_live_run_did(tmp_path, rotate_bytes):
    link, board = streaming(60_000)
    link.restart()
    reading(board, 20)  # before the recording
    path = tmp_path / "run.spots"
    with Recorder(board, path, rotate_bytes=rotate_bytes):
        before = board.stats.lost
        for sequence in (60_000, 40_000, 100):
            reading(board, 2)
            link.lose(5)
            reading(board, 30)
            link.sequence = sequence
            reading(board, 2)
            seemed = board.stats.lost
            link.restart()
            link.complain()
            reading(board, 30)
            link.lose(3)
            reading(board, 30)
            assert board.stats.lost == seemed + 3
    found = summary(path)
    assert found["restarts"] == 3
    assert board.stats.restarts == 4
    assert found["lost"] == board.stats.lost - before == 24
    assert (len(found["files"]) > 5) == (rotate_bytes is not None)
    with open_recording(path, float("inf")) as again:
        assert len(list(again.frames())) > 250
        assert again.stats.lost == found["lost"]


def test_what_was_streamed_is_streamed_again():
    link, board = streaming()
    board.command("stream touch spectrum")
    link.restart()
    reading(board, 20)
    assert link.streams == ["spectrum", "touch"]


def test_replies_that_are_lost_cost_time_and_count_no_restart_twice():
    link, board = streaming()
    link.restart()
    link.deaf = {"sync"}
    assert list(board.frames(3.0)) == []
    assert link.asked.count("sync") > 3
    link.deaf = {"stream"}  # the board streams, but its reply to the command is lost
    assert len(reading(board, 20)) == 20
    assert board.stats.restarts == 1
    link.deaf = set()
    link.restart()
    reading(board, 100)
    assert board.stats.restarts == 2


def test_a_damaged_command_after_a_restart_costs_less_than_half_a_second():
    link, board = streaming()
    link.restart()
    link.damaged.update(["stream spectrum touch", "hello"])
    began_s = link.time_s
    reading(board, 5)
    assert link.time_s - began_s < 0.5


def test_the_second_strip_streams_again_although_its_command_was_damaged_often():
    link = StandIn(0)
    link.replies["hello"] = {"sensors": 2}
    board = Board(link)
    board.stream("touch")
    link.restart()
    link.lines.clear()
    link.damaged["stream touch sensor=1"] = 7
    reading(board, 100)
    assert link.damaged["stream touch sensor=1"] == 0
    assert link.lines.count("stream touch sensor=1") == 1
    assert link.lines.count("stream touch") == 1
    assert board.stats.restarts == 1


def test_nothing_is_asked_of_a_board_that_streams_or_was_told_to_be_silent():
    link, board = streaming()
    asked = len(link.asked)
    reading(board, 300)
    assert len(link.asked) == asked
    board.command("stream off")
    asked = len(link.asked)
    assert list(board.frames(3.0)) == []
    assert len(link.asked) == asked


def test_a_board_whose_firmware_does_not_tell_what_it_streams_is_left_alone():
    link, board = streaming()
    link.streams = None
    assert list(board.frames(3.0)) == []
    assert board.stats.restarts == 0


def test_a_port_that_goes_away_and_comes_back_is_opened_again():
    link, board = streaming()
    link.restart()
    link.gone = 3
    assert len(reading(board, 50)) == 50
    assert board.stats.restarts == 1


def test_a_board_that_comes_back_with_longer_exposures_is_given_their_time():
    link, board = streaming()
    link.restart()
    link.gone, link.exposure_us = 3, 1_000_000
    reading(board, 20)
    link.streams = None  # sends nothing
    list(board.frames(2.5))
    assert board.state == CONNECTED
    list(board.frames(1.0))
    assert board.state == STALLED


def test_the_newest_reading_of_a_board_that_came_back_is_had_again():
    link, board = streaming()
    assert board.read_latest().position_um == 42_000
    board.patience_s = math.inf
    link.gone = 100_000
    with refusal(PortError):
        board.read_latest(0.4)
    assert board.latest() is None
    link.gone = 1
    assert board.read_latest(5.0).position_um == 42_000
    assert board.latest().position_um == 42_000
    link.restart()
    link.streams = None  # restarted, and sends nothing yet
    board.channel.restarted(link.now_s(), 0)
    assert board.latest() is None


def test_a_lost_port_is_looked_for_by_the_clock_of_its_link():
    link, board = streaming()
    lost_s, link.gone = link.now_s(), 1_000_000
    with refusal(PortError):
        list(board.frames())
    tries_s = [round(try_s - lost_s, 3) for try_s in link.tries_s]
    assert tries_s == [0.0, 0.1, 0.3, 0.7, *(1.5 + i for i in range(10))]
    assert board.patience_s == 10.0


def test_a_port_that_does_not_reappear_is_reported(monkeypatch):
    monkeypatch.setattr(module, "PATIENCE_S", 0.0)
    link, board = streaming()
    link.gone = 1000
    with refusal(PortError):
        reading(board, 50)


def test_a_port_that_goes_away_while_nothing_is_streamed_is_told_at_once():
    link, board = streaming()
    board.command("stream off")
    link.gone = 2
    with pytest.raises(PortLostError):
        reading(board, 1)
    assert link.gone == 2


def test_a_restart_while_nothing_is_streamed_is_noticed_at_the_next_command():
    link, board = streaming()
    board.command("stream off")
    list(board.frames(5.0))
    assert board.command("hello")
    assert board.stats.restarts == 0
    link.restart()
    assert board.command("hello")
    assert board.stats.restarts == 1
    assert board.stats.lost == 0
    board.command("hello")
    assert board.stats.restarts == 1
    board.touches()
    assert link.now_s() - reading(board, 5)[-1].time_s < 0.05


def test_a_command_after_a_restart_brings_the_stream_back_as_well():
    link, board = streaming()
    link.restart()
    board.command("hello")
    assert board.stats.restarts == 1
    assert len(reading(board, 50)) == 50
    assert board.stats.restarts == 1


def test_the_state_of_a_link():
    told = []
    link, board = streaming()
    board.when_state_changes(told.append)
    assert board.state == "connected"
    link.deaf, link.streams = {"sync"}, []
    list(board.frames(2.0))
    assert board.state == "stalled"
    link.deaf = set()
    reading(board, 5)
    assert board.state == "connected"
    link.gone = 1_000_000
    list(board.frames(0.01))
    assert board.state == "lost"
    link.gone = 1
    link.board_id = "another"
    until(board, "refused")
    assert len(board.log) == 1
    link.board_id = None
    until(board, "connected")
    assert told == ["stalled", "connected", "lost", "refused", "connected"]


def silent(board):
    return board.channel.loss.silent(board.now_s(), SEARCH_S)


def test_silence_and_state_are_by_the_clock_of_the_link():
    link, board = streaming()
    link.deaf, link.streams = {"sync"}, []
    last_s = link.now_s()
    seen = []
    while link.now_s() < last_s + 4.0:
        list(board.frames(0.01))
        seen.append((round(link.now_s() - last_s, 2), board.state, silent(board)))
    stalled_s = next(at_s for at_s, state, _ in seen if state == STALLED)
    silent_s = next(at_s for at_s, _, is_silent in seen if is_silent)
    assert (stalled_s, silent_s) == (pytest.approx(0.5, abs=0.2), pytest.approx(2.0, abs=0.2))
    link.deaf = set()
    reading(board, 5)
    assert (board.state, silent(board)) == (CONNECTED, False)
    link.gone = 1_000_000
    list(board.frames(3.0))
    assert (board.state, silent(board)) == (LOST, True)


def test_nothing_is_silent_that_streams_nothing():
    link = StandIn(0)
    board = Board(link)
    link.sleep(100.0)
    assert (board.state, silent(board)) == (CONNECTED, False)


def test_a_pause_of_a_recording_is_a_stall_as_it_was_then(tmp_path, monkeypatch):
    link, board = streaming()
    monkeypatch.setattr(replay, "time", SimpleNamespace(monotonic=link.now_s, sleep=link.sleep))
    with Recorder(board, tmp_path / "run.spots"):
        reading(board, 10)
        link.deaf, link.streams = {"sync"}, []
        list(board.frames(1.0))
        link.deaf = set()
        reading(board, 10)
    with open_recording(tmp_path / "run.spots") as again:
        states = []
        again.when_state_changes(states.append)
        list(again.touches())
    assert states == [STALLED, CONNECTED]


def test_another_board_is_refused_behind_a_tap_too():
    seen = []
    link, board = streaming()
    board.channel.taps.append(lambda data, now_s: seen.append(data))
    link.gone, link.board_id = 1, "another"
    until(board, "refused")
    link.board_id = None
    until(board, "connected")
    reading(board, 5)
    assert any(seen)


def until(board, state):
    while board.state != state:
        list(board.frames(0.01))


def test_readings_that_a_program_does_not_take_are_counted_and_flagged(monkeypatch):
    monkeypatch.setattr(readers, "FRAMES_MAX", 100)
    link, board = streaming()
    link.deaf = {"autoexpose"}
    readings = board.touches()
    with pytest.raises(NoReplyError):
        board.command("autoexpose", 3.0)
    assert board.stats.overrun == pytest.approx(200, abs=3)
    first, *others = [touch for touch, _ in zip(readings, range(100))]
    assert first.flags & DROPPED
    assert not any(other.flags & DROPPED for other in others)


class Drifting(StandIn):
    """A substitute board with a fast clock, a reading every second, and a slow link."""

    def __init__(self, ppm):
        super().__init__(0)
        self._rate = 1 + 1e-6 * ppm
        self._rng = random.Random(1)
        self._next_s = self.time_s

    def read(self, timeout_s):
        if not self._due:
            waits_s = max(0.0, self._next_s - self.time_s) if self.streams else timeout_s
            self.time_s += min(timeout_s, waits_s)
            if self.streams and self.time_s >= self._next_s:
                self._next_s = self.time_s + 1.0
                self._due = self._frame(1, struct.pack("<Biiii", 9, 0, 0, 42_000, 0)[:15])
        data, self._due = self._due, b""
        return data

    def write(self, data):
        self.time_s += self._rng.uniform(0, 0.01)
        super().write(data)
        self.time_s += self._rng.uniform(0, 0.001)

    def true_s(self, t_us):
        return self.booted_s + 1e-6 * t_us / self._rate

    def _t_us(self):
        return int(1e6 * self._rate * (self.time_s - self.booted_s)) % (1 << 32)


@pytest.mark.board
@pytest.mark.parametrize("ppm", [50, -50])
def test_the_drift_of_a_clock_is_followed_for_hours(ppm):
    link = Drifting(ppm)
    board = Board(link)
    link.exposure_us = 1_000_000
    board.command("hello")
    board.touches()
    turn_s = (1 << 32) * 1e-6 / (1 + 1e-6 * ppm)  # the board's microseconds wrap after 72 minutes
    worst_s = 0.0
    for touch in board.frames(3 * 3600.0):
        off_s = (touch.time_s - link.true_s(touch.t_us) + turn_s / 2) % turn_s - turn_s / 2
        worst_s = max(worst_s, abs(off_s))
    assert worst_s < 0.004
    assert board.drift_ppm == pytest.approx(ppm, abs=2)
    assert board.stats.restarts == 0


def test_a_serial_port_is_opened_again_by_its_name(tmp_path):
    name = tmp_path / "port"

    def plug():
        ours, theirs = pty.openpty()
        tty.setraw(theirs)
        name.unlink(missing_ok=True)
        name.symlink_to(os.ttyname(theirs))
        os.close(theirs)
        return ours

    first = plug()
    link = SerialLink(str(name))
    os.write(first, b"one")
    assert link.read(1.0) + link.read(1.0) == b"one"
    os.close(first)
    with pytest.raises(PortLostError):
        link.read(1.0)
    name.unlink()
    with refusal(PortLostError):
        link.reopen()
    second = plug()
    link.reopen()
    os.write(second, b"two")
    assert link.read(1.0) + link.read(1.0) == b"two"
    link.close()
    os.close(second)
