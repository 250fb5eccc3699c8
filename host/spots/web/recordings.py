"""Recordings that a page starts and stops: asked for by the web server, made by the reader."""

from __future__ import annotations

import re
import sys
import time
from concurrent.futures import Future
from datetime import datetime, timezone
from pathlib import Path
from queue import Empty, SimpleQueue

from ..errors import SpotsError
from ..guarded import sentence_of
from ..link.board import Board
from ..recording.recorder import Recorder
from .state import PageState

START, STOP = "start", "stop"
_SHOWN_EVERY_S = 0.5


class Recordings:
    """Recordings of one board after another, one at a time.

    Parameters
    ----------
    folder : Path
        Where their files are made; named by date and board.
    state : PageState
        ``recording`` is put there.

    Raises
    ------
    SpotsError
        If there is no such folder.
    """

    def __init__(self, folder: Path, state: PageState):
        if not folder.is_dir():
            raise SpotsError(f"there is no folder {folder} to record to: make it first")
        self._folder, self._state = folder, state
        self._asked: SimpleQueue[tuple[str, Future]] = SimpleQueue()
        self._attended = False
        self._recorder: Recorder | None = None
        self._shown: dict = {"on": False, "file": None}
        self._due_s = 0.0
        state.put("recording", self._shown)

    def ask(self, word: str) -> Future:
        """Ask for `START` or `STOP`, from any thread.

        Returns
        -------
        concurrent.futures.Future
            None when it is done, SpotsError if it cannot be.
        """
        answer: Future = Future()
        self._asked.put((word, answer))
        if not self._attended:
            self._refuse()
        return answer

    def attend(self, board: Board) -> None:
        """Do what was asked, and show progress; called often by the thread that reads the board."""
        self._attended = True
        while asked := self._next():
            word, answer = asked
            try:
                (self._start if word == START else self._stop)(board)
                answer.set_result(None)
            except SpotsError as error:
                answer.set_exception(error)
            except Exception as error:
                # Who asked gets an answer at once, and readings go on.
                sentence = sentence_of("a recording", error)
                print(f"spots: {sentence}", file=sys.stderr, flush=True)
                answer.set_exception(SpotsError(sentence))
        if self._recorder and time.monotonic() >= self._due_s:
            self._show(board, on=True)

    def leave(self) -> None:
        """Handle the end of reading from a board: its recording has ended, too."""
        self._attended = False
        self._recorder = None
        self._put({**self._shown, "on": False})
        self._refuse()

    def _start(self, board: Board) -> None:
        if self._recorder:
            raise SpotsError(f"{self._recorder.paths[0].name} is being recorded already")
        date = datetime.now(timezone.utc).strftime("%Y%m%dT%H%M%SZ")
        board_id = re.sub(r"[^0-9A-Za-z]", "", str(board.info["id"]))
        self._recorder = board.record(self._folder / f"{date}-{board_id}.spots")
        self._begun_s, self._lost = board.now_s(), board.stats.lost
        self._show(board, on=True)

    def _stop(self, board: Board) -> None:
        if not self._recorder:
            raise SpotsError("nothing is being recorded")
        try:
            self._recorder.stop()
            self._show(board, on=False)
        finally:
            self._recorder = None

    def _next(self) -> tuple[str, Future] | None:
        while True:
            try:
                asked = self._asked.get_nowait()
            except Empty:
                return None
            if asked[1].set_running_or_notify_cancel():  # who asked may have given up
                return asked

    def _refuse(self) -> None:
        while asked := self._next():
            asked[1].set_exception(SpotsError("there is no board to record"))

    def _show(self, board: Board, on: bool) -> None:
        self._due_s = time.monotonic() + _SHOWN_EVERY_S
        shown = {
            "on": on,
            "file": self._recorder.paths[0].name,
            "bytes": self._recorder.bytes,
            "seconds": board.now_s() - self._begun_s,
            "lost": board.stats.lost - self._lost,
        }
        self._put(shown)

    def _put(self, shown: dict) -> None:
        if shown != self._shown:
            self._shown = shown
            self._state.put("recording", shown)
