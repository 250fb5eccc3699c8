"""Exceptions in threads and callbacks of the host: reported, and the thread continues."""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import subprocess
import sys
import threading
import time
from concurrent.futures import Future
from pathlib import Path
from types import SimpleNamespace

import aiohttp
import pytest
from bench import remote as bench
from support.net import ask, publishing, session, stand_in, wait_until
from support.refusals import refusal

import spots
from spots import Board
from spots.errors import StateError
from spots.keyboard.layout import load
from spots.link.channel import Channel
from spots.link.frames import Touch
from spots.link.timeouts import CONNECTED
from spots.recording import disk
from spots_net import mailbox, subscribe, to_foxglove
from spots_net import zenoh_session as session_module
from spots_net.zenoh_link import ZenohLink
from spots_sim.person import person
from spots_sim.strip.scenario import Held, Press
from spots_web import app as app_module
from spots_web import recordings as recordings_module
from spots_web.board_feed import BoardReader
from spots_web.recordings import Recordings
from spots_web.serve import Server
from spots_web.state import PageState

HOST = Path(spots.__file__).parents[1]
ERRORS = ValueError, RecursionError, MemoryError


class Fault:
    """Makes one call of a function raise an exception; the other calls work."""

    def __init__(self, error):
        self._error = error
        self.raised = 0

    def into(self, function, at=1):
        calls = 0

        def faulty(*arguments, **named):
            nonlocal calls
            calls += 1
            if calls == at:
                self.raised += 1
                raise self._error("put in by a test")
            return function(*arguments, **named)

        return faulty

    def patch(self, monkeypatch, owner, name, at=1):
        monkeypatch.setattr(owner, name, self.into(getattr(owner, name), at))


@pytest.fixture(params=ERRORS, ids=lambda kind: kind.__name__)
def fault(request, capfd):
    made = Fault(request.param)
    yield made
    assert made.raised == 1
    told = capfd.readouterr().err
    assert "Traceback" not in told
    (sentence,) = (line for line in told.splitlines() if "put in by a test" in line)
    assert sentence.startswith("spots: ")
    assert request.param.__name__ in sentence


def reading(open_board, state=None, **options):
    state = state or PageState()
    return BoardReader(open_board, load("digits"), state, 0.01, **options), state


def shown(state):
    return state.since(state.begin())[1]


def goes_on(reader, state):
    try:
        wait_until(
            lambda: shown(state)["board"]["state"] == CONNECTED and shown(state).get("touch")
        )
    finally:
        reader.stop()


def open_stand_in(board_id=None):
    return Board(stand_in())


def test_a_reader_whose_board_cannot_be_opened(fault):
    reader, state = reading(fault.into(open_stand_in))
    reader.start()
    goes_on(reader, state)


def test_a_reader_while_it_reads(fault, monkeypatch):
    fault.patch(monkeypatch, Channel, "pump", at=100)
    reader, state = reading(open_stand_in)
    reader.start()
    wait_until(lambda: fault.raised)
    goes_on(reader, state)


def test_a_reader_whose_state_is_shown_elsewhere(fault):
    reader, state = reading(open_stand_in, on_touch=fault.into(lambda touch: None, at=5))
    reader.start()
    wait_until(lambda: fault.raised)
    goes_on(reader, state)


def test_a_reader_that_cannot_show_its_state(fault):
    state = PageState()
    reader, _ = reading(open_stand_in, state)
    reader.start()
    wait_until(lambda: shown(state).get("touch"))
    state.put = fault.into(state.put, at=20)
    wait_until(lambda: fault.raised)
    goes_on(reader, state)


def test_a_list_of_recordings_that_is_asked_for(fault, tmp_path, monkeypatch):
    fault.patch(monkeypatch, Recordings, "_list")
    recordings = Recordings(tmp_path, PageState())
    with refusal(StateError):
        recordings.submit("list").result(30)
    wait_until(recordings._reading.done)
    assert recordings.submit("list").result(30) == {"files": []}


def test_a_recording_that_is_asked_for(fault, tmp_path, monkeypatch):
    state = PageState()
    recordings = Recordings(tmp_path, state)
    fault.patch(monkeypatch, recordings_module, "Recorder")
    reader, _ = reading(open_stand_in, state, queues=[recordings])
    reader.start()
    wait_until(lambda: recordings._attended)
    with refusal(StateError):
        recordings.submit("start").result(2)
    assert recordings.submit("start").result(30) is None
    goes_on(reader, state)


