"""The virtual board in CPython, for computers without MicroPython or without PTYs."""

from __future__ import annotations

import gc
import json
import socket
import subprocess
import sys
import time

import numpy as np
import pytest
from support.taps import TAPS

import spots
from spots.cli import main
from spots.link.connect import upload
from spots.link.frames import Touch
from spots_sim.board import vm
from spots_sim.board.cpython_realtime import SocketPort

TIMEOUT_S = 120
PASSES = 5000


@pytest.fixture(autouse=True)
def cpython(monkeypatch):
    monkeypatch.setenv("SPOTS_VIRTUAL_RUNTIME", "cpython")


WITHOUT_PTY = """
import os, sys
sys.modules["pty"] = sys.modules["tty"] = None
del os.openpty, os.ttyname
"""


@pytest.fixture(params=["pty", "socket"])
def port(request, monkeypatch, tmp_path):
    """Select a PTY or a socket as port of virtual boards; return how the port's name begins."""
    monkeypatch.setenv("SPOTS_VIRTUAL_PORT", request.param)
    if request.param == "pty":
        return "/dev/"
    (tmp_path / "sitecustomize.py").write_text(WITHOUT_PTY)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return "socket://127.0.0.1:"


def figures(capsys, *arguments):
    assert main(["demo", "--json", *arguments]) == 0
    return json.loads(capsys.readouterr().out.splitlines()[-1])


def demo(*arguments):
    run = [sys.executable, "-m", "spots", "demo", *arguments]
    return subprocess.run(run, capture_output=True, text=True, timeout=TIMEOUT_S, check=True).stdout


@pytest.mark.board
def test_a_program_reads_it_as_any_board(port):
    with spots.open("virtual") as board:
        assert board.port.startswith(port)
        assert board.info["runtime"].startswith("cpython 3.")
        # On a busy machine, a second can pass before the first press is seen.
        touches = []
        for touch, count in zip(board.touches(), range(2000)):
            touches.append(touch)
            if count >= 50 and touch.trusted:
                break
        assert board.stats.lost == board.stats.bad_crc == 0
    times_s = [touch.time_s for touch in touches]
    assert times_s == sorted(times_s)
    assert touches[-1].trusted


@pytest.mark.board
@pytest.mark.parametrize("port", ["socket"], indirect=True)
def test_its_port_is_for_one_program_and_can_be_opened_again(port):
    with spots.open("virtual") as board:
        with pytest.raises(spots.SpotsError):
            spots.open(board.port)
        board.command("get")
        board._link.close()
        with spots.open(board.port) as again:
            assert again.info["id"] == board.info["id"]


def test_a_socket_takes_the_next_program_before_it_has_read_the_end_of_the_last_one():
    def client():
        return socket.create_connection(("127.0.0.1", int(port.name.rpartition(":")[2])))

    def received(wanted):
        for _ in range(PASSES):
            if port.receive() == wanted:
                return True
            time.sleep(0.001)
        return False

    port = SocketPort()
    with client() as first:
        first.sendall(b"a")
        assert received(b"a")
        with client() as refused:
            assert received(b"")
            assert refused.recv(1) == b""
        first.sendall(b"b")
    with client() as second:
        second.sendall(b"c")
        assert received(b"b")
        assert received(b"c")


@pytest.mark.board
@pytest.mark.parametrize("port", ["socket"], indirect=True)
def test_a_reboot_keeps_what_was_saved_and_nothing_else(port):
    with spots.open("virtual") as board:
        board.command("set average=3")
        board.command("save")
        board.command("set average=4")
        board.command("stream touch")
        board.command("reboot")
        for _ in board.frames(TIMEOUT_S):
            if board.stats.restarts:
                break
        assert board.command("get")["average"] == 3


@pytest.mark.board
@pytest.mark.parametrize("port", ["socket"], indirect=True)
def test_the_demo_names_what_runs_the_firmware(port):
    first, *readings = demo("--seconds", "2").splitlines()
    assert first.startswith("runtime: cpython 3.")
    assert any(" mm " in line and " N" in line for line in readings)


@pytest.mark.board
@pytest.mark.parametrize("port", ["pty"], indirect=True)
def test_the_demo_in_real_time_loses_nothing(port, capsys, tmp_path):
    scenario = tmp_path / "taps.toml"
    scenario.write_text(TAPS)
    run = figures(capsys, "--seconds", "3", "--scenario", str(scenario))
    assert run["runtime"].startswith("cpython 3.")
    assert run["lost"] == run["bad_crc"] == 0
    assert run["touches"] >= 2
    assert run["position_rmse_um"] <= 150


