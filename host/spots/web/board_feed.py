"""The thread that reads a board, and reconnects when it was unplugged."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from statistics import median

from spots_device.smux import CHANNELS

from ..errors import RefusedError, SpotsError
from ..guarded import Guarded
from ..keyboard.layout import KeyLayout
from ..link.board import Board
from ..link.connect import find, open
from ..link.frames import Key, Spectrum, Touch
from ..link.ports import scheme
from ..link.timeouts import CONNECTED, LOST, REFUSED, SEARCH_S, SEARCHING, STALLED
from ..recording.replay import Replay
from .expected import expected_shown
from .feel import Feel, layout_shown
from .recordings import Recordings
from .state import PageState

_TICK_S = 0.02
_SEARCH_EVERY_S = 1.0
_HEALTH_EVERY_S = 0.5
_RATE_OVER = 4  # times the link is looked at
_WHY = {
    STALLED: "no readings come",
    LOST: "the board was disconnected",
    REFUSED: "another board is in its place",
}
# What keeps the strip from being felt, and the next step.
_NEXT = {
    SEARCHING: "there is no board; next: plug one in, or name its port with --port",
    STALLED: "the board sends no readings; next: wait a moment, or press its reset button",
    LOST: "the board is lost; next: check its plug, and this page finds it again",
    REFUSED: "this is another board; next: plug the first one in, or restart 'spots serve'",
}
_UNCALIBRATED = (
    "the board is not calibrated, so no press has a place or a force; "
    "next: spots calibrate position"
)


class BoardReader:
    """Reads a board into a state until it is stopped.

    Parameters
    ----------
    open_board : callable
        Given the id of the board to find again, or None for any, returns it or raises SpotsError.
    layout : KeyLayout
    state : PageState
        ``board`` (what it is, and whether it is there), ``touch``, ``spectrum``, ``keys``,
        ``stick`` and ``link`` are put there.
    search_every_s : float
        How long to wait before a board is looked for again.
    on_touch : callable
        Given each reading of each sensor, by the thread that reads.
    recordings : Recordings, optional
        Of the board, for who asks for them.
    """

    def __init__(
        self,
        open_board: Callable[[str | None], Board],
        layout: KeyLayout,
        state: PageState,
        search_every_s: float = _SEARCH_EVERY_S,
        on_touch: Callable[[Touch], None] = lambda touch: None,
        recordings: Recordings | None = None,
    ):
        self._open_board, self._layout, self._state = open_board, layout, state
        self._search_every_s = search_every_s
        self._on_touch, self._recordings = on_touch, recordings
        self._stopping = threading.Event()
        self._id: str | None = None
        self._known: dict = {}
        self._said: tuple = ()
        self._board: Board | None = None  # the one that is read
        self._thread = threading.Thread(target=self._run, name="reader", daemon=True)

    def start(self) -> None:
        """Begin in a thread."""
        self._say(SEARCHING, "")
        self._thread.start()

    def stop(self, timeout_s: float = 5.0) -> None:
        """End the thread and close the board."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(timeout_s)

    def watch(self) -> None:
        """Report a silent board; called now and then by a thread that does not read."""
        board = self._board
        if board is not None and board.silent(SEARCH_S):
            self._say(LOST, "no readings come")

    def _run(self) -> None:
        attempt = Guarded(self._attempt, "the reader of a board", self._lost)
        while not self._stopping.is_set():
            if not attempt():
                self._stopping.wait(self._search_every_s)

    def _attempt(self) -> bool:
        """Read a board until it restarts; return False if it cannot be read."""
        try:
            with self._open_board(self._id) as board:
                self._read(board)
        except SpotsError as error:
            self._lost(str(error), refused=isinstance(error, RefusedError))
            return False
        return True

    def _lost(self, why: str, refused: bool = False) -> None:
        self._say(REFUSED if refused else LOST if self._id else SEARCHING, why)

    def _read(self, board: Board) -> None:
        board.command("stream touch spectrum")
        info = board.command("hello")
        self._id = info["id"]
        settings = _settings(board)
        self._known = {
            **{name: info.get(name) for name in _FACTS},
            "port": board.port,
            "full_scale": settings["full_scale"],
            "expected": expected_shown(board, info, settings["dark"]),
            "layout": layout_shown(self._layout) if info.get("length_um") else None,
        }
        self._board = board
        self._say(CONNECTED, "")
        board.when_state_changes(self._take_state)
        feel = Feel(board, info, self._layout, self._state)
        health = _Health(board, self._state)
        try:
            while not self._stopping.is_set():
                for frame in board.frames(_TICK_S):
                    self._take(frame, feel, health, board)
                    if self._stopping.is_set():
                        return
                if board.ended:
                    self._stopping.wait(_TICK_S)  # its frames do not wait
                feel.tick(board.now_s())
                health.show()
                if self._recordings:
                    self._recordings.attend(board)
                # A pause in a recording is as it was then; it goes on.
                paused = isinstance(board, Replay) and not board.ended
                if board.silent(SEARCH_S) and not paused:
                    raise SpotsError("no readings come")
                if board.stats.restarts:
                    return  # it has forgotten its settings, or is another one on the same port
        finally:
            self._board = None
            feel.release()
            if self._recordings:
                self._recordings.leave()

    def _take(self, frame, feel: Feel, health: _Health, board: Board) -> None:
        if isinstance(frame, Touch):
            self._on_touch(frame)
        if frame.sensor != 0:
            return
        if isinstance(frame, Touch):
            if self._said[0] != CONNECTED:
                feel.release()
                self._say(CONNECTED, "")
            now_s = board.now_s()
            feel.take(frame, now_s)
            health.took(now_s - frame.time_s)
        elif isinstance(frame, Spectrum):
            self._state.put("spectrum", {"counts": frame.counts})
        elif isinstance(frame, Key):
            feel.take_key(frame)

    def _take_state(self, state: str) -> None:
        if state != CONNECTED:  # that is shown with the first reading
            self._say(state, _WHY[state])

    def _say(self, state: str, message: str) -> None:
        said = state, message, self._known.get("port")
        if said != self._said:
            uncalibrated = self._known.get("layout", "") is None
            step = _NEXT.get(state, _UNCALIBRATED if uncalibrated else "")
            board = {"state": state, "message": message, "next": step, **self._known}
            self._state.put("board", board)
            self._said = said  # now: what could not be shown is shown with the next attempt


