"""The publisher's replies to remote queries, limited in rate so that readings are not delayed."""

import time
from collections import deque
from functools import partial

from msgspec.json import encode

from spots.errors import SpotsError
from spots.link.board import Board

from .optional import zenoh
from .ros2.naming import Attachment, service_name, unpacked
from .ros2.types import EMPTY, REPLY, packed, service, store
from .ros_node import RosNode
from .zenoh_session import READ_ONLY

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
_PARAMETERS_MAX = 256  # characters; neither SPOTS nor ROS sends any
_REQUEST_BYTES_MAX = 64  # an empty message, perhaps padded


class Answers:
    """The services ``/NODE/hello``, ``/NODE/get`` and ``/NODE/sync``, of the type std_srvs/Trigger.

    A response has ``success``, and as ``message`` a JSON object: the board's reply, or ``error``
    with a sentence, and ``why`` with its code if it has one. All waiting queries for the same
    command get the same reply, which is at most a second old. The services end with the node.
    """

    def __init__(self, board: Board, name: str, node: RosNode):
        self._board = board
        self._due_s = 0.0
        self._waiting: dict[str, deque] = {}
        self._replies: dict[str, tuple[float, int, dict]] = {}
        for command in READ_ONLY:
            self._waiting[command] = deque(maxlen=_WAITING)
            node.service(service(service_name(name, command)), partial(self._note, command))

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

    def _note(self, command: str, query: zenoh.Query) -> None:
        # Queries that no client of ROS sends are dropped, so they need no memory.
        size = 0 if query.payload is None else len(query.payload)
        request = unpacked(query.attachment)
        expected = len(EMPTY) <= size <= _REQUEST_BYTES_MAX and request is not None
        if expected and len(str(query.parameters)) <= _PARAMETERS_MAX:
            self._waiting[command].append((query, request))

    def _give(self, command: str, asked: list[tuple[zenoh.Query, Attachment]]) -> bool:
        """Answer the queries `asked` for `command`; return False if the reply is an error."""
        try:
            success, content = True, self._reply(command)
        except SpotsError as refusal:
            success, content = False, {"re": command, "error": str(refusal)}
            if why := getattr(refusal, "why", ""):
                content["why"] = why
        reply = packed(store().types[REPLY](success, encode(content).decode()))
        now_ns = time.time_ns()
        for query, request in asked:
            mark = request._replace(time_ns=now_ns).packed()
            with query:
                try:
                    # Not as an error of Zenoh, because a client of ROS would wait on.
                    query.reply(
                        query.key_expr,
                        reply,
                        encoding=zenoh.Encoding.APPLICATION_CDR,
                        attachment=mark,
                    )
                except zenoh.ZError:
                    pass  # the querier has disconnected, or accepts no such reply
        return success

    def _reply(self, command: str) -> dict:
        fresh_s, restarts, reply = self._replies.get(command, (0.0, -1, {}))
        if self._board.now_s() >= fresh_s or restarts != self._board.stats.restarts:
            reply = self._board.command(command, _REPLY_S)
            fresh_s = self._board.now_s() + _FRESH_S[command]
            self._replies[command] = fresh_s, self._board.stats.restarts, reply
        return reply
