"""The web application: static files, a WebSocket for the state, and requests for changes.

On the WebSocket, the server sends states as numbered messages. A browser returns the number of a
message after drawing it, and sends nothing else. While two messages are not drawn, the server
waits; then it sends the newest state, so stale states never wait in a queue. Each second, the
number of the last message is sent again, alone: it shows a browser that the server answers. A
request that changes something is a POST, and needs the access token.
"""

import asyncio
import logging
import mimetypes
import re
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
from aiohttp import WSCloseCode, WSMsgType, web
from aiohttp.http import HttpProcessingError
from aiohttp.http_exceptions import PayloadEncodingError

from spots.common.guarded import Guarded
from spots.common.reports import is_limit
from spots.errors import SpotsError, printable
from spots.outputs.usages import ALIASES_FILE, USAGES_FILE

from .guard import Guard, host_of
from .pace import PagePace
from .panels import installed
from .request_queue import RequestQueue
from .state import PageState

STATIC = Path(__file__).parent / "static"
_FILES = {p.relative_to(STATIC).as_posix(): p for p in STATIC.rglob("*") if p.is_file()}
_FILES |= {"usages.txt": USAGES_FILE, "aliases.txt": ALIASES_FILE}
_CLIENTS_MAX = 64  # browser windows
_ACK_MAX = 16  # bytes of a message from a browser
_NUMBER = re.compile("[0-9]+")
_HEARTBEAT_S = 20.0  # interval of aiohttp's pings, which detect lost browsers
_ANSWER_S = 10.0  # longest wait for the answer to a request
_ALIVE_S = 1.0  # interval of messages that only show that the server answers
_PING_EVERY = 32  # number of messages between two pings
NOTHING: Mapping[str, RequestQueue] = {}


# Exceptions of aiohttp for requests that are not HTTP, or whose body does not match the header.
_DAMAGED = (HttpProcessingError, web.RequestPayloadError, PayloadEncodingError)


def _is_fault(record: logging.LogRecord) -> bool:
    """Return whether a log record reports a fault of this program, not a damaged request.

    At the limit of open files, one line is printed instead of all log records.
    """
    error = record.exc_info[1] if record.exc_info else None
    return not isinstance(error, (*_DAMAGED, ConnectionError)) and not is_limit(error)


LOG = logging.getLogger(__name__)
LOG.addFilter(_is_fault)