def _settings(board: Board) -> dict:
    unknown = {"full_scale": None, "dark": [0] * CHANNELS}
    try:
        return unknown | board.command("get")
    except SpotsError:
        return unknown  # a recording


_FACTS = (
    *("id", "board", "runtime", "firmware", "calibration", "length_um"),
    *("plan", "gain", "exposure_us", "led_mA", "led", "average", "strain_ppm"),
)


class _Health:
    """Rate, losses and latency of a link, twice a second."""

    def __init__(self, board: Board, state: PageState):
        self._board, self._state = board, state
        self._readings = 0
        self._latencies_s: deque[float] = deque(maxlen=256)
        self._marks: deque[tuple[float, int]] = deque(maxlen=_RATE_OVER + 1)
        self._due_s = 0.0

    def took(self, latency_s: float) -> None:
        """Count a reading."""
        self._readings += 1
        self._latencies_s.append(latency_s)
        self.show()

    def show(self) -> None:
        """Put the figures into the state if it is time."""
        now_s = time.monotonic()
        if now_s < self._due_s:
            return
        self._due_s = now_s + _HEALTH_EVERY_S
        self._marks.append((self._board.now_s(), self._readings))
        (then_s, before), (last_s, after) = self._marks[0], self._marks[-1]
        stats = self._board.stats
        link = {
            "rate_hz": (after - before) / (last_s - then_s) if last_s > then_s else None,
            "frames": stats.frames,
            "lost": stats.lost,
            "bad": stats.bad_crc,
            "latency_ms": 1000 * median(self._latencies_s) if self._latencies_s else None,
        }
        self._state.put("link", link)


def finder(
    port: str | None, sensor: str = "default", scenario: str = "demo", seed: int = 0
) -> Callable[[str | None], Board]:
    """Return a function that opens a board, as `BoardReader` takes it.

    Parameters
    ----------
    port : str or None
        As for `spots.open`; found if None.
    sensor, scenario : str
        Files of the virtual board, by path or name.
    seed : int
        Of the virtual board's noise.

    Returns
    -------
    callable
        ``open_board(board_id)``: opens the board of that id, or any board for None.

    Raises
    ------
    SpotsError
        If a file of the virtual board is wrong, which waiting does not mend.
    """
    module, rest = scheme(port)
    simulated = {"sensor": sensor, "scenario": scenario, "seed": seed}
    if hasattr(module, "check"):
        module.check(rest, **simulated)

    def open_board(board_id: str | None) -> Board:
        found = []
        if port is not None or board_id is None:
            try:
                found = [open(port, **simulated)]
            except SpotsError:
                if board_id is None or module is not None:
                    raise
        refusal = RefusedError if found else SpotsError
        if board_id not in (None, *(one.info["id"] for one in found)):
            found += find()[0]  # its port may have another name now
        wanted = [one for one in found if board_id in (None, one.info["id"])][:1]
        for one in found:
            if one not in wanted:
                one.close()
        if not wanted:
            raise refusal(f"waiting for board {board_id}: plug it in again")
        return wanted[0]

    return open_board
