"""``spots serve``: a reader and a web server, until Ctrl-C."""

from __future__ import annotations

import argparse
import asyncio
import ipaddress
import secrets
import signal
import socket
from collections.abc import Callable
from pathlib import Path

from ..connect import RECORDING, VIRTUAL
from ..errors import SpotsError
from ..uses.layout import load
from .browser import print_address, show
from .reader import Reader, finder
from .recordings import Recordings
from .state import State

try:
    from aiohttp import web

    from .app import App
    from .guard import Guard
except ImportError:
    raise SpotsError("the page needs aiohttp: pip install 'spots[web]'") from None

LOOPBACK = "127.0.0.1"
DEMO_LAYOUT = "digits"
_WATCH_EVERY_S = 0.5


class Server:
    """The page on an address; an async context manager.

    Parameters
    ----------
    state : State
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
        If the address is none of this machine's, or the port is taken.
    """

    def __init__(
        self,
        state: State,
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
        app = App(self._state, Guard(self._address, self._token), self._recordings)
        self._runner = web.AppRunner(app.web, access_log=None, shutdown_timeout=1.0)
        await self._runner.setup()
        try:
            await web.TCPSite(self._runner, self._address, self._port).start()
        except OSError as error:
            await self._runner.cleanup()
            raise SpotsError(
                f"cannot serve on {self._address} port {self._port}: {error.strerror}; "
                "--http-port takes another port, --address an address of this machine"
            ) from None
        address, port = self._runner.addresses[0][:2]
        if ipaddress.ip_address(address).is_unspecified:
            address = _outward(address)
        host = f"[{address}]" if ":" in address else address
        query = f"?token={self._token}" if self._token else ""
        self.url = f"http://{host}:{port}/{query}"
        return self

    async def __aexit__(self, *exception) -> None:
        await self._runner.cleanup()


def run(options: argparse.Namespace) -> None:
    """Run ``spots serve`` with the options that `cli` parsed."""
    open_board = finder(options.port, options.sensor, options.scenario, options.seed)
    state, recordings = State(), None
    if options.record_to is not None:
        if (options.port or "").startswith(RECORDING):
            raise SpotsError("--record-to is for a board; --port names a recording")
        recordings = Recordings(Path(options.record_to), state)
    serve(
        state,
        options.address,
        options.http_port,
        open_board,
        options.layout,
        print_address,
        recordings,
    )


def serve(
    state: State,
    address: str,
    port: int,
    open_board,
    layout: str,
    on_start: Callable[[str], None],
    recordings: Recordings | None = None,
) -> None:
    """Serve until Ctrl-C or SIGTERM.

    Parameters
    ----------
    state : State
    address : str
    port : int
        As for `Server`.
    open_board : callable
        As for `Reader`.
    layout : str
        Of keys, by path or name.
    on_start : callable
        Told the URL.
    recordings : Recordings, optional
        As for `Server`.
    """
    reader = Reader(open_board, load(layout), state, recordings=recordings)

    async def main():
        async with Server(state, address, port, recordings=recordings) as server:
            ended = _ended_by_sigterm()
            reader.start()
            on_start(server.url)
            while not ended.is_set():
                reader.watch()
                try:
                    await asyncio.wait_for(ended.wait(), _WATCH_EVERY_S)
                except asyncio.TimeoutError:
                    pass

    try:
        asyncio.run(main())
    except KeyboardInterrupt:
        pass
    finally:
        reader.stop()


def show_demo(sensor: str, scenario: str, seed: int) -> None:
    """Serve the virtual board, and open the page where there is a screen and somebody at it."""
    open_board = finder(VIRTUAL, sensor, scenario, seed)
    serve(State(), LOOPBACK, 0, open_board, DEMO_LAYOUT, show)


def _ended_by_sigterm() -> asyncio.Event:
    ended = asyncio.Event()
    try:
        asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, ended.set)
    except (NotImplementedError, RuntimeError):
        pass  # Windows has none, and threads get none
    return ended


def _outward(address: str) -> str:
    """Return this machine's address towards others; nothing is sent to find it."""
    family, far = (
        (socket.AF_INET6, "2001:db8::1") if ":" in address else (socket.AF_INET, "192.0.2.1")
    )
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((far, 9))
            return probe.getsockname()[0]
        except OSError:
            return socket.gethostname()
