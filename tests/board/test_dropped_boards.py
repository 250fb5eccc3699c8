"""Virtual boards that a program drops, copies, or closes beside a forked process."""

import copy
import gc
import os
import pickle
import signal
import subprocess

import pytest
from support.refusals import refusal

import spots
from spots.link.board import Board
from spots_sim.board import starting
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.scenario import Held

pytestmark = pytest.mark.board

ENDS_S = 20.0  # only a test that fails waits so long


@pytest.fixture
def started(monkeypatch):
    """The processes that virtual boards have started."""
    processes = []

    class Popen(subprocess.Popen):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            processes.append(self)

    monkeypatch.setattr(subprocess, "Popen", Popen)
    return processes


def opened(kind, sensor):
    return spots.open("virtual") if kind == "real time" else Board(LockstepLink(sensor, Held()))


KINDS = ["real time", "lockstep"]


@pytest.mark.parametrize("kind", KINDS)
def test_a_dropped_board_ends_its_processes(kind, started, sensor):
    board = opened(kind, sensor)
    for _ in board.frames(0.05):
        pass
    board.read_latest()
    assert started
    del board
    gc.collect()
    for process in started:
        process.wait(ENDS_S)


@pytest.mark.parametrize("kind", KINDS)
def test_a_dropped_board_leaves_no_file_open(kind, sensor):
    opened(kind, sensor).close()  # imports modules that stay open
    before = os.listdir("/proc/self/fd")
    for _ in range(3):
        opened(kind, sensor)
    gc.collect()
    assert len(os.listdir("/proc/self/fd")) <= len(before)


@pytest.mark.parametrize("kind", KINDS)
def test_closing_does_not_wait_for_a_forked_process(kind, started, sensor):
    board = opened(kind, sensor)
    child = os.fork()
    if not child:
        signal.alarm(30)
        signal.pause()
        os._exit(0)
    try:
        board.close()
        assert os.waitpid(child, os.WNOHANG) == (0, 0)
        assert all(process.poll() is not None for process in started)
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


@pytest.mark.parametrize("kind", KINDS)
def test_a_forked_process_that_drops_the_board_does_not_end_it(kind, sensor):
    board = opened(kind, sensor)
    child = os.fork()
    if not child:
        del board
        gc.collect()
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
    with board:
        assert board.command("hello")["board"] == "virtual"


def test_a_process_that_does_not_end_is_killed(started, sensor, monkeypatch):
    monkeypatch.setattr(starting, "_WAIT_S", 0.1)
    board = spots.open("virtual")
    simulator = next(one for one in started if "spots_sim" in " ".join(map(str, one.args)))
    simulator.send_signal(signal.SIGSTOP)
    board.close()
    assert simulator.returncode == -signal.SIGKILL


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickle.dumps])
def test_a_board_is_not_copied(copied, sensor):
    with opened("lockstep", sensor) as board:
        with refusal(TypeError):
            copied(board)
        assert board.command("hello")["board"] == "virtual"
