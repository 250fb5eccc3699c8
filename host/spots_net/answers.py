"""The publisher's replies to remote queries, limited in rate so that readings are not delayed."""

from collections import deque
from functools import partial

from msgspec.json import encode

from spots.errors import SpotsError
from spots.link.board import Board

from .optional import zenoh
from .zenoh_session import READ_ONLY, direct, key

# Pause between two rounds of answers: at least `_EVERY_S`, and at least ten times the duration of
# the last round. While the board replies, the pause is at most `_PAUSE_MAX_S`, because a client
# that reconnects needs answers.
_EVERY_S = 0.05
_PAUSE_SHARE = 10
_PAUSE_MAX_S = 1.0
_REPLY_S = 0.5  # timeout of the board's reply
# A reply of the board also answers queries that arrive within this time in s. `sync` is always sent
# again, because its reply is the present time.
_FRESH_S = {"hello": 1.0, "get": 1.0, "sync": 0.0}
_WAITING = 256  # waiting queries of each kind; the oldest are dropped
_PARAMETERS_MAX = 256  # characters; SPOTS itself sends none


class Answers:
    """Collects queries from other machines, and answers them with the board's replies.

    All waiting queries for the same command get the same reply, which is at most a second old.

    Parameters
    ----------
    board : Board
        The published board.
    board_id : str
        Id of the board.
    session : zenoh.Session
        An open session.
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
        """Answer the waiting queries, if the rate limit permits.

        A command is sent to the board at most once for all waiting queries.
        """
        began_s = self._board.now_s()
        if began_s < self._due_s or not any(self._waiting.values()):
            return
        pause_max_s = _PAUSE_MAX_S
        for command, waiting in self._waiting.items():
            asked = [waiting.popleft() for _ in range(len(waiting))]
            if asked and not self._give(command, asked):
                pause_max_s = float("inf")
        now_s = self._board.now_s()
        self._due_s = now_s + min(pause_max_s, max(_EVERY_S, _PAUSE_SHARE * (now_s - began_s)))

    def close(self) -> None:
        """Stop accepting queries."""
        for queryable in self._queryables.values():
            queryable.undeclare()

    def _note(self, command: str, query: zenoh.Query) -> None:
        # A query from SPOTS has no content. Other queries are dropped, so they need no memory.
        plain = query.payload is None and query.attachment is None
        if plain and len(str(query.parameters)) <= _PARAMETERS_MAX:
            self._waiting[command].append(query)

    def _give(self, command: str, asked: list[zenoh.Query]) -> bool:
        """Answer the queries `asked` for `command`; return False if the reply is an error."""
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
                        query.reply_err(error.encode())  # bytes: see Publisher._send
                except zenoh.ZError:
                    pass  # the querier has disconnected, or accepts no such reply
        return error is None

    def _reply(self, command: str) -> dict:
        fresh_s, restarts, reply = self._replies.get(command, (0.0, -1, {}))
        if self._board.now_s() >= fresh_s or restarts != self._board.stats.restarts:
            reply = self._board.command(command, _REPLY_S)
            fresh_s = self._board.now_s() + _FRESH_S[command]
            self._replies[command] = fresh_s, self._board.stats.restarts, reply
        return reply
