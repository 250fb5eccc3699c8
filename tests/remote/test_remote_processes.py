"""Zenoh with several processes: publishers are killed, readers stop; no frame is miscounted."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from contextlib import nullcontext, suppress
from itertools import islice
from types import SimpleNamespace

import pytest
from bench import remote as bench
from support.boards import running
from support.net import DEADLINE_S, frames, publishing, session, stand_in, wait_until
from support.refusals import refusal
from zenoh import handlers

import spots
from spots import Board
from spots.errors import BoardError
from spots.link import reconnect as reconnect_module
from spots_net import publish
from spots_net import publishing as publish_module
from spots_net.publish import Publisher


def spawn(net_file, *arguments):
    return subprocess.Popen(
        [sys.executable, "-m", "spots", *arguments, "--zenoh-config", str(net_file)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.board
def test_every_frame_of_several_boards_is_accounted_for():
    figures = bench.measure(boards=4, publishers=2, readers=3, rate_Hz=50, seconds=0.5, rounds=1)
    for mode in bench.MODES:
        counts = figures[mode]
        assert counts["sent"] > 3 * 4 * 2 * 10
        assert counts["received"] + counts["lost"] == counts["sent"]
        assert counts["received"] > 0
    assert set(figures["frames_to_tcp"]) >= {"latency_ms_p50", "publisher_us", "reader_us"}


def test_a_ledger_that_does_not_add_up_is_no_result():
    counts = {"sent": 10, "received": 8, "lost": 1}
    with pytest.raises(AssertionError, match="not accounted for"):
        bench._summary([counts])


def test_no_ctrl_c_is_lost_in_a_transfer(net, monkeypatch):
    def interrupt(number, frame):
        raise KeyboardInterrupt

    swallowed, ended = [], 0
    monkeypatch.setattr(sys, "unraisablehook", lambda seen: swallowed.append(seen.exc_type))
    before = signal.signal(signal.SIGALRM, interrupt)
    with session(net.hub) as own:
        publisher = Publisher(Board(stand_in()), session=own)
        own.declare_subscriber(frames("a1").key(0), handlers.Callback(lambda one: None, False))
        try:
            for _ in range(100):
                try:
                    signal.setitimer(signal.ITIMER_REAL, 0.001)
                    while not swallowed:
                        publisher._copy = b"1234\0"
                        publisher._send()
                except KeyboardInterrupt:
                    ended += 1
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)
            publisher.close()
    assert (ended, swallowed) == (100, [])


def test_ctrl_c_while_the_board_is_announced_ends_cleanly(monkeypatch, capsys):
    ended = []

    class Announced:
        def __init__(self, board, **settings):
            self.close = lambda: ended.append("publisher")

        @property
        def place(self):
            raise KeyboardInterrupt

    stats = SimpleNamespace(frames=3, lost=0, bad_crc=0)
    board = SimpleNamespace(stats=stats, stream=lambda *kinds: None, sensors=())
    monkeypatch.setattr(publish, "Publisher", Announced)
    monkeypatch.setattr(publish_module, "open_named", lambda options: nullcontext(board))
    with suppress(KeyboardInterrupt):
        options = SimpleNamespace(seconds=None, to=None, name="", qos="reliable", depth=1)
        publish_module.publish_command(options)
    assert ended == ["publisher"]
    assert "3 frames" in capsys.readouterr().err


@pytest.mark.board
def test_a_publisher_killed_outright_and_back(net, monkeypatch):
    monkeypatch.setattr(reconnect_module, "PATIENCE_S", DEADLINE_S)
    with running("") as start:
        port = start["port"]
        publisher = spawn(net.hub, "publish", "--port", port)
        assert publisher.stdout.readline().startswith("published as ")
        with spots.open("zenoh:") as board:
            touches = board.touches()
            list(islice(touches, 20))
            settings = board.command("get", DEADLINE_S)
            publisher.kill()
            publisher.communicate()
            again = spawn(net.hub, "publish", "--port", port)
            wait_until(lambda: next(touches) and board.stats.restarts == 1)
            list(islice(touches, 20))
            assert board.stats.lost == board.stats.bad_crc == 0
            with refusal(BoardError, why="not_here"):
                board.command("set exposure_us=20000")
            now = board.command("get", DEADLINE_S)
            assert (now["exposure_us"], now["keys"]) == (settings["exposure_us"], 0)
        again.send_signal(signal.SIGINT)
        out, told = again.communicate(timeout=DEADLINE_S)
        assert out.startswith("published as ")
        assert "lost 0, bad 0" in told
        assert again.returncode == 0


@pytest.mark.board
def test_a_reader_that_stands_still_holds_up_nobody(net):
    # Buffers are small, so they are full soon. A publisher that waited for room would then block
    # for ever.
    hub = json.loads(net.hub.read_text())
    hub["listen"]["endpoints"][0] += "#so_sndbuf=4096;so_rcvbuf=4096"
    never = {"congestion_control": {"block": {"wait_before_close": 10**9}}}
    hub["transport"] = {"link": {"tx": {"queue": never}}}
    net.hub.write_text(json.dumps(hub))
    link = stand_in(rate_Hz=100_000)
    with publishing(net.hub, link):
        reader = spawn(net.leaf, "subscribe", "--json")
        first = json.loads(reader.stdout.readline())
        reader.send_signal(signal.SIGSTOP)
        try:
            begun = link._port.count
            wait_until(lambda: link._port.count > begun + 10_000)
        finally:
            reader.send_signal(signal.SIGCONT)
        sequences = [first["sequence"]]
        while len(sequences) < 2 or sequences[-1] - sequences[-2] <= 3:
            sequences.append(json.loads(reader.stdout.readline())["sequence"])
        reader.kill()
        reader.communicate()


@pytest.mark.board
def test_subscribe_prints_as_monitor_does(net):
    wanted = {" 42.500 mm   3.000 N", "spectrum  flags 1  gain 256.0", "link  connected  frames "}
    with publishing(net.hub, stand_in()):
        reader = spawn(net.leaf, "subscribe", "/**")
        while wanted:
            line = reader.stdout.readline()
            assert line.startswith("a1  ")
            wanted -= {part for part in wanted if part in line}
        reader.send_signal(signal.SIGINT)
        _, told = reader.communicate(timeout=DEADLINE_S)
    assert told == "listening to /** (Ctrl-C ends it)\n"
    assert reader.returncode == 0


@pytest.mark.board
def test_what_has_no_zenoh_is_told_how_to_get_it():
    program = (
        "import sys; sys.modules['zenoh'] = None; import spots.cli; sys.exit(spots.cli.main())"
    )
    for arguments in (["subscribe"], ["publish"], ["monitor", "--port", "zenoh:"]):
        run = subprocess.run(
            [sys.executable, "-c", program, *arguments],
            capture_output=True,
            text=True,
            env=os.environ,
        )
        assert run.returncode == 2
        assert "need Zenoh: pip install " in run.stderr
        assert run.stderr.endswith('[zenoh]"\n')
        assert run.stderr.count("\n") == 1


@pytest.mark.board
def test_a_program_that_does_not_close_its_board_ends(net):
    program = "import spots; print(next(spots.open('zenoh:a1').touches()).force_mN)"
    with publishing(net.hub, stand_in()):
        run = subprocess.run(
            [sys.executable, "-c", program], capture_output=True, text=True, timeout=DEADLINE_S
        )
    assert (run.returncode, run.stdout) == (0, "3000\n")
