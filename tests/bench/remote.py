"""Measures processor time, latency and loss between boards and readers in other processes.

``PYTHONPATH=tests .venv/bin/python -m bench.remote`` compares three ways to send readings.
``frames``: frames over Zenoh, as ``spots.open("zenoh:…")`` reads them. ``samples``: messages of
ROS 2. ``tcp``: lines of JSON over one TCP connection for each board and reader. Readers
count all lost frames.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import selectors
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import msgspec
from msgspec.json import encode

from spots.common.guarded import Guarded
from spots.link.board import Board
from spots.link.decoder import Decoder
from spots.link.frames import Reading, Touch
from spots_net.outlet import Outlet
from spots_net.publishing import publish, stream
from spots_net.sending import values

from .standin import CLOSING_UM, StandIn

MODES = ("frames", "samples", "tcp")
_TURN_S = 0.1
_DEADLINE_S = 60.0


def measure(
    boards: int = 20,
    publishers: int = 4,
    readers: int = 3,
    rate_Hz: float = 100.0,
    seconds: float = 3.0,
    rounds: int = 3,
) -> dict:
    """Let each reader read all boards, in the three ways one after the other.

    Parameters
    ----------
    boards, publishers, readers : int
        Number of boards, of processes that publish boards, and of processes that read them.
    rate_Hz : float
        Readings per second of a board; a reading has two frames.
    seconds : float
        Duration of each way in each round.
    rounds : int
        Number of rounds.

    Returns
    -------
    dict
        For each way: numbers of frames ``sent``, ``received`` and ``lost``, for all readers
        together. Medians over the rounds: ``latency_ms_p50`` and ``latency_ms_p99`` (median and
        99th percentile) from board to decoded touch; processor times ``publisher_us`` and
        ``reader_us`` per frame and reader. Also: ratios of these values to those of TCP.
    """
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory()))
        configs = _configs(folder, readers)
        names = [f"board{i}" for i in range(boards)]
        share = -(-boards // publishers)
        reading = [stack.enter_context(_Process(_read, str(config))) for config in configs[1:]]
        publishing = [
            stack.enter_context(_Process(_publish, str(configs[0]), names[i : i + share], rate_Hz))
            for i in range(0, boards, share)
        ]
        found = [
            {mode: _phase(mode, names, publishing, reading, seconds) for mode in MODES}
            for _ in range(rounds)
        ]
    figures = {mode: _summary([one[mode] for one in found]) for mode in MODES}
    return {
        "boards": boards,
        "publishers": len(publishing),
        "readers": readers,
        "frames_per_s": 2 * rate_Hz * boards,
        **figures,
        **{f"{mode}_to_tcp": _ratios(figures[mode], figures["tcp"]) for mode in MODES[:2]},
    }


def _phase(mode: str, names: list[str], publishing: list, reading: list, seconds: float) -> dict:
    ports: dict[str, int] = {}
    for publisher in publishing:
        publisher.say(mode)
    for publisher in publishing:
        ports |= publisher.hear()
    for reader in reading:
        reader.say((mode, names, ports))
    for reader in reading:
        reader.hear()  # the reader has seen every board
    for process in publishing + reading:
        process.say("go")
    time.sleep(seconds)
    for publisher in publishing:
        publisher.say("close")
    accounts = [reader.hear() for reader in reading]
    for publisher in publishing:
        publisher.say("end")
    spent_s, closed_at = 0.0, {}
    for publisher in publishing:
        cpu_s, closed = publisher.hear()
        spent_s += cpu_s
        closed_at |= closed
    return _account(accounts, closed_at, spent_s)


def _account(accounts: list, closed_at: dict[str, int], publishers_s: float) -> dict:
    sent = received = lost = 0
    latencies_us: list[int] = []
    for _, ledgers in accounts:
        for name, (first, end, came, gaps, late_us) in ledgers.items():
            unclosed = end - closed_at[name]  # closing frames that were lost before one arrived
            sent += closed_at[name] - first
            received += came
            lost += gaps - unclosed
            latencies_us += late_us
    latencies_us.sort()
    frames = sent / len(accounts)
    return {
        "sent": sent,
        "received": received,
        "lost": lost,
        "latency_ms_p50": latencies_us[len(latencies_us) // 2] / 1000,
        "latency_ms_p99": latencies_us[len(latencies_us) * 99 // 100] / 1000,
        "publisher_us": 1e6 * publishers_s / frames / len(accounts),
        "reader_us": 1e6 * sum(cpu_s for cpu_s, _ in accounts) / received,
    }


def _summary(rounds: list[dict]) -> dict:
    counts = {name: sum(one[name] for one in rounds) for name in ("sent", "received", "lost")}
    if counts["received"] + counts["lost"] != counts["sent"]:
        raise AssertionError(f"frames are not accounted for: {counts}")
    return counts | {name: round(median(one[name] for one in rounds), 3) for name in _MEASURED}


_MEASURED = ("latency_ms_p50", "latency_ms_p99", "publisher_us", "reader_us")


def _ratios(figures: dict, peer: dict) -> dict:
    return {name: round(figures[name] / peer[name], 2) for name in _MEASURED}


def _configs(folder: Path, readers: int) -> list[Path]:
    # Publishers connect to readers on loopback: no multicast, invisible to other computers.
    with ExitStack() as stack:
        sockets = [stack.enter_context(_listening()) for _ in range(readers)]
        places = [f"tcp/127.0.0.1:{one.getsockname()[1]}" for one in sockets]
    ends = [{"connect": {"endpoints": places}, "listen": {"endpoints": []}}]
    ends += [{"listen": {"endpoints": [place]}} for place in places]
    paths = []
    for i, end in enumerate(ends):
        paths.append(folder / f"{i}.json5")
        paths[-1].write_text(json.dumps({"scouting": {"multicast": {"enabled": False}}, **end}))
    return paths


def _listening() -> socket.socket:
    return socket.create_server(("127.0.0.1", 0))


class _Process:
    """A child process that receives requests over a pipe and answers them."""

    def __init__(self, target: Callable, *arguments):
        context = multiprocessing.get_context("spawn")
        self._ours, theirs = context.Pipe()
        self._process = context.Process(target=target, args=(theirs, *arguments), daemon=True)

    def __enter__(self) -> _Process:
        self._process.start()
        return self

    def __exit__(self, *exception) -> None:
        self._process.kill()
        self._process.join()

    def say(self, what) -> None:
        self._ours.send(what)

    def hear(self):
        if not self._ours.poll(_DEADLINE_S):
            raise AssertionError(f"{self._process.name} does not answer")
        return self._ours.recv()


def _publish(pipe, config: str, names: list[str], rate_Hz: float) -> None:
    from spots_net.zenoh_session import CONFIG_VARIABLE, open_session

    os.environ[CONFIG_VARIABLE] = config

    session = open_session()
    while True:
        mode = pipe.recv()
        links = [StandIn(name, rate_Hz) for name in names]
        boards = [Board(link) for link in links]
        outlets = [_outlet(mode, board, session) for board in boards]
        ended = threading.Event()
        threads = [serving(*pair, ended) for pair in zip(boards, outlets)]
        for thread in threads:
            thread.start()
        pipe.send({name: one.port for name, one in zip(names, outlets) if mode == "tcp"})
        pipe.recv()
        began_s = time.process_time()
        for link in links:
            link.fast = True
        pipe.recv()
        cpu_s = time.process_time() - began_s
        for link in links:
            link.closing, link.fast = True, False
        pipe.recv()
        ended.set()
        for thread in threads:
            thread.join()
        pipe.send((cpu_s, {name: link.closed_at for name, link in zip(names, links)}))


def _outlet(mode: str, board: Board, session):
    from spots_net.publish import Publisher

    return _TcpPublisher() if mode == "tcp" else Publisher(board, session=session)


def serving(board: Board, outlet: Outlet, ended: threading.Event) -> threading.Thread:
    """Return a thread that publishes a board's frames until the event `ended` is set."""
    run = Guarded(publish, "publishing")
    stream(board)

    def serve() -> None:
        while not ended.is_set():
            run(board, [outlet], _TURN_S)
        outlet.close()

    return threading.Thread(target=Guarded(serve, "the end of publishing"))