@pytest.mark.board
def test_in_simulated_time_it_meets_the_figures_with_the_same_bytes_each_run(capsys):
    first, second = (figures(capsys, "--fast", "--seconds", "5") for _ in range(2))
    assert first == second
    assert first["rate_hz"] >= 95
    assert first["lost"] == first["bad_crc"] == 0
    assert first["position_rmse_um"] <= 150


@pytest.mark.board
def test_the_keyboard_demo_types_its_text(capsys):
    run = figures(capsys, "--fast", "--use", "keyboard", "--seconds", "13")
    assert run["typed"] == "hello strip, type 42!\n"
    assert run["host_agrees"]


@pytest.mark.board
@pytest.mark.parametrize("port", ["socket"], indirect=True)
def test_the_keyboard_demo_in_real_time(port, capsys):
    run = figures(capsys, "--use", "keyboard", "--seconds", "7")
    # Tests in simulated time check the typed keys, and that host and board agree. In real time, a
    # host that is stopped for 0.3 s releases its keys.
    assert run["presses"] >= 3
    assert run["runtime"].startswith("cpython")


@pytest.mark.board
def test_two_boards_of_a_linkage_share_nothing(capsys):
    assert figures(capsys, "--use", "fivebar", "--fast")["error_mm"]["rms"] < 1


@pytest.mark.board
def test_faults_of_a_scenario_reach_it(capsys):
    run = figures(capsys, "--fast", "--scenario", "fire", "--seconds", "25")
    assert run["restarts"] >= 1  # brown-outs
    assert run["bad_crc"] > 0
    assert run["touches"] > 0


@pytest.mark.board
def test_a_key_goes_to_the_usb_host(rig, calibration, tmp_path):
    made = rig(calibration=calibration, folder=tmp_path)
    made.board.command("set keys=1")
    made.board.command("save")
    made.close()
    made = rig(folder=tmp_path)
    made.press(4.0, 1500)
    made.settle()
    assert made.link.usb.reports == [(0, bytes((0, 0, 30, 0, 0, 0, 0, 0)))]
    made.board.command("reboot")  # releases all keys
    made.settle(0.5)
    assert made.link.usb.reports[1] == (0, bytes(8))


def test_the_firmware_collects_no_garbage_of_the_host(rig, calibration):
    made = rig()
    begun = []
    gc.disable()  # now only a call of gc.collect begins a collection
    gc.callbacks.append(lambda phase, info: begun.append(phase))
    try:
        upload(made.board, calibration)
        made.board.command("reboot")
        made.settle(0.5)
    finally:
        gc.callbacks.pop()
        gc.enable()
    assert not begun


@pytest.mark.board
def test_the_readings_are_those_of_micropython(rig, calibration, monkeypatch):
    means = []
    for runtime in ("cpython", "micropython"):
        monkeypatch.setenv("SPOTS_VIRTUAL_RUNTIME", runtime)
        made = rig(calibration=calibration)
        assert made.board.info["runtime"].startswith(runtime)
        made.press(42.0, 2000.0)
        readings = made.readings(40, Touch)
        means.append(np.mean([(one.position_um, one.force_mN) for one in readings], axis=0))
    assert means[0] == pytest.approx(means[1], abs=30)


def test_a_crash_of_the_firmware_is_logged_and_it_restarts(rig):
    made = rig()
    made.readings(2)
    made.link.bus.write_read = None  # not callable: no OSError, which the firmware expects
    made.settle(0.5)
    assert any("crashed and restarts" in line["text"] for line in made.board.log)
    del made.link.bus.write_read
    assert len(made.readings(5)) == 5


def test_without_a_micropython_nobody_has_to_ask_for_it(capsys, monkeypatch):
    monkeypatch.delenv("SPOTS_VIRTUAL_RUNTIME")
    monkeypatch.setattr(vm.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(vm.shutil, "which", lambda name: None)
    assert figures(capsys, "--fast", "--seconds", "1")["runtime"].startswith("cpython")


def test_an_unknown_runtime_is_one_sentence(capsys, monkeypatch):
    monkeypatch.setenv("SPOTS_VIRTUAL_RUNTIME", "jython")
    assert main(["demo", "--fast"]) == 2
    error = capsys.readouterr().err
    assert "SPOTS_VIRTUAL_RUNTIME must be 'micropython' or 'cpython', not 'jython'" in error
    assert error.count("\n") == 1


@pytest.mark.board
@pytest.mark.parametrize(("sensor", "code"), [("default", 0), ("nope", 2)])
def test_it_ends_with_whoever_started_it(sensor, code):
    run = subprocess.run(
        [sys.executable, "-m", "spots_sim.board.cpython_realtime", sensor, "demo", "0", "1"],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    assert run.stderr == b""
    assert run.returncode == code
    assert ("error" in json.loads(run.stdout)) == bool(code)
