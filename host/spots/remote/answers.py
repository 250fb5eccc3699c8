"""The publisher's replies to remote queries, rate-limited so that readings are not delayed."""

from __future__ import annotations

from collections import deque
from functools import partial

import zenoh

from ..errors import SpotsError
from ..link.board import Board
from .samples import encode
from .zenoh_session import READ_ONLY, direct, key

# The board is asked, and answers go out, no more often than this: readings come first.
_EVERY_S = 0.05
# Answering takes at most one part in so many of the time, so that readings come first. Where the
# board replies, the pause is bounded: a client that reconnects to a slow machine needs an answer.
_READINGS_SHARE = 10
_PAUSE_MAX_S = 1.0
_REPLY_S = 0.5
# A reply is given again for so long. That to `sync` is the time, and is new each time.
_FRESH_S = {"hello": 1.0, "get": 1.0, "sync": 0.0}
_WAITING = 256  # questions of a kind; the oldest are dropped
_PARAMETERS_MAX = 256  # characters; this program sends none


class Answers:
    """Questions that wait, and the board's replies to them.

    All who wait with the same question get the same reply. The board was asked after they asked,
    or less than a second before.

    Parameters
    ----------
    board : Board
    board_id : str
    session : zenoh.Session
    """

    def __init__(self, board: Board, board_id: str, session: zenoh.Session):
        self._board = board
        self._due_s = 0.0
        self._waiting: dict[str, deque] = {}
        self._replies: dict[str, tuple[float, int, dict]] = {}
        self._queryables = {}
        for command, name in READ_ONLY.items():
            self._waiting[command] = deque(maxlen=_WAITING)
            note = direct(partial(self._note, command))
            self._queryables[command] = session.declare_queryable(key(board_id, name), note)

    def give(self) -> None:
        """Answer what waits, if it is time; at most one question to the board of each kind."""
        if self._board.now_s() < self._due_s or not any(self._waiting.values()):
            return
        began_s = self._board.now_s()
        is_silent = False
        for command, waiting in self._waiting.items():
            asked = [waiting.popleft() for _ in range(len(waiting))]
            if asked:
                is_silent |= not self._give(command, asked)
        now_s = self._board.now_s()
        pause_s = max(_EVERY_S, _READINGS_SHARE * (now_s - began_s))
        self._due_s = now_s + (pause_s if is_silent else min(pause_s, _PAUSE_MAX_S))

    def close(self) -> None:
        """Stop taking queries."""
        for queryable in self._queryables.values():
            queryable.undeclare()

    def _note(self, command: str, query: zenoh.Query) -> None:
        # What is longer than a question of this program is dropped, and so takes no memory.
        plain = query.payload is None and query.attachment is None
        if plain and len(str(query.parameters)) <= _PARAMETERS_MAX:
            self._waiting[command].append(query)

    def _give(self, command: str, asked: list[zenoh.Query]) -> bool:
        """Answer all who asked the same; return whether the board replied."""
        place = self._queryables[command].key_expr
        try:
            reply, error = encode(self._reply(command)), None
        except SpotsError as refusal:
            reply, error = None, str(refusal)
        for query in asked:
            with query:
                try:
                    if error is None:
                        query.reply(place, reply, encoding=zenoh.Encoding.APPLICATION_JSON)
                    else:
                        query.reply_err(error)
                except zenoh.ZError:
                    pass  # the querier has disconnected, or takes no such reply
        return error is None

    def _reply(self, command: str) -> dict:
        fresh_s, restarts, reply = self._replies.get(command, (0.0, -1, {}))
        if self._board.now_s() >= fresh_s or restarts != self._board.stats.restarts:
            reply = self._board.command(command, _REPLY_S)
            fresh_s = self._board.now_s() + _FRESH_S[command]
            self._replies[command] = fresh_s, self._board.stats.restarts, reply
        return reply
