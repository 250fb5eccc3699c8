"""The virtual board in real time: a PTY, pyserial, and a process of its own."""

import json
import os
import signal
import subprocess
import sys
import time
from itertools import islice

import pytest

import spots
from spots.cli import main
from spots.connect import open_virtual
from spots.frames import Text
from tactile.decode import DROPPED


def test_open_read_close_and_open_again():
    for _ in range(2):
        with spots.open("virtual") as board:
            touches = [touch for touch, _ in zip(board.touches(), range(50))]
            assert board.stats.lost == board.stats.bad_crc == 0
        times_s = [touch.time_s for touch in touches]
        assert times_s == sorted(times_s)


def test_a_port_is_for_one_program_and_can_be_opened_again():
    board, _ = open_virtual("default", "demo", 0)
    with board:
        with pytest.raises(spots.SpotsError, match="is busy"):
            spots.open(board.port)
        board._link.close()
        with spots.open(board.port) as again:
            assert again.info["id"] == board.info["id"]


def test_a_silent_reader_costs_frames_but_no_bad_bytes_and_no_stall():
    with spots.open("virtual") as board:
        board.command("set exposure_us=1000")
        board.command("stream touch spectrum")
        decoder, heard = spots.Decoder(), []
        board.tap(lambda data, now_s: heard.extend(decoder.feed(data)))
        time.sleep(3)  # longer than the PTY's buffers last
        # What waited in the buffers is read first; after it the stream goes on.
        frames = list(board.frames(1.0))
        assert board.stats.bad_crc <= 1
        assert board.stats.lost > 0
        assert any(frame.flags & DROPPED for frame in frames)
        assert len(list(islice(board.frames(60.0), 200))) == 200  # the stream goes on
    untold = False  # replies are numbered too, and have no flags
    for before, frame in zip(heard, heard[1:]):
        untold |= (frame.sequence - before.sequence) % 65_536 != 1
        if not isinstance(frame, Text):
            assert frame.flags & DROPPED or not untold
            untold = False


def test_the_latest_reading_is_new_however_long_one_waited():
    with spots.open("virtual") as board:
        board.touches()
        time.sleep(0.5)
        latest = board.read_latest()
        following = next(frame for frame in board.frames())
        assert following.sequence == (latest.sequence + 1) % 65_536  # nothing older was kept


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


def test_the_demo_in_real_time_loses_nothing(capsys):
    assert main(["demo", "--seconds", "3", "--json"]) == 0
    run = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert run["runtime"].startswith("micropython")
    assert run["lost"] == run["bad_crc"] == 0
    assert run["touches"] >= 2
    # A sliding finger is compared at a time that a busy machine makes vague; how exact the strip is
    # is asserted in simulated time.
    assert run["position_rmse_um"] <= 500
