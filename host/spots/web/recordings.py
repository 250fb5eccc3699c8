"""Recordings that a browser starts and stops; the thread that reads the board writes them."""

import re
import time
from datetime import datetime, timezone
from pathlib import Path

from ..errors import SpotsError
from ..link.board import Board
from ..recording.recorder import Recorder
from ..terminal.view import Pace
from .orders import Orders
from .state import PageState

START, STOP = "start", "stop"
_SHOWN_PER_S = 2


class Recordings(Orders):
    """Starts and stops recordings of a board on request, one at a time.

    Parameters
    ----------
    folder : Path
        Folder for the recordings; each file name consists of date and board id.
    state : PageState
        State that gets the part ``recording``.

    Raises
    ------
    SpotsError
        If the folder does not exist.
    """

    what = "a recording"

    def __init__(self, folder: Path, state: PageState):
        if not folder.is_dir():
            raise SpotsError(f"there is no folder {folder} for recordings: make it first")
        super().__init__("there is no board to record: plug one in")
        self._folder, self._state = folder, state
        self._recorder: Recorder | None = None
        self._pace = Pace(_SHOWN_PER_S)
        self._put({"on": False, "file": None})

    def decode(self, body: bytes) -> str:
        """Return the request in a browser's message: `START` or `STOP`."""
        if body not in (START.encode(), STOP.encode()):
            raise ValueError(f"the body must be '{START}' or '{STOP}'")
        return body.decode()

    def attend(self, board: Board) -> bool:
        """Handle all waiting requests, and show the progress of a recording."""
        self._attended = True
        while asked := self._next():
            word, answer = asked
            self._answer(answer, self._start if word == START else self._stop, board)
        if self._recorder and self._pace.due(time.monotonic()):
            self._show(board, on=True)
        return False

    def leave(self) -> None:
        """Handle the loss of the board, which also ends the recording; refuse waiting requests."""
        self._recorder = None
        self._put({**self._shown, "on": False})
        super().leave()

    def _start(self, board: Board) -> None:
        if self._recorder:
            raise SpotsError(
                f"{self._recorder.paths[0].name} is being recorded already: stop that recording "
                "first"
            )
        date = datetime.now(timezone.utc).strftime("%Y%m%dT%H%M%SZ")
        board_id = re.sub(r"[^0-9A-Za-z]", "", str(board.info["id"]))
        self._recorder = board.record(self._folder / f"{date}-{board_id}.spots")
        self._begun_s, self._lost = board.now_s(), board.stats.lost
        self._show(board, on=True)

    def _stop(self, board: Board) -> None:
        if not self._recorder:
            raise SpotsError("there is no recording to stop: start one first")
        try:
            self._recorder.stop()
            self._show(board, on=False)
        finally:
            self._recorder = None

    def _show(self, board: Board, on: bool) -> None:
        self._put(
            {
                "on": on,
                "file": self._recorder.paths[0].name,
                "bytes": self._recorder.bytes,
                "seconds": board.now_s() - self._begun_s,
                "lost": board.stats.lost - self._lost,
            }
        )

    def _put(self, shown: dict) -> None:
        self._shown = shown
        self._state.put("recording", shown)
