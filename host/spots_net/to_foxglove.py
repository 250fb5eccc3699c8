"""Serves readings to Foxglove by a WebSocket, with the schemas of the MCAP export."""

import asyncio
import json
import re
import struct
import threading
from collections import deque
from concurrent.futures import Future
from typing import Annotated, Any

import msgspec
from aiohttp import WSMsgType, web

from spots.common.connections import Connections
from spots.common.doors import Door
from spots.common.guarded import Guarded
from spots.common.reports import REPORTS, on_loop_error
from spots.errors import RequirementError
from spots.link.board import Board
from spots.link.frames import Reading
from spots.recording.foxglove import schema
from spots.recording.table import tables

from .sending import KINDS, host_and_port, kind_of, plans, row

_DEFAULT = "127.0.0.1", 8765
# Pages of Foxglove itself, which may always connect.
ORIGINS = "https://app.foxglove.dev", "https://studio.foxglove.dev"
_PROTOCOLS = "foxglove.sdk.v1", "foxglove.websocket.v1"
_CLIENTS_MAX = 32
_WAITING_MAX = 256  # messages that wait for a client; the oldest ones are dropped
_REQUEST_MAX = 1 << 16  # bytes of a message from a client
_ORIGIN_MAX = 100  # characters that are printed
_HEARTBEAT_S = 10.0  # interval of pings: a client that does not answer is disconnected
_MESSAGE = struct.Struct("<BIQ")  # operation, number of the subscription, time in ns
_MESSAGE_DATA = 1
_Number = Annotated[int, msgspec.Meta(ge=0, lt=1 << 32)]
_encode = msgspec.json.Encoder().encode


class Foxglove:
    """Serves each kind of frame of each sensor as a topic, ``/spots/SENSOR/KIND``.

    It listens on the address ``HOST:PORT``; RequirementError if this is impossible. A page in a
    browser can connect if it is one of Foxglove, of this server's own host, or of `origins`. A
    client can only subscribe: the server announces no service, parameter or asset.
    """

    def __init__(self, board: Board, address: str = "", origins: tuple[str, ...] = ()):
        self._host, self._port = host_and_port(address, _DEFAULT, "Foxglove", least_port=0)
        self._board, self._began_s = board, board.now_s()
        self._plans = plans(board)
        self._name = f"SPOTS {board.info['id']}"
        named = [self._host] if re.search("[a-z]", self._host) and ":" not in self._host else []
        self._door = Door(self._host, named, (*ORIGINS, *origins))
        self._channels: dict[tuple[int, str], dict[str, Any]] = {}
        for sensor, plan in enumerate(self._plans):
            for table in (one for one in tables(plan) if one.name in KINDS):
                self._channels[sensor, table.name] = {
                    "id": len(self._channels) + 1,
                    "topic": f"/spots/{sensor}/{table.name}",
                    "encoding": "json",
                    "schemaName": f"spots.{table.name.capitalize()}",
                    "schemaEncoding": "jsonschema",
                    "schema": json.dumps(schema(table)),
                }
        self._clients: set[_Client] = set()
        self._give = Guarded(self._give_all, "sending to Foxglove")
        self._loop = asyncio.new_event_loop()
        self._loop.set_exception_handler(on_loop_error)
        opened: Future[int] = Future()
        self._thread = threading.Thread(target=self._run, args=(opened,), daemon=True)
        self._thread.start()
        try:
            port = opened.result()
        except OSError as error:
            raise RequirementError(
                f"cannot listen on {self._host}:{self._port} ({error.strerror or error}): give "
                "another address with --to foxglove=HOST:PORT"
            ) from None
        host = f"[{self._host}]" if ":" in self._host else self._host
        self.place = f"Foxglove at ws://{host}:{port}"

    def put(self, frame: Reading, utc_s: float) -> None:
        """Send a frame; for a client that is too slow, the oldest messages are dropped."""
        if not self._clients:
            return
        arrived_s = self._board.now_s() - self._began_s
        time_s = arrived_s if frame.time_s is None else frame.time_s - self._began_s
        channel = self._channels[frame.sensor, kind_of(frame)]["id"]
        message = _encode(row(frame, time_s, arrived_s, self._plans[frame.sensor]))
        self._loop.call_soon_threadsafe(self._give, channel, round(1e9 * utc_s), message)

    def turn(self) -> None:
        """Do nothing: the server has a thread of its own."""

    def close(self) -> None:
        """End the server."""
        self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join()

    def _run(self, opened: Future) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve(opened))
        except Exception as error:
            if opened.done():
                raise
            opened.set_exception(error)
        finally:
            self._loop.close()

    async def _serve(self, opened: Future) -> None:
        self._ended = asyncio.Event()
        app = web.Application(middlewares=[self._check])
        app.router.add_get("/", self._connected)
        runner = web.AppRunner(app, access_log=None, shutdown_timeout=1.0)
        await runner.setup()
        try:
            self._connections = Connections(runner.server)
            server = await self._loop.create_server(self._connections, self._host, self._port)
            opened.set_result(server.sockets[0].getsockname()[1])
            await self._ended.wait()
            server.close()
            for client in list(self._clients):
                await client.socket.close()
        finally:
            await runner.cleanup()

    @web.middleware
    async def _check(self, request: web.Request, handler) -> web.StreamResponse:
        if not self._door.knows_host(request.headers.getall("Host", [])):
            raise web.HTTPForbidden(text="unknown host name: use the address that was printed")
        origins = request.headers.getall("Origin", [])
        if not self._door.knows_origin(origins, request.headers["Host"]):
            origin = origins[0][:_ORIGIN_MAX]
            REPORTS.say(
                origin,
                f"a page of {origin} tried to read the board and was refused: if it is yours, add "
                f"--origin {origin}",
            )
            raise web.HTTPForbidden(text="requests from other websites are refused")
        return await handler(request)

    def _give_all(self, channel: int, time_ns: int, message: bytes) -> None:
        for client in self._clients:
            client.give(channel, time_ns, message)

    async def _connected(self, request: web.Request) -> web.StreamResponse:
        if len(self._clients) >= _CLIENTS_MAX:
            raise web.HTTPServiceUnavailable(text=f"{_CLIENTS_MAX} clients are connected")
        socket = web.WebSocketResponse(
            protocols=_PROTOCOLS,
            heartbeat=_HEARTBEAT_S,
            max_msg_size=_REQUEST_MAX,
            compress=False,
        )
        await socket.prepare(request)
        self._connections.release(request.transport)
        client = _Client(socket)
        self._clients.add(client)
        sending = asyncio.create_task(client.send())
        try:
            known = {"name": self._name, "capabilities": [], "sessionId": self._name}
            await socket.send_json({"op": "serverInfo", **known})
            await socket.send_json({"op": "advertise", "channels": [*self._channels.values()]})
            async for message in socket:
                if message.type is WSMsgType.TEXT:
                    client.take(message.data)
        except ConnectionError:
            pass  # the client has left
        finally:
            self._clients.discard(client)
            sending.cancel()
        return socket


