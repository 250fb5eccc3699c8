"""A thread that reads a board for the web UI, and reconnects if the board was unplugged."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from spots.advice.calibrated import start_fault
from spots.common.guarded import Guarded
from spots.errors import BoardError, PortError, RefusedError, SpotsError
from spots.keyboard.key_layout import KeyLayout
from spots.link.board import Board
from spots.link.frames import (
    Contact,
    Key,
    Spectrum,
    Touch,
)
from spots.link.timeouts import (
    CONNECTED,
    LOST,
    REFUSED,
    SEARCH_S,
    SEARCHING,
    STALLED,
    silent_s,
)
from spots.recording.replay import open_recording
from spots.terminal.view import Pace
from spots_device.sensor.smux import CHANNELS

from .expected import expected_shown
from .one_strip import OneStrip
from .request_queue import RequestQueue
from .state import OtherStrip, PageState
from .strip_feed import StripFeed, layout_shown

_TICK_S = 0.02  # longest wait for frames before timeouts and requests are handled
_SEARCH_EVERY_S = 1.0
_HEALTH_PER_S = 2
_RATE_OVER_S = 2.0  # time over which rate and latency are computed
# Cause and next step while the strip cannot be read.
_NEXT = {
    SEARCHING: "no board found; next: plug a board in, or name its port with --port",
    STALLED: "the board sends no readings; next: wait a moment, or press the board's reset button",
    LOST: "the board is disconnected; next: plug the board in again, and wait a moment",
    REFUSED: "this is another board; next: plug the previous board in, or restart 'spots serve'",
}
# Shown for a strip without readings while another strip of the board sends readings.
_SILENT = "no readings arrive; next: check the wires of the sensor"


class BoardReader:
    """Reads a board in a thread, and shows the readings in the web UI, until `stop` is called.

    Parameters
    ----------
    open_board : callable
        ``open_board(board_id)`` opens and returns the board with this id, or any board if the id is
        None; raises SpotsError if this is not possible.
    layout : KeyLayout
        Key layout to show until a request changes the layout.
    state : PageState
        State of the web UI; its parts ``board``, ``touch``, ``spectrum``, ``keys``, ``stick``,
        ``untrusted``, ``beside`` and ``link`` are set, see docs/extend/web-messages.md.
    search_every_s : float
        Time between two searches for a board, in seconds.
    on_touch : callable
        ``on_touch(touch)`` is called with each reading, in the reader's thread.
    queues : collection of RequestQueue
        Queues of requests from browsers; the reader's thread handles these requests.
    """

    def __init__(
        self,
        open_board: Callable[[str | None], Board],
        layout: KeyLayout,
        state: PageState,
        search_every_s: float = _SEARCH_EVERY_S,
        on_touch: Callable[[Touch], None] = lambda touch: None,
        queues: Collection[RequestQueue] = (),
    ):
        self._open_board, self._state = open_board, state
        self._settings: dict[str, Any] = {"layout": layout}  # arguments of `StripFeed`
        self._search_every_s = search_every_s
        self._on_touch, self._queues = on_touch, queues
        self._fingers: dict[int, list[float]] = {}  # by strip: positions in its next reading, in um
        self._shown = 0  # number of the strip that is shown in detail
        self._stopping = threading.Event()
        self._id: str | None = None
        self._known: dict = {}
        self._said: dict = {}
        self._thread = threading.Thread(target=self._run, name="reader", daemon=True)

    def start(self) -> None:
        """Start the thread that reads the board."""
        self._say(SEARCHING, "")
        self._thread.start()

    def stop(self, timeout_s: float = 5.0) -> None:
        """Stop the thread and close the board; wait at most `timeout_s` seconds for the thread."""
        self._stopping.set()
        for one in self._queues:
            one.stopping = True
        if self._thread.is_alive():
            self._thread.join(timeout_s)

    def _run(self) -> None:
        attempt = Guarded(self._attempt, "the reader of a board", self._lost)
        while not self._stopping.is_set():
            if not attempt():
                self._stopping.wait(self._search_every_s)

    def _attempt(self) -> bool:
        """Read a board, or a recording that a browser has chosen; return False if reading fails.

        Return True if the reader is stopped, or if a browser chooses another source.
        """
        playing = self._playing()
        try:
            with open_recording(playing) if playing else self._open_board(self._id) as board:
                board.when_state_changes(self._take_state)
                several = len(board.sensors) > 1
                strips = [OneStrip(board, i) for i in board.sensors] if several else [board]
                while not self._stopping.is_set() and self._playing() == playing:
                    self._read(board, strips)
        except SpotsError as error:
            if playing:
                for one in self._queues:
                    one.leave()
            self._lost(str(error), refused=isinstance(error, RefusedError))
            return False
        return True

    def _playing(self) -> Path | None:
        return next((one.playing for one in self._queues if one.playing), None)

    def _lost(self, why: str, refused: bool = False) -> None:
        self._say(REFUSED if refused else LOST if self._id else SEARCHING, why)

    def _read(self, board: Board, strips: Sequence[Board | OneStrip]) -> None:
        """Read a board until it restarts, or until a request may have changed its settings.

        `strips` are the strips of the board.
        """
        restarts = board.stats.restarts
        for one in self._queues:
            self._settings |= one.strip_settings
        infos = [_begun(strip) for strip in strips]
        self._shown = max((one.sensor for one in self._queues), default=0) % len(strips)
        strip, info = strips[self._shown], infos[self._shown]
        playing = self._playing()
        if not playing:
            if self._id not in (None, infos[0]["id"]):
                found = infos[0]["id"]
                raise PortError(f"{board.port} now has board {found} instead of {self._id}")
            self._id = infos[0]["id"]
        settings = _settings(strip)
        self._known = {
            **{name: info.get(name) for name in _FACTS},
            "strip": self._shown,
            "strips": [{name: one.get(name) for name in _FACTS_OF_STRIP} for one in infos],
            "start": start_fault(board.info),
            "port": playing.name if playing else board.port,
            "full_scale": settings["full_scale"],
            "expected": expected_shown(strip, info, settings["dark"]),
            "layout": layout_shown(self._settings["layout"]) if info.get("length_um") else None,
        }
        for one in self._queues:
            one.enter()  # first: a browser may send a request as soon as it sees the board
        self._say(CONNECTED, "")
        layout, beside = self._settings["layout"], {}
        self._state.put("beside", beside.copy())
        feeds = [
            StripFeed(strip, info, self._state, **self._settings)
            if i == self._shown
            else StripFeed(board, {}, OtherStrip(self._state, i, beside), layout)
            for i in range(len(strips))
        ]
        self._heard_s = [board.now_s()] * len(strips)
        health = _Health(board, self._state)
        left = self._queues
        try:
            frames = board.frames()
            while not self._stopping.is_set():
                for frame in frames.within(_TICK_S):
                    self._take(frame, feeds, health, board)
                    if self._stopping.is_set():
                        return
                if board.ended:  # `frames` of an ended recording returns without a wait
                    self._stopping.wait(_TICK_S)
                self._tick(feeds, infos, board.now_s())
                health.show()
                if any(one.attend(strip) for one in self._queues):
                    left = ()  # the board is still connected
                    return
                # A pause in a recording is part of the recording.
                paused = board.channel.player is not None and not board.ended
                if board.channel.loss.silent(board.now_s(), SEARCH_S) and not paused:
                    raise PortError("no readings arrive")
                if board.stats.restarts != restarts:
                    return
        finally:
            for feed in feeds:
                feed.release()
            for one in left:
                one.leave()

    def _take(self, frame, feeds: list[StripFeed], health: _Health, board: Board) -> None:
        if isinstance(frame, Touch):
            self._on_touch(frame)
        if frame.sensor >= len(feeds):
            return
        feed, shown = feeds[frame.sensor], frame.sensor == self._shown
        if isinstance(frame, Touch):
            if self._said["state"] != CONNECTED:
                for one in feeds:
                    one.release()
                self._say(CONNECTED, "")
            now_s = board.now_s()
            self._heard_s[frame.sensor] = now_s
            feed.take(frame, now_s, self._fingers.pop(frame.sensor, ()))
            if shown:
                health.took(now_s, now_s - frame.time_s)
        elif isinstance(frame, Spectrum):
            feed.take_spectrum(frame, board.now_s())
            if shown:
                self._state.put("spectrum", {"counts": frame.counts})
        elif isinstance(frame, Contact):
            fingers = self._fingers.setdefault(frame.sensor, [])
            fingers += [] if frame.ended else [frame.position_um]
        elif isinstance(frame, Key):
            feed.take_key(frame)

    def _tick(self, feeds: list[StripFeed], infos: list, now_s: float) -> None:
        for feed, info, heard_s in zip(feeds, infos, self._heard_s):
            feed.tick(now_s)
            every_s = 1e-6 * info.get("exposure_us", 0) * info.get("average", 1)
            if max(self._heard_s) - heard_s > silent_s(SEARCH_S, every_s):
                feed.silence(_SILENT)

    def _take_state(self, state: str) -> None:
        if state != CONNECTED:  # shown with the first reading
            self._say(state, "")

    def _say(self, state: str, message: str) -> None:
        board = {"state": state, "message": message, "next": _NEXT.get(state, ""), **self._known}
        if board != self._said:
            self._state.put("board", board)
            self._said = board  # last: after an error, the next attempt shows the state again


def _begun(strip: Board | OneStrip) -> Mapping[str, Any]:
    """Start the streams of a strip, and return its reply to ``hello``."""
    strip.command("stream contact touch spectrum")
    try:
        return strip.command("hello")
    except BoardError:
        return {}  # a remote board replies to `hello` only for its first strip


def _settings(board: Board | OneStrip) -> dict:
    unknown = {"full_scale": None, "dark": [0] * CHANNELS}
    try:
        return unknown | board.command("get")
    except SpotsError:
        return unknown  # a recording has no settings


# Values of ``hello`` that the web UI shows: of the chosen strip, and of every strip.
_FACTS = (
    *("id", "board", "runtime", "firmware", "calibration", "length_um", "relative_force"),
    *("presser", "channels", "gain", "exposure_us", "led_mA", "led", "average", "strain_ppm"),
)
_FACTS_OF_STRIP = "id", "calibration", "length_um", "relative_force"


class _Health:
    """Shows rate, losses and latency of the link to a board in the web UI, twice a second.

    The latency of a reading is the time from its measurement to its arrival.
    """

    def __init__(self, board: Board, state: PageState):
        self._board, self._state = board, state
        self._latest: deque[tuple[float, float]] = deque()  # arrival and latency of readings, in s
        self._pace = Pace(_HEALTH_PER_S)

    def took(self, now_s: float, latency_s: float) -> None:
        """Count a reading.

        `now_s` is its arrival time from `Board.now_s`, `latency_s` its latency in s.
        """
        self._latest.append((now_s, latency_s))
        self.show()

    def show(self) -> None:
        """Show the values in the web UI, if half a second has passed since the last update."""
        if not self._pace.due(time.monotonic()):
            return
        latest, stats = self._latest, self._board.stats
        while latest and latest[0][0] < self._board.now_s() - _RATE_OVER_S:
            latest.popleft()
        lasted_s = latest[-1][0] - latest[0][0] if latest else 0.0
        link = {
            "rate_hz": (len(latest) - 1) / lasted_s if lasted_s > 0 else None,
            "frames": stats.frames,
            "lost": stats.lost,
            "bad": stats.bad_crc,
            "latency_ms": 1000 * median(one for _, one in latest) if latest else None,
        }
        self._state.put("link", link)