def test_the_thread_that_writes_a_recording_to_its_medium(fault, tmp_path, monkeypatch):
    monkeypatch.setattr(disk, "_SYNC_EVERY_S", 0.01)
    synced = []
    fsync = fault.into(lambda number: synced.append(number))
    monkeypatch.setattr(disk, "os", SimpleNamespace(fsync=fsync))
    one = disk.Disk(tmp_path / "a.spots")
    one.append(b"first")
    wait_until(lambda: fault.raised)
    one.append(b"second")
    wait_until(lambda: synced)
    one.close()


@pytest.mark.parametrize("place", ["_changed", "_wake", "encode"])
def test_a_page_gets_the_newest_state(fault, place, monkeypatch):
    async def newest():
        state = PageState()
        if place == "_wake":
            fault.patch(monkeypatch, app_module.PageApp, "_wake_all")
        async with Server(state) as server, aiohttp.ClientSession() as client:
            if place == "_changed":
                owner = asyncio.get_running_loop()
                fault.patch(monkeypatch, owner, "call_soon_threadsafe")
                state.put("first", 0)
            elif place == "encode":
                encode = fault.into(app_module.msgspec.json.encode, at=2)
                json = SimpleNamespace(encode=encode)
                monkeypatch.setattr(app_module, "msgspec", SimpleNamespace(json=json))
            for _ in range(3):
                url = server.url.replace("http", "ws") + "live"
                # If the server closes the connection, an answer that is being sent fails.
                with contextlib.suppress(ConnectionError):
                    async with client.ws_connect(url) as page:
                        while not fault.raised:
                            state.put("next", 1)
                            await asyncio.sleep(0.01)
                        state.put("last", 1)
                        async for message in page:
                            await page.send_str(str(message.json()["n"]))
                            if "last" in message.json():
                                return

    asyncio.run(asyncio.wait_for(newest(), 30))


def test_frames_that_come_from_zenoh(net, fault, monkeypatch):
    with publishing(net.hub, stand_in()):
        fault.patch(monkeypatch, mailbox.Mailbox, "put", at=3)
        with spots.open("zenoh:a1") as board:
            touches = board.touches()
            wait_until(lambda: next(touches) and fault.raised)
            assert next(touches).force_mN == 3000


@pytest.mark.board
def test_a_board_that_appears_on_zenoh(net, fault, monkeypatch):
    fault.patch(monkeypatch, ZenohLink, "_note")
    with publishing(net.hub, stand_in()), spots.open("zenoh:a1") as board:
        assert next(board.touches()).force_mN == 3000
        wait_until(lambda: fault.raised)


@pytest.mark.board
def test_boards_that_are_looked_for_on_zenoh(net, fault, monkeypatch):
    condition = threading.Condition()
    fault.patch(monkeypatch, condition, "notify_all")
    monkeypatch.setattr(session_module, "threading", SimpleNamespace(Condition=lambda: condition))
    monkeypatch.setattr(session_module, "_PATIENCE_S", 5.0)
    with publishing(net.hub, stand_in()), spots.open("zenoh:") as board:
        assert board.info["id"] == "a1"


@pytest.mark.board
def test_what_is_subscribed_to(net, fault, monkeypatch, capfd):
    with publishing(net.hub, stand_in()):
        fault.patch(monkeypatch, mailbox.Mailbox, "put")
        options = SimpleNamespace(topics="/**", json=False, seconds=1.0)
        subscribe.subscribe_command(options)
        out, err = capfd.readouterr()
        assert " 42.500 mm" in out
        os.write(2, err.encode())


def test_questions_that_come_from_zenoh(net, fault, monkeypatch):
    from spots_net import answers

    fault.patch(monkeypatch, answers.Answers, "_note")
    with publishing(net.hub, stand_in()), session(net.leaf) as other:
        wait_until(lambda: fault.raised or not list(ask(other, "a1", "get", timeout=0.5)))
        wait_until(lambda: list(ask(other, "a1", "get")))


def test_a_board_that_is_published_in_a_measurement(fault):
    ended, closed = threading.Event(), Future()
    quiet = SimpleNamespace(
        now_s=time.monotonic,
        stream=lambda *kinds: None,
        frames=lambda: SimpleNamespace(within=lambda seconds: iter(())),
    )
    outlet = SimpleNamespace(
        turn=fault.into(lambda: time.sleep(0.01)), close=lambda: closed.set_result(None)
    )
    serve = bench.serving(quiet, outlet, ended)
    serve.start()
    wait_until(lambda: fault.raised)
    ended.set()
    serve.join()
    assert closed.done()


