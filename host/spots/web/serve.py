"""``spots serve``: a reader and a web server, until Ctrl-C."""

from __future__ import annotations

import argparse
import asyncio
import ipaddress
import secrets
import signal
import socket
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ..errors import SpotsError, missing
from ..guarded import Guarded
from ..keyboard.layout import load
from ..linkage.twin_source import is_recording, linkage_of
from .board_feed import BoardReader, finder
from .browser import print_address
from .connections import Connections
from .recordings import Recordings
from .state import PageState
from .twin_feed import driven_readers, linkage_readers

try:
    from aiohttp import web

    from .app import LOG, PageApp
    from .guard import Guard
except ImportError:
    raise missing("the page needs", "aiohttp", "web") from None

LOOPBACK = "127.0.0.1"
_WATCH_EVERY_S = 0.5


class Server:
    """The page on an address; an async context manager.

    Parameters
    ----------
    state : PageState
    address : str
        An IP address of this machine. Any but a loopback one asks everyone for a token.
    port : int
        0 for any that is free.
    token : str, optional
        A new one, if not given.
    recordings : Recordings, optional
        What who has the token may start and stop; the reader has to have the same.

    Attributes
    ----------
    url : str
        What to open, with the token if there is one.

    Raises
    ------
    SpotsError
        If the address is not of this machine, or the port is in use.
    """

    def __init__(
        self,
        state: PageState,
        address: str = LOOPBACK,
        port: int = 0,
        token: str | None = None,
        recordings: Recordings | None = None,
    ):
        self._state, self._address, self._port = state, address, port
        self._recordings = recordings
        try:
            at_home = ipaddress.ip_address(address).is_loopback
        except ValueError:
            raise SpotsError(f"'{address}' is no IP address, such as 192.168.1.20") from None
        secret = not at_home or recordings is not None
        self._token = (token or secrets.token_urlsafe(16)) if secret else None
        self.url = ""

    async def __aenter__(self) -> Server:
        app = PageApp(self._state, Guard(self._address, self._token), self._recordings)
        self._runner = web.AppRunner(app.web, access_log=None, logger=LOG, shutdown_timeout=1.0)
        await self._runner.setup()
        connections = Connections(self._runner.server)
        app.on_page = connections.release
        try:
            self._listener = await asyncio.get_running_loop().create_server(
                connections, self._address, self._port
            )
        except OSError as error:
            await self._runner.cleanup()
            raise SpotsError(
                f"cannot serve on {self._address} port {self._port}: {error.strerror}; "
                "--http-port takes another port, --address an address of this machine"
            ) from None
        address, port = self._listener.sockets[0].getsockname()[:2]
        if ipaddress.ip_address(address).is_unspecified:
            address = _outward(address)
        host = f"[{address}]" if ":" in address else address
        query = f"?token={self._token}" if self._token else ""
        self.url = f"http://{host}:{port}/{query}"
        return self

    async def __aexit__(self, *exception) -> None:
        self._listener.close()
        await self._runner.cleanup()


def serve_command(options: argparse.Namespace) -> None:
    """Run ``spots serve`` with the options that `cli` parsed."""
    state, layout, ports = PageState(), load(options.layout), options.port
    recordings = _recordings(options, state)
    if options.linkage is None:
        if len(ports) > 1:
            raise SpotsError("one --port is shown; a linkage has two, and a --linkage FILE")
        port = ports[0] if ports else None
        open_board = finder(port, options.sensor, options.scenario, options.seed)
        readers = [BoardReader(open_board, layout, state, recordings=recordings)]
    elif simulated := linkage_of(ports):
        machine = simulated(options.sensor, options.linkage, seed=options.seed)
        readers = driven_readers(machine, layout, state)
    else:
        readers = linkage_readers(options.linkage, ports, layout, state)
    serve(state, options.address, options.http_port, readers, print_address, recordings)


def _recordings(options: argparse.Namespace, state: PageState) -> Recordings | None:
    if options.record_to is None:
        return None
    if options.linkage is not None or any(map(is_recording, options.port)):
        raise SpotsError("--record-to is for one board, not for a linkage or a recording")
    return Recordings(Path(options.record_to), state)


def serve(
    state: PageState,
    address: str,
    port: int,
    readers: list[BoardReader],
    on_start: Callable[[str], None],
    recordings: Recordings | None = None,
) -> None:
    """Serve until Ctrl-C or SIGTERM.

    Parameters
    ----------
    state : PageState
    address : str
    port : int
        As for `Server`.
    readers : list of BoardReader
        Of the state.
    on_start : callable
        Called with the URL.
    recordings : Recordings, optional
        As for `Server`.
    """

    async def main():
        async with Server(state, address, port, recordings=recordings) as server:
            ended = _ended_by_sigterm()
            watches = [Guarded(reader.watch, "watching a reader") for reader in readers]
            for reader in readers:
                reader.start()
            on_start(server.url)
            while not ended.is_set():
                for watch in watches:
                    watch()
                with suppress(asyncio.TimeoutError):
                    await asyncio.wait_for(ended.wait(), _WATCH_EVERY_S)

    try:
        asyncio.run(main())
    except KeyboardInterrupt:
        pass
    finally:
        for reader in readers:
            reader.stop()


def _ended_by_sigterm() -> asyncio.Event:
    ended = asyncio.Event()
    with suppress(NotImplementedError, RuntimeError):  # on Windows, and in threads
        asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, ended.set)
    return ended


def _outward(address: str) -> str:
    """Return this machine's address towards others; nothing is sent to find it."""
    six = ":" in address
    with socket.socket(socket.AF_INET6 if six else socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("2001:db8::1" if six else "192.0.2.1", 9))
            return probe.getsockname()[0]
        except OSError:
            return socket.gethostname()
