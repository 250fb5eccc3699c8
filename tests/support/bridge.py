"""A static server of the page `live`, with a bridge from WebSockets to the PTY of a board."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from pathlib import Path

from aiohttp import WSMsgType, web
from serial import Serial

PREFIX = "/under/a/prefix"
_READ_S = 0.005


class Bridge:
    """Serves a folder below `PREFIX`, and a board's port to `serial.js`.

    `port` is the name of the board's port; None while it is unplugged. While `taken`, another
    program has opened it. `seen` has all bytes of the board. With `answers`, the port has no board,
    but a device that answers all that it gets with these bytes.
    """

    def __init__(self, folder: Path):
        self.port: str | None = None
        self.taken = self.permitted = False
        self.answers: bytes | None = None
        self.seen = bytearray()
        self.folder = folder
        self._open: web.WebSocketResponse | None = None
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        assert self._ready.wait(30)

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self._number}{PREFIX}/"

    @property
    def there(self) -> bool:
        return self.port is not None or self.answers is not None

    def unplug(self) -> None:
        """Disconnect the board from the page; set `port` to plug it in again."""
        self.port = None
        if self._open is not None:
            asyncio.run_coroutine_threadsafe(self._open.close(), self._loop).result(10)

    def stop(self) -> None:
        self._loop.call_soon_threadsafe(self._done.set)
        self._thread.join(10)

    def _run(self) -> None:
        asyncio.run(self._serve())

    async def _serve(self) -> None:
        self._loop, self._done = asyncio.get_running_loop(), asyncio.Event()
        app = web.Application()
        app.router.add_get("/ports", self._ports)
        app.router.add_get("/permit", self._permit)
        app.router.add_get("/bridge", self._bridge)
        app.router.add_get(PREFIX + "/", self._index)
        app.router.add_static(PREFIX, self.folder)
        runner = web.AppRunner(app, shutdown_timeout=0.1)
        await runner.setup()
        site = web.TCPSite(runner, "127.0.0.1", 0)
        await site.start()
        self._number = site._server.sockets[0].getsockname()[1]
        self._ready.set()
        await self._done.wait()
        await runner.cleanup()

    async def _index(self, request):
        return web.FileResponse(self.folder / "index.html")

    async def _ports(self, request):
        return web.json_response({"permitted": self.permitted and self.there})

    async def _permit(self, request):
        self.permitted = True
        return web.Response()

    async def _bridge(self, request):
        if self.taken or not self.there:
            raise web.HTTPConflict
        socket = web.WebSocketResponse()
        await socket.prepare(request)
        if self.answers is not None:
            async for _ in socket:
                await socket.send_bytes(self.answers)
            return socket
        self._open = socket
        with Serial(self.port, timeout=0, exclusive=True) as port:
            reading = asyncio.create_task(self._read(port, socket))
            async for message in socket:
                if message.type == WSMsgType.BINARY:
                    port.write(message.data)
            reading.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await reading
        self._open = None
        return socket

    async def _read(self, port: Serial, socket) -> None:
        while True:
            if data := port.read(1 << 16):
                self.seen += data
                await socket.send_bytes(data)
            await asyncio.sleep(_READ_S)