def test_a_finger_that_another_process_moves(fault, monkeypatch, tmp_path):
    fault.patch(monkeypatch, person.json, "loads")
    held, pipe = Held(), tmp_path / "finger"
    os.mkfifo(pipe)
    person.follow_pipe(held, pipe)
    line = person.line_of([(0.0, 60.0, Press(42.5, 3000.0, 8.0))])
    with pipe.open("w") as moves:
        moves.write(2 * line)
    wait_until(lambda: "presses" in vars(held))
    assert fault.raised
    assert held.presses(0.0)[0].position_mm == 42.5


@pytest.mark.parametrize("place", ["_give_all", "send_bytes"])
def test_foxglove_gets_the_newest_readings(fault, place, monkeypatch):
    async def newest(made):
        url = made.place.partition(" at ")[2]
        subscribe = {"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 1}]}
        while True:
            async with aiohttp.ClientSession() as client, client.ws_connect(url) as viewer:
                await viewer.send_json(subscribe)
                while not viewer.closed:
                    made.put(Touch(0, 7, 5000, 9, 0, 0, 42_000, 1500, 1.25), 1e9)
                    with contextlib.suppress(asyncio.TimeoutError):
                        message = await viewer.receive(0.05)
                        if message.type is aiohttp.WSMsgType.BINARY and fault.raised:
                            return

    owner = to_foxglove.Foxglove if place == "_give_all" else to_foxglove.web.WebSocketResponse
    fault.patch(monkeypatch, owner, place)
    with Board(stand_in()) as board:
        made = to_foxglove.Foxglove(board, "127.0.0.1:0")
        asyncio.run(asyncio.wait_for(newest(made), 60))
        made.close()


@pytest.mark.board
@pytest.mark.parametrize(
    ("platform", "call"), [(sys.platform, "select.select"), ("win32", "os.read")]
)
def test_the_watch_over_a_parent_ends_the_virtual_board(platform, call):
    """The virtual board ends if the thread that watches its parent process fails.

    Without this thread, the board would continue after the end of its parent.
    """
    program = f"""
import time
from spots_sim import starting
def fail(*arguments): raise OSError("put in by a test")
starting.sys.platform, starting.{call}, starting._END_S = {platform!r}, fail, 0.0
starting.when_parent_ends(lambda: None)
time.sleep(10)
"""
    ended = subprocess.run([sys.executable, "-c", program], stdin=subprocess.PIPE)
    assert ended.returncode == 1


@pytest.mark.parametrize(
    ("made_by", "modules"),
    [
        # A new thread or callback needs a test case above, and an entry here.
        (
            r"\bThread\(",
            {
                "spots/link/readers.py",
                "spots_web/board_feed.py",
                "spots/recording/disk.py",
                "spots/recording/record.py",
                "spots/terminal/hotkey.py",
                "spots_ble/ble_link.py",
                "spots_net/to_foxglove.py",
                "spots_sim/person/person.py",
                "spots_sim/board/starting.py",
            },
        ),
        (r"handlers\.Callback\(", {"spots_net/zenoh_session.py"}),
        (
            r"declare_subscriber\(",
            {
                "spots_net/zenoh_session.py",
                "spots_net/zenoh_link.py",
                "spots_net/subscribe.py",
            },
        ),
        (r"declare_queryable\(", {"spots_net/ros_node.py"}),
        # In `ble_link.py`, the caller of the thread waits for each task.
        (
            r"create_task\(|call_soon",
            {"spots_web/app.py", "spots_net/to_foxglove.py", "spots_ble/ble_link.py"},
        ),
        (r"\.on_change = ", {"spots_web/app.py", "spots_web/state.py"}),
        (r"add_signal_handler\(", {"spots_web/serve.py"}),
        # These run in the main thread, where an exception ends the program.
        (r"signal\.signal\(", {"spots/common/signals.py", "spots_web/serve.py"}),
        (r"Executor\(", {"spots_web/recordings.py"}),
        # Python prints an exception of such a function, and the program ends as it would have.
        (r"atexit\.", {"spots/link/readers.py"}),
        (r"Timer\(|run_in_executor|excepthook", set()),
        # Python prints an exception of a finalizer, and goes on; these only end processes.
        (
            r"weakref\.finalize",
            {
                "spots_sim/board/piped_board.py",
                "spots_sim/board/vm.py",
                "spots_sim/demo/virtual.py",
            },
        ),
        # The caller awaits the result, so that it gets the exception.
        (r"to_thread\(", {"spots/link/readings.py"}),
        (r"ensure_future\(|TaskGroup\(|add_done_callback|start_new_thread", set()),
    ],
)
def test_there_are_no_others(made_by, modules):
    found = {
        path.relative_to(HOST).as_posix()
        for path in HOST.rglob("*.py")
        if re.search(made_by, path.read_text(encoding="utf-8"))
    }
    assert found == modules
