"""The virtual board in real time, in a separate process, through a PTY and pyserial."""

import contextlib
import json
import os
import select
import signal
import subprocess
import sys
import time
from itertools import islice

import pytest
from support.refusals import refusal
from support.taps import TAPS

import spots
from spots.cli import main
from spots.errors import PortError
from spots.link.frames import Text
from spots.link.serial_link import SerialLink
from spots_device.reading.decode import DROPPED
from spots_sim.board.realtime import Console
from spots_sim.demo.virtual import open_virtual

pytestmark = pytest.mark.board


def test_open_read_close_and_open_again():
    for _ in range(2):
        with spots.open("virtual") as board:
            touches = [touch for touch, _ in zip(board.touches(), range(50))]
            assert board.stats.lost == board.stats.bad_crc == 0
        times_s = [touch.time_s for touch in touches]
        assert times_s == sorted(times_s)


def test_no_program_can_open_the_boards_own_end_of_its_console():
    console = Console()
    with refusal(PortError):
        SerialLink(os.ttyname(console.board_in))
    SerialLink(console.name).close()


def test_a_port_is_for_one_program_and_can_be_opened_again():
    board, _ = open_virtual("default", "demo", 0)
    with board:
        with refusal(PortError):
            spots.open(board.port)
        board._link.close()
        with spots.open(board.port) as again:
            assert again.info["id"] == board.info["id"]


def test_a_silent_reader_costs_frames_but_no_bad_bytes_and_no_stall():
    with spots.open("virtual") as board:
        board.command("set exposure_us=1000")
        board.command("stream touch")  # with spectra, there are frames without flags, too
        decoder, heard = spots.Decoder(), []
        board.channel.taps.append(lambda data, now_s: heard.extend(decoder.feed(data)))
        time.sleep(3)  # longer than the PTY's buffers last
        # The frames in the buffers are read first; then the stream continues.
        frames = list(board.frames(1.0))
        assert board.stats.bad_crc <= 1
        assert board.stats.lost > 0
        assert any(frame.flags & DROPPED for frame in frames)
        assert len(list(islice(board.frames(60.0), 200))) == 200  # the stream continues
    untold = False  # replies are numbered too, and have no flags
    for before, frame in zip(heard, heard[1:]):
        untold |= (frame.sequence - before.sequence) % 65_536 != 1
        if not isinstance(frame, Text):
            assert frame.flags & DROPPED or not untold
            untold = False


def test_the_latest_reading_is_new_however_long_one_waited():
    with spots.open("virtual") as board:
        before = next(board.touches())
        time.sleep(0.5)
        latest = board.read_latest()
        following = next(board.touches())
        assert latest.sequence > before.sequence + 10  # not the first of about 50 waiting frames
        # Between the two frames, no frame is missing except those that the board dropped.
        assert following.flags & DROPPED or following.sequence == latest.sequence + 1


