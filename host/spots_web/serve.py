"""``spots serve``: reads boards, and serves the web UI until Ctrl-C."""

from __future__ import annotations

import argparse
import asyncio
import ipaddress
import os
import secrets
import signal
import socket
import sys
import threading
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from spots.common import atomic, signals
from spots.common.connections import Connections
from spots.common.reports import on_loop_error
from spots.errors import RequirementError, SettingError, SpotsError, missing, printable
from spots.keyboard.layout import load
from spots.link.board import Board
from spots.link.finder import finder
from spots.link.ports import offered, scheme_name

from .board_feed import BoardReader
from .calibration import PageCalibration
from .panel_feed import OpenPanels, readers_of
from .panels import Panel, installed
from .practice import PagePractice
from .recordings import Recordings
from .request_queue import RequestQueue
from .state import PageState
from .strip_choice import StripChoice

try:
    from aiohttp import web

    from .app import LOG, NOTHING, PageApp
    from .editors import KINDS, FileEditor, LayoutEditor, SettingsEditor
    from .guard import Guard
except ImportError as error:
    raise missing("the web UI needs", error.name or "aiohttp", "web") from None

LOOPBACK = "127.0.0.1"
_VIRTUAL = "virtual"  # port of the simulated strip


class Server:
    """Server of the web UI, as an asynchronous context manager.

    Parameters
    ----------
    state : PageState
        State of the web UI to serve.
    address : str
        IP address of this machine to listen on. Unless this is a loopback address, every browser
        needs the access token.
    port : int
        TCP port to listen on; 0 for any free port.
    queues : dict of RequestQueue, optional
        Handler of the requests to each path, such as ``strip``. These requests need the access
        token. Pass the same objects to the reader of the board.
    hosts : sequence of str
        Further names of this server, see `Guard`. With such a name, every browser needs the token.

    Attributes
    ----------
    url : str
        Address to open in a browser, with the access token if there is one.

    Raises
    ------
    SettingError
        If the address is not an IP address of this machine, the port is in use, or one of `hosts`
        is not a host name.
    """

    def __init__(
        self,
        state: PageState,
        address: str = LOOPBACK,
        port: int = 0,
        queues: Mapping[str, RequestQueue] = NOTHING,
        hosts: Sequence[str] = (),
    ):
        self._state, self._address, self._port = state, address, port
        self._queues = queues
        try:
            at_home = ipaddress.ip_address(address).is_loopback
        except ValueError:
            raise SettingError(
                f"'{address}' is not an IP address: give one such as 192.168.1.20"
            ) from None
        self._token = None if at_home and not queues and not hosts else secrets.token_urlsafe(16)
        self._guard = Guard(address, self._token, hosts)
        self.url = ""

    async def __aenter__(self) -> Server:
        asyncio.get_running_loop().set_exception_handler(on_loop_error)
        app = PageApp(self._state, self._guard, self._queues)
        self._runner = web.AppRunner(app.web, access_log=None, logger=LOG, shutdown_timeout=1.0)
        await self._runner.setup()
        connections = Connections(self._runner.server)
        app.on_page = connections.release
        try:
            self._listener = await asyncio.get_running_loop().create_server(
                connections, sock=_listening(self._address, self._port)
            )
        except OSError as error:
            await self._runner.cleanup()
            raise RequirementError(
                f"cannot serve on {self._address} port {self._port}: {os.strerror(error.errno)}; "
                "choose another port with --http-port, or an address of this machine with --address"
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
    several = [panel for panel in installed() if panel.boards_option]
    several_shown = " or ".join(panel.boards_option for panel in several)
    read_by_panel = any(panel.reads(options) for panel in several)
    if options.practice:
        others = options.session or options.record_to or read_by_panel
        if others or ports not in ([], [_VIRTUAL]):
            names = "--port", "--session", "--record-to", *map(_option, several)
            raise SettingError(
                f"--practice shows a simulated strip: leave out {', '.join(names[:-1])} and "
                f"{names[-1]}"
            )
        ports = [_VIRTUAL]
    queues: dict[str, RequestQueue] = {}
    _check_files(options)
    if options.record_to is not None:
        queues["recording"] = Recordings(Path(options.record_to), state)
    elif options.session is not None:
        queues["calibration"] = PageCalibration(Path(options.session), state)
    elif options.practice:
        queues["calibration"] = PagePractice(options, state)
    if options.edit is not None:
        queues["layout"] = LayoutEditor(Path(options.edit), layout, state)
    for name in KINDS:
        if (path := getattr(options, f"edit_{name}")) is not None:
            queues[name] = SettingsEditor(name, Path(path), state)
    if queues:
        queues["strip"] = StripChoice()
    played = any(scheme_name(port) == "recording" for port in ports)
    if queues and (read_by_panel or played):
        named = "record_to", "session", "edit", *(f"edit_{name}" for name in KINDS)
        given = (name for name in named if getattr(options, name) is not None)
        option = f"--{next(given).replace('_', '-')}"
        others = " or ".join([*map(_option, several), "a recording"])
        raise SettingError(f"{option} works with one board: do not use it with {others}")
    if options.record_to is not None and options.session is not None:
        raise SettingError("--record-to and --session exclude each other: use only one of them")
    if options.session and ports and offered(ports[0], "calibration_setup"):
        raise SettingError(
            "--session needs a person who presses the strip, and nobody can press a virtual board: "
            f"use 'spots serve --practice' or 'spots calibrate --port {ports[0]}', which simulate "
            "the presses"
        )
    if len(ports) > 1 and not read_by_panel:
        advice = f", or add {several_shown}" if several else ""
        raise SettingError(
            f"'spots serve' shows one board, but --port was given {len(ports)} times: name one "
            f"port{advice}"
        )
    panels = OpenPanels(state, options)
    if panels.sources:
        readers = readers_of(panels.sources, layout, state)
    else:
        queues |= panels.requests
        port = ports[0] if ports else None
        open_board = _announced(finder(port, options))
        readers = [
            BoardReader(open_board, layout, state, on_touch=panels.on_touch, queues=queues.values())
        ]
    for panel in installed():
        if panel.fault:
            print(f"spots: {panel.fault}", file=sys.stderr)
    for queue in queues.values():
        if isinstance(queue, FileEditor) and not queue.file.path.exists():
            print(f"{printable(str(queue.file.path))} is a new file: the first change writes it")
    hosts = options.host or ()
    serve(state, options.address, options.http_port, readers, queues=queues, hosts=hosts)


def _option(panel: Panel) -> str:
    return panel.boards_option.partition(" ")[0]


def _announced(open_board: Callable[[str | None], Board]) -> Callable[[str | None], Board]:
    """Return a function that opens a board, and prints each new reason why there is none."""
    reason = ""

    def opened(board_id: str | None) -> Board:
        nonlocal reason
        try:
            board = open_board(board_id)
        except SpotsError as error:
            if str(error) != reason:
                reason = str(error)
                print(f"spots: waiting for a board: {reason}", file=sys.stderr, flush=True)
            raise
        reason = ""
        return board

    return opened


def _check_files(options: argparse.Namespace) -> None:
    """Check that no two options make the web UI write to the same file."""
    named = {"--edit": options.edit}
    named |= {f"--edit-{name}": getattr(options, f"edit_{name}") for name in KINDS}
    files = {option: Path(name) for option, name in named.items() if name}
    if options.session:
        session = Path(options.session)
        files["--session"] = session
        if session.name:
            files["the calibration of --session"] = session.with_suffix(".toml")
    atomic.distinct(files)


def serve(
    state: PageState,
    address: str,
    port: int,
    readers: list[BoardReader],
    on_start: Callable[[str], None] = lambda url: None,
    queues: Mapping[str, RequestQueue] = NOTHING,
    hosts: Sequence[str] = (),
) -> None:
    """Print the address of the web UI, then serve the web UI until Ctrl-C or SIGTERM.

    The readers fill the state; they are started and stopped here. ``on_start(url)`` is called when
    the web UI can be opened. The other arguments are those of `Server`.
    """

    async def main():
        async with Server(state, address, port, queues, hosts) as server:
            ended = _ended_by_signal(noted)
            for reader in readers:
                reader.start()
            print(f"the web UI is at {server.url} (Ctrl-C ends it)", flush=True)
            on_start(server.url)
            await ended.wait()

    try:
        with suppress(KeyboardInterrupt), _interrupt_noted() as noted:
            asyncio.run(main())
    finally:
        for reader in readers:
            reader.stop()


@contextmanager
def _interrupt_noted() -> Generator[list[int] | None]:
    """Only note a Ctrl-C in the block: its exception would leave a half-built event loop.

    None if the program handles Ctrl-C in another way.
    """
    noted: list[int] = []
    handler = signal.getsignal(signal.SIGINT)
    main_thread = threading.current_thread() is threading.main_thread()
    if not main_thread or handler != signal.default_int_handler:
        yield None
        return
    signal.signal(signal.SIGINT, lambda number, frame: noted.append(number))
    try:
        yield noted
    finally:
        signal.signal(signal.SIGINT, handler)


def _ended_by_signal(noted: Sequence[int] | None) -> asyncio.Event:
    ended = asyncio.Event()
    try:
        names = ("SIGTERM", "SIGHUP") if noted is None else ("SIGINT", "SIGTERM", "SIGHUP")
        for number in signals.numbers(*names):
            if signal.getsignal(number) != signal.SIG_IGN:  # as nohup sets it
                asyncio.get_running_loop().add_signal_handler(number, ended.set)
    except NotImplementedError:  # Windows
        if noted is not None:
            signal.signal(signal.SIGINT, signal.default_int_handler)
    except RuntimeError:  # not the main thread
        pass
    if noted:
        ended.set()
    return ended


def _listening(address: str, port: int) -> socket.socket:
    """Return a listening socket; with the address ``::``, it also accepts IPv4."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    both = ipaddress.ip_address(address) == ipaddress.IPv6Address("::")
    return socket.create_server(
        (address, port), family=family, dualstack_ipv6=both and socket.has_dualstack_ipv6()
    )


def _outward(address: str) -> str:
    """Return the address of this machine in its local network, without sending a packet.

    The result is an IPv6 address if `address` is one, else an IPv4 address.
    """
    six = ":" in address
    with socket.socket(socket.AF_INET6 if six else socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("2001:db8::1" if six else "192.0.2.1", 9))
            return probe.getsockname()[0]
        except OSError:
            return socket.gethostname()
