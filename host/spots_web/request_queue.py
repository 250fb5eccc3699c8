"""Passes requests of browsers to the thread that reads the board."""

import sys
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from pathlib import Path
from queue import Empty, Full, Queue
from typing import Any

import msgspec

from spots.common.guarded import sentence_of
from spots.errors import SpotsError, StateError
from spots.link.board import Board

_WAITING_MAX = 8  # number of waiting requests


class RequestQueue:
    """Queue of requests from browsers with the access token; a subclass handles them.

    A subclass has its own `attend`, or the method ``_handle(board, request)``, which returns the
    answer. While `stopping`, the thread that runs `attend` must end; `attend` then returns soon.
    `playing` is the recording that is read instead of the board. `sensor` is the strip to show in
    detail and to change. `strip_settings` has new values for arguments of `strip_feed.StripFeed`,
    by name.
    """

    what = "a request"  # for error messages
    nobody = "there is no board: plug one in"  # error message while no board is read
    request_max = 1024  # bytes
    requests: Any = None  # a union of structs
    _changes_board = False  # whether each request may change the settings of the board
    strip_settings: Mapping[str, Any] = {}
    playing: Path | None = None
    sensor = 0

    def __init__(self):
        self._asked: Queue[tuple[Any, Future]] = Queue(_WAITING_MAX)
        self._attended = self.stopping = False

    def decode(self, body: bytes) -> Any:
        """Return the request in the body of a message, or raise ValueError with the reason."""
        return msgspec.json.decode(body, type=self.requests)

    def attend(self, board: Board) -> bool:
        """Handle all waiting requests; the thread that reads the board calls this often.

        Returned is whether the board's settings, `sensor` or `playing` may have changed.
        """
        changed, before = False, (self.sensor, self.playing)
        while asked := self._next():
            request, answer = asked
            self._answer(answer, self._handle, board, request)
            changed = self._changes_board
        return changed or (self.sensor, self.playing) != before

    def enter(self) -> None:
        """Queue requests from now on: a thread reads a board, and will call `attend`."""
        self._attended = True

    def leave(self) -> None:
        """Handle the loss of the board: refuse all waiting requests."""
        self._attended = False
        self._refuse()

    def submit(self, request: Any) -> Future:
        """Queue a request, from any thread.

        The future has the answer: a dict, or None for a request without an answer. If the request
        is refused, it has a SpotsError as its exception.
        """
        answer: Future = Future()
        try:
            self._asked.put_nowait((request, answer))
        except Full:
            answer.set_exception(StateError("the board is busy: wait a moment, and try again"))
        if not self._attended:
            self._refuse()
        return answer

    def _next(self) -> tuple[Any, Future] | None:
        """Return the next request whose client still waits, and its future; None if no request."""
        while True:
            try:
                asked = self._asked.get_nowait()
            except Empty:
                return None
            if asked[1].set_running_or_notify_cancel():  # False after a timeout of the client
                return asked

    def _answer(self, answer: Future, handle: Callable, *arguments: Any) -> None:
        """Call `handle` with `arguments`; set the result or the error of this call in `answer`."""
        try:
            answer.set_result(handle(*arguments))
        except SpotsError as error:
            answer.set_exception(error)
        except Exception as error:
            # The client gets an answer without a timeout, and the thread continues.
            sentence = sentence_of(self.what, error)
            print(f"spots: {sentence}", file=sys.stderr, flush=True)
            answer.set_exception(StateError(sentence))

    def _refuse(self) -> None:
        while asked := self._next():
            asked[1].set_exception(StateError(self.nobody))
