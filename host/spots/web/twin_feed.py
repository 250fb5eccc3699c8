"""A linkage on the page: the readings of both joints in, the part ``twin`` of a state out."""

from __future__ import annotations

import math
import threading
from collections import deque
from contextlib import ExitStack
from functools import partial

from ..keyboard.layout import KeyLayout
from ..link.board import Board
from ..link.frames import Touch
from ..link.timeouts import CONNECTED
from ..linkage.digital_twin import Terminal, Twin
from ..linkage.twin_source import DrivenLinkage, check, give, loaded
from ..terminal.view import Pace
from .board_feed import BoardReader, finder
from .state import PageState

_SHOWN_PER_S = 20
# A trail is sent whole each time: no finer than a page shows it, and so long at most.
_STEP_MM = 0.5
_TRAIL = 1000


class TwinFeed:
    """Follows a linkage and puts it into a state; its joints may be read by different threads.

    Parameters
    ----------
    twin : Twin
    state : PageState
    """

    def __init__(self, twin: Twin, state: PageState):
        self._twin, self._state = twin, state
        self._lock = threading.Lock()
        self._pace = Pace(_SHOWN_PER_S)
        self._trail: deque[tuple[float, float]] = deque(maxlen=_TRAIL)
        self._shown_s = -math.inf
        self._away = ["", ""]  # why a joint cannot be read
        linkage = twin.linkage
        self._shown = {
            **dict.fromkeys(("x_mm", "y_mm", "theta1_rad", "theta2_rad", "cov")),
            "base_mm": linkage.base_mm,
            "bar_mm": linkage.bar_mm,
        }
        self._wait("waiting for readings of both joints")

    def take(self, joint: int, touch: Touch) -> None:
        """Take a reading of a joint.

        Parameters
        ----------
        joint : int
            0 or 1; others are ignored.
        touch : Touch
            The readings of one strip, in order.
        """
        if joint >= len(self._away):
            return  # a third sensor
        with self._lock:
            self._away[joint] = ""
            for terminal in self._twin.take(joint, touch):
                if terminal.time_s < self._shown_s:  # a recording that is played again
                    self._trail.clear()
                    self._pace = Pace(_SHOWN_PER_S)
                self._shown_s = terminal.time_s
                self._extend(terminal)
                if self._pace.due(terminal.time_s):
                    self._shown.update(terminal.message())
                    self._put(terminal.remark)
            silence = self._twin.silence(touch.time_s)
            if silence and self._pace.due(touch.time_s):
                self._wait("".join(self._away) or silence)

    def lost(self, joint: int, why: str) -> None:
        """Report why a joint cannot be read.

        Parameters
        ----------
        joint : int
            0 or 1.
        why : str
            Shown in the web UI.
        """
        with self._lock:
            self._away[joint] = f"joint {joint + 1}: {why}"
            self._wait(self._away[joint])

    def _wait(self, note: str) -> None:
        self._shown.update(x_mm=None, y_mm=None)
        self._put(note)

    def _extend(self, terminal: Terminal) -> None:
        if terminal.limit:
            return
        x_mm, y_mm = self._trail[-1] if self._trail else (float("inf"), 0.0)
        if max(abs(terminal.x_mm - x_mm), abs(terminal.y_mm - y_mm)) >= _STEP_MM:
            self._trail.append((round(terminal.x_mm, 2), round(terminal.y_mm, 2)))

    def _put(self, note: str) -> None:
        self._state.put("twin", {**self._shown, "trail": list(self._trail), "note": note})


class _Aside(PageState):
    """The state of a board that is not shown itself; only its loss is reported."""

    def __init__(self, feed: TwinFeed, joint: int):
        super().__init__()
        self._feed, self._joint = feed, joint

    def put(self, name, value):
        if name == "board" and value["state"] != CONNECTED:
            self._feed.lost(self._joint, value["message"] or "looking for its board")


def linkage_readers(
    linkage: str, ports: list[str], layout: KeyLayout, state: PageState
) -> list[BoardReader]:
    """Return a reader for each board of a linkage file; the first one's strip is shown, too.

    Parameters
    ----------
    linkage : str
        A linkage file.
    ports : list of str
        Of joint 1 and joint 2, or of one board with two sensors; found, if not given.
    layout : KeyLayout
    state : PageState

    Returns
    -------
    list of BoardReader

    Raises
    ------
    SpotsError
        If a file is wrong, or there are more than two ports.
    """
    twin, strips = loaded(linkage, ports)
    feed = TwinFeed(twin, state)
    if len(ports) == 1:

        def of_any_sensor(touch: Touch) -> None:
            feed.take(touch.sensor, touch)

        return [BoardReader(finder(ports[0]), layout, state, on_touch=of_any_sensor)]
    # One after the other: a board that one search asks for its id is busy for the other one.
    searching = threading.Lock()

    searches = [finder(port) for port in (ports or (None, None))]

    def open_board(joint: int, board_id: str | None) -> Board:
        strip = strips[joint]
        with searching, ExitStack() as stack:
            board = stack.enter_context(searches[joint](board_id if ports else strip.board))
            check(strip, board.info, joint + 1, board.port)
            give(board, strip)
            stack.pop_all()
            return board

    return _readers(feed, open_board, layout, state)


def driven_readers(driven: DrivenLinkage, layout: KeyLayout, state: PageState) -> list[BoardReader]:
    """Return readers of the two boards of a linkage that opens them itself.

    Parameters
    ----------
    driven : DrivenLinkage
    layout : KeyLayout
    state : PageState

    Returns
    -------
    list of BoardReader
    """
    feed = TwinFeed(Twin(driven.linkage, driven.encoders()), state)
    return _readers(feed, lambda joint, board_id: driven.open(joint), layout, state)


def _readers(feed: TwinFeed, open_board, layout: KeyLayout, state: PageState) -> list[BoardReader]:
    return [
        BoardReader(partial(open_board, i), layout, of_board, on_touch=partial(feed.take, i))
        for i, of_board in enumerate((state, _Aside(feed, 1)))
    ]