class _TcpPublisher:
    """Sends each frame as a line of JSON to all TCP clients."""

    place = "TCP"

    def __init__(self):
        self._server = _listening()
        self._server.setblocking(False)
        self._readers: list[socket.socket] = []
        self.port = self._server.getsockname()[1]

    def put(self, frame: Reading, utc_s: float) -> None:
        line = encode({"utc_s": utc_s, **values(frame)}) + b"\n"
        for reader in list(self._readers):
            try:
                reader.sendall(line)
            except OSError:  # the reader has closed the connection
                self._readers.remove(reader)
                reader.close()

    def turn(self) -> None:
        try:
            reader, _ = self._server.accept()
            reader.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._readers.append(reader)
        except BlockingIOError:
            pass

    def close(self) -> None:
        for one in (self._server, *self._readers):
            one.close()


class _Ledger:
    """Counts the frames that a reader received from one board, up to the board's last frame."""

    def __init__(self):
        self.first: int | None = None
        self.end: int | None = None
        self.received = self.lost = 0
        self.late_us: list[int] = []
        self._next = 0

    def take(self, sequence: int, t_us: int, position_um: int | None) -> None:
        if self.end is not None:
            return
        if self.first is None:
            self.first = self._next = sequence
        self.lost += sequence - self._next
        self._next = sequence + 1
        if position_um == CLOSING_UM:
            self.end = sequence
            return
        self.received += 1
        if position_um is not None:
            self.late_us.append(time.monotonic_ns() // 1000 - t_us & 0xFFFFFFFF)

    def account(self) -> tuple:
        return self.first, self.end, self.received, self.lost, self.late_us


def _read(pipe, config: str) -> None:
    from spots_net.zenoh_session import CONFIG_VARIABLE, open_session

    os.environ[CONFIG_VARIABLE] = config

    session = open_session()
    while True:
        mode, names, ports = pipe.recv()
        ledgers = {name: _Ledger() for name in names}
        pieces = _tcp(ports) if mode == "tcp" else _zenoh(session, mode)
        began_s = None
        parse = {name: _parser(mode) for name in names}
        for name, data in pieces:
            for reading in parse[name](data):
                ledgers[name].take(*reading)
            if began_s is None and all(one.first is not None for one in ledgers.values()):
                pipe.send(None)
                pipe.recv()
                began_s = time.process_time()
                for one in ledgers.values():
                    one.late_us.clear()
            if all(one.end is not None for one in ledgers.values()):
                break
        cpu_s = time.process_time() - began_s
        pieces.close()
        pipe.send((cpu_s, {name: one.account() for name, one in ledgers.items()}))


def _zenoh(session, mode: str) -> Iterator[tuple[str, tuple[str, bytes]]]:
    from spots_net.mailbox import Mailbox
    from spots_net.ros2.naming import short_name
    from spots_net.zenoh_session import direct

    mail = Mailbox()

    def receive(sample) -> None:
        _, node, *_, kind, _ = str(sample.key_expr).split("/")
        mail.put((short_name(node), kind), bytes(sample.payload))

    # Readings and spectra are all frames of a substitute board.
    wanted = ["frames"] if mode == "frames" else ["strip0/reading", "strip0/spectrum"]
    with ExitStack() as stack:
        for name in wanted:
            expression = f"0/*/{name}/*/*"
            stack.enter_context(session.declare_subscriber(expression, direct(receive)))
        while True:
            with mail.changed:
                mail.changed.wait_for(lambda: mail)
            while mail:
                (name, kind), data = mail.take()
                yield name, (kind, data)


def _tcp(ports: dict[str, int]) -> Iterator[tuple[str, bytes]]:
    with selectors.DefaultSelector() as selector, ExitStack() as stack:
        for name, port in ports.items():
            one = stack.enter_context(socket.create_connection(("127.0.0.1", port)))
            selector.register(one, selectors.EVENT_READ, name)
        while True:
            for ready, _ in selector.select():
                yield ready.data, ready.fileobj.recv(65536)


def _parser(mode: str) -> Callable[..., Iterator[tuple]]:
    return {"frames": _frames, "samples": _messages, "tcp": _lines}[mode]()


def _frames() -> Callable[[tuple[str, bytes]], Iterator[tuple]]:
    from spots_net.ros2.types import FRAME, store

    decoder = Decoder()

    def parse(message: tuple[str, bytes]) -> Iterator[tuple]:
        data = store().deserialize_cdr(message[1], FRAME).data.tobytes()
        for one in decoder.feed(data):
            yield one.sequence, one.t_us, one.position_um if isinstance(one, Touch) else None

    return parse


def _messages() -> Callable[[tuple[str, bytes]], Iterator[tuple]]:
    from spots_net.ros2.naming import dds
    from spots_net.ros2.types import own, store

    kinds = {dds(own(name)): own(name) for name in ("Reading", "Spectrum")}

    def parse(message: tuple[str, bytes]) -> Iterator[tuple]:
        kind, data = message
        one = store().deserialize_cdr(data, kinds[kind])
        place = getattr(one, "position_m", None)
        yield one.sequence, one.t_us, None if place is None else round(1e6 * place)

    return parse


def _lines() -> Callable[[bytes], Iterator[tuple]]:
    decode = msgspec.json.Decoder(dict).decode
    rest = b""

    def parse(data: bytes) -> Iterator[tuple]:
        nonlocal rest
        *whole, rest = (rest + data).split(b"\n")
        for one in map(decode, whole):
            yield one["sequence"], one["t_us"], one.get("position_um")

    return parse


if __name__ == "__main__":
    print(json.dumps(measure(), indent=2))
