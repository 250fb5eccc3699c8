"""Clients that open connections and send nothing cannot block the browsers of other users."""

import asyncio
import contextlib
import gc
import select
import socket
import time

import aiohttp
import pytest
from support.serving import run, until

from spots.common import connections
from spots_web import app
from spots_web.state import PageState

HALF_OPEN = 300
WAIT_S = 60.0
HALF = {
    "nothing": b"",
    "half a line": b"GET / HT",
    "half a header": b"GET / HTTP/1.1\r\nHost: ",
    "half a body": b"POST /recording HTTP/1.1\r\nHost: 127.0.0.1:%d\r\nContent-Length: 9\r\n\r\nst",
    "a request and no more": b"GET / HTTP/1.1\r\nHost: 127.0.0.1:%d\r\n\r\n",
    "half a second request": b"GET / HTTP/1.1\r\nHost: 127.0.0.1:%d\r\n\r\nGET / HT",
}
UPGRADE = (
    b"GET /live HTTP/1.1\r\nHost: 127.0.0.1:%d\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n\r\n"
)
# After the upgrade: an acknowledgement, a ping, a command, and half a frame.
FRAMES = b"".join(
    bytes((first, 0x80 | len(body), 0, 0, 0, 0)) + body
    for first, body in ((0x81, b"1"), (0x89, b"x"), (0x81, b"set gain=3"), (0x01, b""))
)
VISITS = [*HALF.values(), b"no HTTP\r\n\r\n", UPGRADE, UPGRADE + FRAMES]
ROUNDS = 30


@contextlib.contextmanager
def half_open(server, count, data=HALF["half a header"]):
    """Open `count` connections that send a part of a request; close them after the `with` block."""
    with contextlib.ExitStack() as stack:
        opened = []
        for _ in range(count):
            one = stack.enter_context(socket.create_connection(("127.0.0.1", server.port), WAIT_S))
            one.sendall(data.replace(b"%d", b"%d" % server.port))
            opened.append(one)
        yield opened


def has_ended(connection, timeout_s=WAIT_S):
    """Return whether the server closes a connection in time; data that it sends is ignored."""
    try:
        while select.select([connection], [], [], timeout_s)[0]:
            if not connection.recv(1 << 16):
                return True
    except ConnectionError:
        return True
    return False


def test_half_open_connections_are_bounded_and_a_page_gets_in(serve, open_page, caplog):
    server = serve(PageState())
    with half_open(server, HALF_OPEN) as opened:
        page = open_page(server.url)
        until(page, "performance.getEntriesByType('resource').length > 0")
        assert page.title()
        closed = opened[: HALF_OPEN - connections.CONNECTIONS_MAX]
        assert all(map(has_ended, closed))
    assert caplog.records == []


@pytest.mark.parametrize("data", HALF.values(), ids=HALF)
def test_a_connection_that_is_no_page_ends(serve, monkeypatch, caplog, data):
    monkeypatch.setattr(connections, "CONNECTION_S", 0.2)
    server = serve(PageState())
    with half_open(server, 1, data) as (one,):
        assert has_ended(one)
    assert caplog.records == []


def test_a_page_stays_when_others_end(serve, monkeypatch):
    monkeypatch.setattr(connections, "CONNECTION_S", 0.2)
    state = PageState()
    server = serve(state)

    async def look():
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(server.url + "live") as page,
        ):
            for number in range(3):
                with half_open(server, connections.CONNECTIONS_MAX + 1) as opened:
                    await asyncio.to_thread(lambda: [has_ended(one) for one in opened])
                state.put("recording", {"on": False, "file": f"{number}"})
                while f'"{number}"' not in (message := await page.receive(WAIT_S)).data:
                    assert message.type == aiohttp.WSMsgType.TEXT
                    await page.send_str(str(message.json()["n"]))
                await page.send_str(str(message.json()["n"]))

    run(look())


def test_ended_connections_are_not_counted(serve):
    server = serve(PageState())
    with half_open(server, 1) as (kept,):
        for _ in range(2 * connections.CONNECTIONS_MAX):
            with half_open(server, 1, b"no HTTP\r\n\r\n") as (one,):
                assert has_ended(one)
        assert not has_ended(kept, 0.0)


@pytest.mark.board
def test_connections_that_have_ended_leave_nothing_in_memory(serve):
    state = PageState()
    server = serve(state)

    def visit(rounds):
        for i in range(rounds):
            state.put("touch", {"position_um": i})
            for data in VISITS:
                with half_open(server, 1, data) as (one,):
                    if data.startswith(UPGRADE[:9]):
                        one.recv(100)

    def objects():
        gc.collect()
        return len(gc.get_objects())

    visit(ROUNDS)  # caches fill
    before, end_s = objects(), time.monotonic() + WAIT_S
    visit(ROUNDS)
    # Fewer than one more object for two connections. The last connections may not have ended yet.
    while objects() - before >= ROUNDS * len(VISITS) // 2:
        assert time.monotonic() < end_s, "objects of connections that have ended are left"
        time.sleep(0.1)


def test_a_page_notices_that_nothing_arrives_and_the_server_shows_that_it_lives(
    serve, open_page, monkeypatch
):
    # The other tests end connections; here one stays open, as when a network stops delivering.
    monkeypatch.setattr(app, "_ALIVE_S", 0.1)
    server = serve(PageState())

    async def listen():
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(server.url + "live") as page,
        ):
            first = (await page.receive(WAIT_S)).json()
            return first["n"], [(await page.receive(WAIT_S)).json() for _ in range(2)]

    assert run(listen()) == (1, [{"n": 1}, {"n": 1}])
    monkeypatch.setattr(app, "_ALIVE_S", 1e6)
    page = open_page(server.url)
    until(page, "document.body.dataset.link === 'live'")
    until(page, "document.querySelector('#next').textContent.includes('does not answer')")


def test_a_page_below_the_path_of_a_proxy_connects_below_it(serve, browser):
    server = serve(PageState())
    page, below = browser.new_page(), server.url + "user/me/"
    sockets = []
    page.on("websocket", lambda socket: sockets.append(socket.url))
    page.route(
        below + "**",
        lambda route: route.fulfill(
            response=route.fetch(url=server.url + route.request.url.removeprefix(below))
        ),
    )
    page.goto(below)
    page.wait_for_event("websocket") if not sockets else None
    assert sockets[0] == below.replace("http", "ws") + "live"
    page.close()
