"""``spots publish``: publishes the frames of a board on a network."""

import argparse
import re
import secrets
import sys
import time
from collections.abc import Callable
from dataclasses import asdict

from spots.common.signals import released_by_signals
from spots.errors import CommandError, SpotsError
from spots.link.board import Board
from spots.link.connect import open_named
from spots.link.frames import Frame, whole
from spots.terminal.view import Pace

from .answers import Answers
from .optional import zenoh
from .samples import encode, sample
from .zenoh_session import key, open_session

FRAMES_ENCODING = "application/octet-stream;spots-frames"
_JSON = zenoh.Encoding.APPLICATION_JSON
_TURN_S = 0.05  # longest delay of a query while no frames arrive
_HEALTH_PER_S = 1  # messages with link statistics per second


class Publisher:
    """Publishes the frames of a board over Zenoh, and answers remote queries.

    A query asks for the reply to one of the commands ``hello``, ``get`` and ``sync``.

    Parameters
    ----------
    board : Board
        The board. No other code of the program may read its frames.
    session : zenoh.Session
        An open session.

    Attributes
    ----------
    board_id : str
        Id under which the board is published.

    Raises
    ------
    SpotsError
        If the board is read-only, has no valid id, or is already published.
    """

    def __init__(self, board: Board, session: zenoh.Session):
        if board.read_only:
            raise SpotsError(
                f"cannot publish {board.port}, which is a recording or a remote board: give the "
                "port of a connected board"
            )
        self._board, self._session = board, session
        self.board_id = board.info["id"]
        if not re.fullmatch("[0-9A-Za-z_-]+", self.board_id or ""):
            raise SpotsError(
                f"cannot publish the board on {board.port}: it has no valid id; flash its firmware "
                "again"
            )
        if any(reply.ok for reply in session.liveliness().get(key(self.board_id, "alive"))):
            raise SpotsError(
                f"the board {self.board_id} is already published: stop the other publisher"
            )
        self._copy = b""  # bytes that have arrived and are not published yet
        board.tap(self._keep)
        self._run = secrets.token_hex(4)
        self._outlets: dict[str, Callable] = {}
        self._frames = self._outlet("frames", encoding=FRAMES_ENCODING)
        self._health = self._outlet("link", encoding=_JSON)
        self._health_pace = Pace(_HEALTH_PER_S)
        self._answers = Answers(board, self.board_id, session)
        try:
            board.stream("contact", "touch", "spectrum")
        except CommandError:  # a firmware without contacts
            board.stream("touch", "spectrum")
        # The token announces the board. It comes last, because readers then query and subscribe.
        self._token = session.liveliness().declare_token(key(self.board_id, "alive"))

    def run(self, seconds: float | None = None) -> None:
        """Publish frames for `seconds`, or without limit; raise SpotsError if the board is lost."""
        now_s = self._board.now_s
        end_s = None if seconds is None else now_s() + seconds
        while end_s is None or now_s() < end_s:
            for frame in self._board.frames(_TURN_S):
                self._publish(frame)
                self._answers.give()
            self._send()
            self._answers.give()
            self._publish_health()

    def close(self) -> None:
        """Stop publishing the board."""
        self._token.undeclare()
        self._answers.close()
        for outlet in self._outlets.values():
            outlet.undeclare()

    def _keep(self, data: bytes, now_s: float) -> None:
        self._copy += data

    def _publish(self, frame: Frame) -> None:
        self._send()
        utc_s = time.time() - self._board.now_s() + frame.time_s
        kind = type(frame).__name__.lower()
        self._outlet(frame.sensor, kind, encoding=_JSON).put(encode(sample(frame, utc_s)))
        self._publish_health()

    def _send(self) -> None:
        # The `Board` has already decoded these bytes, so it has counted a restart before them.
        size = whole(self._copy)
        data, self._copy = self._copy[:size], self._copy[size:]
        if data:
            # Bytes: while zenoh-python converts a str, it swallows the exception of a Ctrl-C.
            run = f"{self._run}.{self._board.stats.restarts}".encode()
            self._frames.put(data, attachment=run)

    def _outlet(self, *name: str | int, encoding) -> zenoh.Publisher:
        outlet = self._outlets.get(name)
        if outlet is None:
            outlet = self._outlets[name] = self._session.declare_publisher(
                key(self.board_id, *name),
                encoding=encoding,
                congestion_control=zenoh.CongestionControl.DROP,
            )
        return outlet

    def _publish_health(self) -> None:
        if self._health_pace.due(self._board.now_s()):
            self._health.put(encode({"utc_s": time.time(), **asdict(self._board.stats)}))


def publish_command(options: argparse.Namespace) -> None:
    """Run ``spots publish`` with the options that `cli` parsed."""
    with released_by_signals(), open_session() as session, open_named(options) as board:
        publisher = Publisher(board, session)
        try:
            print(f"published as spots/{publisher.board_id} (Ctrl-C ends it)", flush=True)
            publisher.run(options.seconds)
        except KeyboardInterrupt:
            pass
        finally:
            publisher.close()
            stats = board.stats
            print(f"{stats.frames} frames, lost {stats.lost}, bad {stats.bad_crc}", file=sys.stderr)
