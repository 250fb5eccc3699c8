"""Publishes the frames of a board over Zenoh, for SPOTS itself and as JSON."""

import contextlib
import re
import secrets
import time
from collections.abc import Callable
from dataclasses import asdict

from msgspec.json import encode  # NaN becomes null

from spots.errors import BoardError, PortError
from spots.link.board import Board
from spots.link.frames import Reading, whole
from spots.terminal.view import Pace

from .answers import Answers
from .optional import zenoh
from .outlet import kind_of, values
from .zenoh_session import key, open_session

FRAMES_ENCODING = "application/octet-stream;spots-frames"
_JSON = zenoh.Encoding.APPLICATION_JSON
_HEALTH_PER_S = 1  # messages with link statistics per second


class Publisher:
    """Publishes the frames of a board over Zenoh, and answers remote queries.

    A query asks for the reply to one of the commands ``hello``, ``get`` and ``sync``.

    Parameters
    ----------
    board : Board
        The board. No other code of the program may read its frames.
    session : zenoh.Session, optional
        An open session; if not given, a session of its own.

    Attributes
    ----------
    board_id : str
        Id under which the board is published.
    place : str
        Key under which everything is published.

    Raises
    ------
    BoardError, PortError
        If the board is read-only, has no valid id, or is already published.
    """

    def __init__(self, board: Board, session: zenoh.Session | None = None):
        if board.read_only:
            raise PortError(
                f"cannot publish {board.port}, which is a recording or a remote board: give the "
                "port of a connected board"
            )
        self._board = board
        self.board_id = board.info["id"]
        if not re.fullmatch("[0-9A-Za-z_-]+", self.board_id or ""):
            raise BoardError(
                f"cannot publish the board on {board.port}: it has no valid id; flash its firmware "
                "again",
                "no_id",
            )
        self.place = f"spots/{self.board_id}"
        with contextlib.ExitStack() as own:  # ends the session if the board cannot be published
            if session is None:
                session = own.enter_context(open_session())
            if any(reply.ok for reply in session.liveliness().get(key(self.board_id, "alive"))):
                raise PortError(
                    f"the board {self.board_id} is already published: stop the other publisher"
                )
            self._own = own.pop_all()
        self._session = session
        self._copy = b""  # bytes that have arrived and are not published yet
        board.tap(self._keep)
        self._run = secrets.token_hex(4)
        self._outlets: dict[str, Callable] = {}
        self._frames = self._outlet("frames", encoding=FRAMES_ENCODING)
        self._health = self._outlet("link", encoding=_JSON)
        self._health_pace = Pace(_HEALTH_PER_S)
        self._answers = Answers(board, self.board_id, session)
        # The token announces the board. It comes last, because readers then query and subscribe.
        self._token = session.liveliness().declare_token(key(self.board_id, "alive"))

    def put(self, frame: Reading, utc_s: float) -> None:
        """Publish the bytes that have arrived, and a frame as JSON."""
        self._send()
        outlet = self._outlet(frame.sensor, kind_of(frame), encoding=_JSON)
        outlet.put(encode({"utc_s": utc_s, **values(frame)}))

    def turn(self) -> None:
        """Publish the bytes that are left, answer queries, and publish the link's counters."""
        self._send()
        self._answers.give()
        if self._health_pace.due(self._board.now_s()):
            self._health.put(encode({"utc_s": time.time(), **asdict(self._board.stats)}))

    def close(self) -> None:
        """Stop publishing the board."""
        self._token.undeclare()
        self._answers.close()
        for outlet in self._outlets.values():
            outlet.undeclare()
        self._own.close()

    def _keep(self, data: bytes, now_s: float) -> None:
        self._copy += data

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