class _Subscription(msgspec.Struct):
    id: _Number
    channelId: _Number


class _Request(msgspec.Struct):
    op: str
    subscriptions: list[_Subscription] = []
    subscriptionIds: list[_Number] = []


class _Client:
    """A connected client: its subscriptions, and the messages that wait for it."""

    def __init__(self, socket: web.WebSocketResponse):
        self.socket = socket
        self._subscriptions: dict[int, int] = {}  # channel by number of the subscription
        self._waiting: deque[bytes] = deque(maxlen=_WAITING_MAX)
        self._news = asyncio.Event()
        self._sending = Guarded(self.send, "sending to Foxglove")

    def take(self, text: str) -> None:
        """Subscribe or unsubscribe; ignore everything else."""
        try:
            wanted = msgspec.json.decode(text, type=_Request)
        except msgspec.MsgspecError:
            return
        if wanted.op == "subscribe":
            for one in wanted.subscriptions[: _WAITING_MAX - len(self._subscriptions)]:
                self._subscriptions[one.id] = one.channelId
        elif wanted.op == "unsubscribe":
            for number in wanted.subscriptionIds:
                self._subscriptions.pop(number, None)

    def give(self, channel: int, time_ns: int, message: bytes) -> None:
        """Add a message for each subscription to its channel."""
        for number, subscribed in self._subscriptions.items():
            if subscribed == channel:
                self._waiting.append(_MESSAGE.pack(_MESSAGE_DATA, number, time_ns) + message)
                self._news.set()

    async def send(self) -> None:
        """Send what waits, as fast as the client reads."""
        try:
            while not self.socket.closed:
                await self._news.wait()
                self._news.clear()
                while self._waiting:
                    await self.socket.send_bytes(self._waiting.popleft())
        except Exception as error:
            if not isinstance(error, ConnectionError):  # the client has left
                self._sending.failed(error)
                await self.socket.close()
