"""Slow clients of the web server: they must not slow down other clients."""

from __future__ import annotations

import asyncio
import gc
import threading
from types import SimpleNamespace

import aiohttp
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.refusals import refusal
from support.serving import Serving, run

from spots.errors import PortError, RefusedError
from spots.link import finder as reading
from spots_web import app
from spots_web.pace import PagePace
from spots_web.state import EVENTS_KEPT, PageState

AWAY_S = 0.06


def live(server):
    return f"http://127.0.0.1:{server.port}/live"


async def news(socket):
    """Return the next message that is more than a sign of life, which comes each second."""
    while (message := await socket.receive_json(timeout=60)).keys() == {"n"}:
        pass
    return message


@pytest.fixture
def state():
    return PageState()


@pytest.mark.board
def test_a_page_that_draws_nothing_gets_two_messages_and_then_the_newest(state, serve):
    server = serve(state)

    async def watch():
        async with aiohttp.ClientSession() as session:
            stalled = await session.ws_connect(live(server))
            awake = await session.ws_connect(live(server))
            last = 0
            for i in range(1, 200):
                state.put("touch", {"i": i})
                state.add_event({"kind": "key", "i": i})
                while last < i:
                    message = await awake.receive_json(timeout=60)
                    await awake.send_str(str(message["n"]))
                    last = message.get("touch", {"i": last})["i"]
            messages = [await news(stalled) for _ in range(2)]
            assert await stalled.receive_json(timeout=60) == {"n": 2}  # the server is alive
            await stalled.send_str("2")
            messages.append(await news(stalled))
            await stalled.close()
            await awake.close()
            return messages

    messages = run(watch())
    assert [message["n"] for message in messages] == [1, 2, 3]
    assert messages[-1]["touch"] == {"i": 199}
    told = [event["i"] for message in messages for event in message.get("events", [])]
    assert told == list(range(told[0], 200))
    assert told[0] <= 2
    assert not any("missed" in message for message in messages)


def test_the_way_to_a_page_is_measured_without_the_time_it_draws(state, serve, monkeypatch):
    # test_page_rate.py tests the resulting rate of messages, in simulated time.
    paces = []

    def made(now_s):
        paces.append(PagePace(now_s))
        return paces[-1]

    monkeypatch.setattr(app, "PagePace", made)
    server = serve(state)
    state.put("touch", 0)

    async def watch(pong_s, draw_s, seen):
        async with aiohttp.ClientSession() as session:
            before = len(paces)
            socket = await session.ws_connect(live(server), autoping=False)
            number = 0
            # The handshake may be complete before the server has created its `PagePace`.
            while len(paces) == before or not seen(paces[-1]):
                message = await socket.receive(timeout=60)
                if message.type == aiohttp.WSMsgType.PING:
                    await asyncio.sleep(pong_s)
                    await socket.pong(message.data)
                else:
                    number = message.json()["n"]
                    assert number < 1000
                    await asyncio.sleep(draw_s)
                    state.put("touch", number)
                    await socket.send_str(str(number))
            await socket.close()

    def known(pace):
        return pace._way_s is not None

    def near(pace):
        return known(pace) and pace._way_s < AWAY_S

    run(watch(AWAY_S, 0.0, known))
    assert paces[-1]._way_s >= AWAY_S
    run(watch(0.0, AWAY_S, near))
    assert len(paces) == 2


def test_a_message_is_what_changed_since_the_last(state, serve):
    server = serve(state)

    async def watch():
        state.put("board", {"state": "searching"})
        async with aiohttp.ClientSession() as session, session.ws_connect(live(server)) as socket:
            first = await news(socket)
            await socket.send_str("1")
            state.put("touch", {"i": 1})
            return first, await news(socket)

    first, second = run(watch())
    assert {key: first[key] for key in ("n", "board")} == {"n": 1, "board": {"state": "searching"}}
    assert second == {"n": 2, "touch": {"i": 1}}


def test_pages_that_go_leave_nothing(state, caplog):
    server = Serving(state)
    before = threading.active_count()

    async def come_and_go():
        async with aiohttp.ClientSession() as session:
            for i in range(30):
                async with session.ws_connect(live(server)) as socket:
                    state.put("touch", {"i": i})
                    await socket.receive_json(timeout=60)
                    await asyncio.sleep(0.03)  # it waits for news when the page goes

    run(come_and_go())
    tasks = asyncio.run_coroutine_threadsafe(_tasks(), server._loop).result(30)
    server.stop()
    assert threading.active_count() <= before
    assert tasks < 20
    gc.collect()
    assert "destroyed" not in caplog.text


async def _tasks():
    await asyncio.sleep(0.1)
    return len(asyncio.all_tasks())


def test_too_many_pages_are_refused(state, serve):
    server = serve(state)

    async def open_all():
        async with aiohttp.ClientSession() as session:
            sockets = [await session.ws_connect(live(server)) for _ in range(64)]
            with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
                await session.ws_connect(live(server))
            for socket in sockets:
                await socket.close()
            return refused.value.status

    assert run(open_all()) == 503


@given(st.lists(st.sampled_from(["put", "tell", "read"]), max_size=60), st.integers(0, 700))
def test_a_reader_knows_all_that_was_told_but_what_was_dropped(steps, burst):
    state = PageState()
    cursor, known, seen, missed, told = state.begin(), {}, [], 0, 0
    for step in [*steps, *["tell"] * burst, "read"]:
        if step == "put":
            state.put("touch", told)
        elif step == "tell":
            state.add_event({"i": told})
            told += 1
        else:
            cursor, news = state.since(cursor)
            seen += [event["i"] for event in news.pop("events", [])]
            missed += news.pop("missed", 0)
            known.update(news)
    assert missed + len(seen) == told
    assert missed == max(0, told - len(seen))
    assert seen == sorted(set(seen))
    assert seen[-EVENTS_KEPT:] == list(range(told))[-min(EVENTS_KEPT, len(seen)) :] or not seen
    assert state.since(cursor)[1] == {}


def test_only_the_board_that_was_there_is_taken_again(monkeypatch):
    closed = []

    def board(number):
        return SimpleNamespace(info={"id": number}, close=lambda: closed.append(number))

    there = [board("other"), board("mine")]
    monkeypatch.setattr(reading, "find", lambda: (there, []))
    monkeypatch.setattr(reading, "open_with", lambda port, options: there[0])
    open_board = reading.finder(None)
    assert open_board("mine").info["id"] == "mine"
    assert closed == ["other"]
    with refusal(PortError):
        open_board("gone")
    assert open_board(None).info["id"] == "other"
    named = reading.finder("/dev/ttyACM0")
    assert named("mine").info["id"] == "mine"  # although its port now has another name
    there.pop()
    with refusal(RefusedError):
        named("mine")