class PageApp:
    """Web application that sends the state of the web UI to browsers; runs in one event loop.

    The requests to each path of `queues`, such as ``strip``, need the access token. `on_page` is
    called with the transport of each connection that becomes a WebSocket.
    """

    def __init__(
        self, state: PageState, guard: Guard, queues: Mapping[str, RequestQueue] = NOTHING
    ):
        self.on_page: Callable[[asyncio.BaseTransport | None], None] = lambda transport: None
        self._state, self._guard, self._queues = state, guard, queues
        panels = installed()
        self._panels = [panel.message() for panel in panels]
        # Files by name: no name from a request reaches the file system.
        self._files = {f"static/{name}": path for name, path in _FILES.items()}
        for panel in panels:
            self._files |= {f"panels/{panel.name}/{name}": p for name, p in panel.files.items()}
        self._loop = asyncio.get_running_loop()
        self._clients: dict[web.WebSocketResponse, asyncio.Event] = {}
        self._waking = False
        self._wake = Guarded(self._wake_all, "waking the browsers", self._not_woken)
        self._sending = Guarded(self._send_news, "sending to a browser")
        state.on_change = Guarded(self._changed, "waking the web server")
        self.web = web.Application(middlewares=[guard.check])
        self.web.router.add_get("/", self._static)
        self.web.router.add_get("/live", self._live)
        for path, receiver in queues.items():
            self.web.router.add_post("/" + path, partial(self._request, receiver))
        self.web.router.add_get("/{name:(?:static|panels)/.*}", self._static)
        self.web.on_response_prepare.append(_add_headers)
        self.web.on_shutdown.append(self._close)

    def _changed(self) -> None:
        # The reader's thread calls this thousands of times a second, so only one call of `_wake` is
        # pending at any time.
        if not self._waking:
            self._waking = True
            try:
                self._loop.call_soon_threadsafe(self._wake)
            except Exception:
                self._waking = False  # the next change wakes the loop
                if not self._loop.is_closed():
                    raise

    def _not_woken(self, why: str) -> None:
        self._waking = False  # the next change wakes the loop

    def _wake_all(self) -> None:
        self._waking = False
        for news in self._clients.values():
            news.set()

    async def _static(self, request: web.Request) -> web.Response:
        # Not a FileResponse: its sendfile raises RuntimeError if the client has disconnected.
        name = request.match_info.get("name", "static/index.html")
        path = self._files.get(name)
        if path is None:
            raise web.HTTPNotFound
        kind = mimetypes.guess_type(name)[0] or "application/octet-stream"
        charset = "utf-8" if kind.startswith("text/") else None
        return web.Response(body=path.read_bytes(), content_type=kind, charset=charset)

    async def _request(self, receiver: RequestQueue, request: web.Request) -> web.Response:
        try:
            body = await request.clone(client_max_size=receiver.request_max).read()
            wanted = receiver.decode(body)
        except _DAMAGED:
            raise web.HTTPBadRequest(text="the body of the request is damaged") from None
        except ValueError as error:
            raise web.HTTPBadRequest(text=str(error)) from None
        try:
            submitted = asyncio.wrap_future(receiver.submit(wanted))
            answer = await asyncio.wait_for(submitted, _ANSWER_S)
        except SpotsError as error:
            raise web.HTTPConflict(text=str(error)) from None
        except asyncio.TimeoutError:
            raise web.HTTPServiceUnavailable(
                text=f"there is no answer after {_ANSWER_S:g} s: try again"
            ) from None
        if answer is None:
            return web.Response(status=204)
        return web.json_response(answer, dumps=_json)

    async def _live(self, request: web.Request) -> web.WebSocketResponse:
        if len(self._clients) >= _CLIENTS_MAX:
            raise web.HTTPServiceUnavailable(
                text=f"{_CLIENTS_MAX} browser windows are open: close one"
            )
        socket = web.WebSocketResponse(
            autoping=False, heartbeat=_HEARTBEAT_S, max_msg_size=_ACK_MAX, compress=False
        )
        await socket.prepare(request)
        self.on_page(request.transport)
        news, pace = asyncio.Event(), PagePace(time.monotonic)
        news.set()
        self._clients[socket] = news
        may_command = self._queues and self._guard.may_command(request)
        first = {"panels": self._panels, **({"may_command": True} if may_command else {})}
        tasks = [
            asyncio.create_task(self._send_news(socket, news, pace, first)),
            asyncio.create_task(self._show_alive(socket, pace)),
        ]
        try:
            async for message in socket:
                if message.type == WSMsgType.PONG:
                    pace.pong(message.data)
                elif message.type == WSMsgType.PING:
                    await socket.pong(message.data)
                elif message.type == WSMsgType.TEXT and _NUMBER.fullmatch(message.data):
                    pace.acknowledge(int(message.data))
                else:
                    await socket.close(
                        code=WSCloseCode.POLICY_VIOLATION,
                        message=b"only numbers of messages are accepted",
                    )
        finally:
            del self._clients[socket]
            for task in tasks:
                task.cancel()
        return socket

    async def _send_news(
        self, socket: web.WebSocketResponse, news: asyncio.Event, pace: PagePace, first: dict
    ) -> None:
        cursor = self._state.begin()
        try:
            while not socket.closed:
                await news.wait()
                await pace.room()
                news.clear()
                cursor, parts = self._state.since(cursor)
                if parts or first:
                    parts, first = first | parts, {}
                    number = pace.send()
                    message = _json({"n": number, **parts})
                    if number % _PING_EVERY == 1:
                        await socket.ping(pace.ping())
                    await socket.send_str(message)
                    await asyncio.sleep(pace.every_s)
        except Exception as error:
            await self._end(socket, error)

    async def _show_alive(self, socket: web.WebSocketResponse, pace: PagePace) -> None:
        try:
            while not socket.closed:
                await asyncio.sleep(_ALIVE_S)
                if pace.sent:
                    await socket.send_str(_json({"n": pace.sent}))
        except Exception as error:
            await self._end(socket, error)

    async def _end(self, socket: web.WebSocketResponse, error: Exception) -> None:
        if not isinstance(error, ConnectionError):  # the browser has closed the connection
            # The browser reconnects and starts from the newest state.
            self._sending.failed(error)
            await socket.close(code=WSCloseCode.INTERNAL_ERROR, message=b"the server failed")

    async def _close(self, app: web.Application) -> None:
        for socket in list(self._clients):
            await socket.close(code=WSCloseCode.GOING_AWAY, message=b"the server ends")


def _json(message: Any) -> str:
    """Return a message of JSON types as JSON, also with names that are not UTF-8."""
    try:
        return msgspec.json.encode(message).decode()
    except UnicodeEncodeError:
        return msgspec.json.encode(_printable(message)).decode()


def _printable(message: Any) -> Any:
    # The name of a file can have bytes that are not UTF-8; Python reads them as surrogates.
    if isinstance(message, str):
        return printable(message)
    if isinstance(message, Mapping):
        return {_printable(name): _printable(value) for name, value in message.items()}
    if isinstance(message, (list, tuple)):
        return [_printable(one) for one in message]
    return message


async def _add_headers(request: web.Request, response: web.StreamResponse) -> None:
    host = host_of(request)
    # A Content-Security-Policy cannot contain an IPv6 address.
    live = f" ws://{request.host} wss://{request.host}" if host and ":" not in host[0] else ""
    response.headers.update(
        {
            "Content-Security-Policy": (
                "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
                f"connect-src 'self'{live}; base-uri 'none'; form-action 'none'; "
                "frame-ancestors 'none'"
            ),
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "Cross-Origin-Opener-Policy": "same-origin",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cache-Control": "no-cache",
        }
    )