def test_the_board_ends_with_whoever_started_it():
    code = (
        "import spots, time\n"
        "board = spots.open('virtual')\n"
        "print(board.port, flush=True)\n"
        "time.sleep(60)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    port = process.stdout.readline().strip()
    assert os.path.exists(port)
    process.send_signal(signal.SIGKILL)
    process.wait()
    deadline_s = time.monotonic() + 10
    while os.path.exists(port) and time.monotonic() < deadline_s:
        time.sleep(0.05)
    assert not os.path.exists(port)


def test_a_command_from_the_shell(capsys):
    assert main(["command", "--port", "virtual", "set", "average=2"]) == 0
    assert json.loads(capsys.readouterr().out)["average"] == 2


def test_the_demo_off_a_terminal_prints_plain_lines():
    run = [sys.executable, "-m", "spots", "demo", "--seconds", "1.5"]
    output = subprocess.run(run, capture_output=True, text=True, timeout=60, check=True).stdout
    assert len(output.splitlines()) >= 4
    assert any(" mm " in line and " N" in line for line in output.splitlines())


def test_the_demo_in_real_time_loses_nothing(capsys, tmp_path):
    scenario = tmp_path / "taps.toml"
    scenario.write_text(TAPS)
    assert main(["demo", "--seconds", "3", "--json", "--scenario", str(scenario)]) == 0
    run = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert run["runtime"].startswith("micropython")
    assert run["lost"] == run["bad_crc"] == 0
    assert run["touches"] >= 2
    assert run["position_rmse_um"] <= 150


NOISE = """
[faults]
from_s = 5.0
[faults.to_board]
bursts = { per_min = 40.0, last_ms = 30.0, damage_percent = 50.0 }
"""


@pytest.mark.parametrize("faults", ["", NOISE], ids=["", "through noise"])
def test_a_host_that_writes_faster_than_the_board_reads_stops_nothing(faults, tmp_path):
    scenario = tmp_path / "scenario.toml"
    scenario.write_text("seconds = 600.0\n" + faults)
    with open_virtual("default", str(scenario), 0)[0] as board:
        port = os.open(board.port, os.O_RDWR | os.O_NOCTTY)
        try:
            os.set_blocking(port, False)
            sent, end_s = 0, time.monotonic() + 60
            while sent < 80_000:  # more than all buffers on the way take
                assert time.monotonic() < end_s, "the board takes no more"
                try:
                    sent += os.write(port, (b"x" * 200 + b"\n") * 5)
                except BlockingIOError:
                    select.select([port], [], [], 0.01)
                    with contextlib.suppress(BlockingIOError):
                        os.read(port, 1 << 16)
        finally:
            os.close(port)


STATES = {
    "it streams": "",
    "the host has filled all buffers": "flood",
    "the machine runs a program that asks for nothing": "busy",
    "the machine is stopped": "stopped",
}
STARTER = """
import os, select, sys, time
from spots_sim.demo.virtual import start_simulator

def until(wanted, asked=b""):
    heard = b""
    while wanted not in heard:
        os.write(port, asked)
        if select.select([port], [], [], 0.05)[0]:
            heard += os.read(port, 4096)

start, end = start_simulator("default", "demo", 0)
port = os.open(start["port"], os.O_RDWR | os.O_NOCTTY)
os.set_blocking(port, False)
until(b"protocol", b"hello\\n")
if sys.argv[1] == "flood":
    full = 0
    while full < 100:
        try:
            os.write(port, b"hello\\n" * 50)
        except BlockingIOError:
            full += 1
            time.sleep(0.001)
if sys.argv[1] == "busy":
    os.write(port, b"\\r\\x03\\x03")
    until(b">>>")
    os.write(port, b"while True: pass\\r\\n\\r\\n")
    until(b"pass")
if sys.argv[2] == "copied" and os.fork() == 0:
    time.sleep(60)
print("ready", flush=True)
time.sleep(600)
"""


def processes():
    """Return (number of the parent, command) of each running process, as a dict by its number."""
    run = ["ps", "-A", "-ww", "-o", "pid=", "-o", "ppid=", "-o", "stat=", "-o", "args="]
    lines = subprocess.run(run, capture_output=True, text=True, check=True).stdout.splitlines()
    rows = [line.split(None, 3) for line in lines]
    return {int(row[0]): (int(row[1]), row[-1]) for row in rows if row[2][0] != "Z"}


def under(parent, alive):
    """Return the numbers of the processes in `alive` that `parent` started, also indirectly."""
    ours = {parent}
    while more := {number for number in alive if alive[number][0] in ours} - ours:
        ours |= more
    return ours - {parent}


KILLED = "the starter", "the simulator"
COPIED = "", "copied"  # whether another process has inherited the simulator's pipe
# Each state, and each pair of a killed process and a pipe, occurs.
ENDS = [
    pytest.param(state, KILLED[s % 2], COPIED[s // 2], id=f"{name}, {KILLED[s % 2]} is killed")
    for s, (name, state) in enumerate(STATES.items())
]


@pytest.mark.parametrize(("state", "killed", "copied"), ENDS)
def test_nothing_of_a_virtual_board_outlives_its_parent(state, killed, copied):
    arguments = [sys.executable, "-c", STARTER, state, copied]
    starter = subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True)
    others = set()
    try:
        assert starter.stdout.readline() == "ready\n"
        alive = processes()
        others = under(starter.pid, alive)
        (simulator,) = (n for n in others if "spots_sim.board.realtime" in alive[n][1])
        ours = under(simulator, alive)
        (machine,) = (n for n in ours if "heapsize" in alive[n][1])
        if state == "stopped":
            os.kill(machine, signal.SIGSTOP)
        os.kill(starter.pid if killed == "the starter" else simulator, signal.SIGKILL)
        end_s = time.monotonic() + 30
        while left := {simulator, *ours} & processes().keys():
            assert time.monotonic() < end_s, [alive[number] for number in left]
            time.sleep(0.05)
    finally:
        starter.kill()
        for number in others & processes().keys():
            os.kill(number, signal.SIGKILL)
        starter.communicate()  # after the kill, because the copy has the same output pipe
