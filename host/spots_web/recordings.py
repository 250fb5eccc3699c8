"""Recordings that a browser starts, stops, lists, plays and compares, all in one folder."""

import re
import time
from concurrent.futures import Future, ThreadPoolExecutor
from datetime import datetime, timezone
from functools import partial
from pathlib import Path

import numpy as np

from spots.common.atomic import check_writable
from spots.errors import FileError, SpotsError, StateError, printable
from spots.link.board import Board
from spots.recording.arrays import RecordingBlocks
from spots.recording.recorder import Recorder
from spots.recording.replay import open_recording
from spots.terminal.view import Pace
from spots_device.reading import decode

from .request_queue import RequestQueue
from .state import PageState

# The words of requests, each with the number of file names that follow it.
_WORDS = {"start": 0, "stop": 0, "mark": 0, "live": 0, "play": 1, "list": 0, "compare": 2}
_SHOWN_PER_S = 2
_LISTED = 100  # newest recordings
_READ_MAX = 200_000  # most readings that are read of a recording to compare
_POINTS = 1500  # most points of the recording's curve


class Recordings(RequestQueue):
    """Starts, stops, lists, plays and compares recordings, as browsers request.

    The name of each file consists of date and board id. The part ``recording`` of the state is set.
    FileError if the folder does not exist, or no file can be written into it.
    """

    what = "a recording"
    nobody = "there is no board to record: plug one in"

    def __init__(self, folder: Path, state: PageState):
        if not folder.is_dir():
            raise FileError(f"there is no folder {folder} for recordings: make it first", folder)
        check_writable(folder / "new.spots")
        super().__init__()
        self._folder, self._state = folder, state
        self._recorder: Recorder | None = None
        self._pace = Pace(_SHOWN_PER_S)
        self._thread = ThreadPoolExecutor(1, "recordings")
        self._reading: Future | None = None
        self._put({"on": False, "file": None, "playing": None, "error": None})

    def decode(self, body: bytes) -> str:
        """Return the request of a browser: a word, then a line for each name of a recording."""
        word, *names = body.decode().split("\n")
        if _WORDS.get(word) != len(names):
            raise ValueError(
                f"the body must be one of {', '.join(_WORDS)}; then a line for each file name"
            )
        return body.decode()

    def submit(self, request: str) -> Future:
        """Queue a request; a separate thread answers ``list`` and ``compare``."""
        word, *names = request.split("\n")
        if word not in ("list", "compare"):
            return super().submit(request)
        answer: Future = Future()
        if self._reading and not self._reading.done():
            answer.set_exception(StateError("recordings are being read: wait a moment"))
            return answer
        answer.set_running_or_notify_cancel()  # the client cannot cancel it any more
        self._reading = answer
        self._thread.submit(self._answer, answer, getattr(self, f"_{word}"), *names)
        return answer

    def attend(self, board: Board) -> bool:
        """Handle all waiting requests, and show the progress of a recording.

        True if the reader must change to another recording, or back to the board.
        """
        changed = super().attend(board)
        if self._recorder and self._pace.due(time.monotonic()):
            self._show(board, self._recorder)
        if self.playing and board.ended:
            self._live(board)
            return True
        return changed

    def leave(self) -> None:
        """Handle the loss of the board, which also ends the recording; refuse waiting requests."""
        self._recorder = self.playing = None
        self._put({**self._shown, "on": False, "playing": None})
        super().leave()

    def _handle(self, board: Board, request: str) -> None:
        word, *names = request.split("\n")
        getattr(self, f"_{word}")(board, *names)  # `decode` has checked the word

    def _start(self, board: Board) -> None:
        if self._recorder:
            raise StateError(
                f"{self._recorder.paths[0].name} is being recorded already: stop that recording "
                "first"
            )
        date = datetime.now(timezone.utc).strftime("%Y%m%dT%H%M%SZ")
        board_id = re.sub(r"[^0-9A-Za-z]", "", str(board.info["id"]))
        self._recorder = Recorder(board, self._folder / f"{date}-{board_id}.spots")
        self._recorder.on_error = partial(self._ended, board, self._recorder)
        self._begun_s, self._lost, self._marks = board.now_s(), board.stats.lost, 0
        self._show(board, self._recorder)

    def _stop(self, board: Board) -> None:
        if not self._recorder:
            raise StateError("there is no recording to stop: start one first")
        recorder, error = self._recorder, None
        try:
            recorder.stop()
        except SpotsError as failure:
            error = failure
            raise
        finally:
            self._ended(board, recorder, error)

    def _ended(self, board: Board, recorder: Recorder, error: SpotsError | None) -> None:
        """Show the end of a recording, and why it ended if it was not stopped."""
        self._recorder = None
        self._show(board, recorder, error)

    def _mark(self, board: Board) -> None:
        if not self._recorder:
            raise StateError("there is no recording to mark: start one first")
        self._marks += 1
        self._recorder.mark(f"mark {self._marks}")
        self._show(board, self._recorder)

    def _play(self, board: Board, name: str) -> None:
        if self._recorder:
            raise StateError("a recording is being made: stop it before you play another one")
        path = self._file(name)
        open_recording(path).close()  # an error must not end the present view
        self.playing = path
        self._put({**self._shown, "playing": name})

    def _live(self, board: Board) -> None:
        self.playing = None
        self._put({**self._shown, "playing": None})

    def _files(self) -> dict[str, Path]:
        """Return the newest `_LISTED` recordings by printable name, newest first; without links."""
        found = [one for one in self._folder.glob("*.spots") if one.is_file()]
        found = [one for one in found if not one.is_symlink()]
        found.sort(key=lambda one: one.stat().st_mtime, reverse=True)
        return {printable(one.name): one for one in found[:_LISTED]}

    def _file(self, name: str) -> Path:
        if name not in (files := self._files()):
            raise FileError("the folder has no such recording: reload the list", self._folder)
        return files[name]

    def _list(self) -> dict:
        stats = {name: path.stat() for name, path in self._files().items()}
        files = [
            {"name": name, "bytes": one.st_size, "utc_s": one.st_mtime}
            for name, one in stats.items()
        ]
        return {"files": files}

    def _compare(self, *names: str) -> dict:
        return {"curves": [_curve(self._file(name)) for name in names]}

    def _show(self, board: Board, recorder: Recorder, error: SpotsError | None = None) -> None:
        self._put(
            {
                "on": recorder is self._recorder,
                "file": recorder.paths[0].name,
                "bytes": recorder.bytes,
                "seconds": board.now_s() - self._begun_s,
                "lost": board.stats.lost - self._lost,
                "marks": self._marks,
                "playing": None,
                "error": error and str(error),
            }
        )

    def _put(self, shown: dict) -> None:
        self._shown = shown
        self._state.put("recording", shown)


def _curve(path: Path) -> dict:
    """Return position and force over time, from the readings of strip 0 in a recording.

    ``points`` has at most `_POINTS` lists of time in s, position in um and force in mN; the latter
    two are None without a press. With ``cut``, the recording has more than `_READ_MAX` readings.
    """
    parts, count = [], 0
    for block in RecordingBlocks(path):
        touches = block.touches[block.touches["sensor"] == 0]
        parts.append(touches[["arrived_s", "flags", "known", "position_um", "force_mN"]])
        count += len(touches)
        if count > _READ_MAX:
            break
    rows = np.concatenate(parts) if parts else np.empty(0)
    points = []
    for arrived_s, flags, known, position_um, force_mN in rows[
        :: max(-(-len(rows) // _POINTS), 1)
    ].tolist():
        pressed = flags & decode.TOUCHING and known
        values = [position_um, force_mN] if pressed else [None, None]
        points.append([round(arrived_s - float(rows["arrived_s"][0]), 3), *values])
    return {"name": printable(path.name), "points": points, "cut": count > _READ_MAX}
