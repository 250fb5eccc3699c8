"""Shows a linkage in the web UI: computes its digital twin from the readings of both joints."""

import math
import threading
from collections import deque
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial

from spots.keyboard.layout import KeyLayout
from spots.link.board import Board
from spots.link.frames import Touch
from spots.link.timeouts import CONNECTED
from spots.terminal.view import Pace
from spots_linkage.digital_twin import Terminal, Twin
from spots_linkage.twin_source import (
    DrivenLinkage,
    board_of,
    give,
    loaded,
)

from .board_feed import BoardReader, finder
from .state import PageState

_SHOWN_PER_S = 20  # states of the linkage
# Each message contains the whole trail, so the trail's step and length are limited.
_STEP_MM = 0.5
_TRAIL = 1000


class TwinFeed:
    """Shows the digital twin of a linkage in the web UI. Two threads may call `take`.

    Parameters
    ----------
    twin : Twin
        Twin that computes the linkage's state from the readings.
    state : PageState
        State of the web UI; its part ``twin`` is set, see `PageState.put`.
    """

    def __init__(self, twin: Twin, state: PageState):
        self._twin, self._state = twin, state
        self._lock = threading.Lock()
        self._pace = Pace(_SHOWN_PER_S)
        self._trail: deque[tuple[float, float]] = deque(maxlen=_TRAIL)
        self._shown_s = -math.inf
        self._away = ["", ""]  # reason why each joint cannot be read; empty if it can be read
        self._shown = {
            **dict.fromkeys(("x_mm", "y_mm", "theta1_rad", "theta2_rad", "cov")),
            "base_mm": twin.linkage.base_mm,
            "bar_mm": twin.linkage.bar_mm,
        }
        self._wait("waiting for readings of both joints")

    def take(self, joint: int, touch: Touch) -> None:
        """Add a reading of a joint, and show the new state of the linkage.

        Parameters
        ----------
        joint : int
            Index of the joint: 0 for joint 1, 1 for joint 2.
        touch : Touch
            The next reading of this joint.
        """
        with self._lock:
            self._away[joint] = ""
            for terminal in self._twin.take(joint, touch):
                if terminal.time_s < self._shown_s:  # a recording is played again
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
        """Show that a joint cannot be read.

        Parameters
        ----------
        joint : int
            Index of the joint: 0 for joint 1, 1 for joint 2.
        why : str
            Reason, shown in the web UI.
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
        here = terminal.x_mm, terminal.y_mm
        if not self._trail or math.dist(here, self._trail[-1]) >= _STEP_MM:
            self._trail.append((round(terminal.x_mm, 2), round(terminal.y_mm, 2)))

    def _put(self, note: str) -> None:
        self._state.put("twin", {**self._shown, "trail": list(self._trail), "note": note})


class _Aside(PageState):
    """Discards the state of a joint's board, but reports a disconnection to a `TwinFeed`."""

    def __init__(self, feed: TwinFeed, joint: int):
        super().__init__()
        self._feed, self._joint = feed, joint

    def put(self, name, value):
        if name == "board" and value["state"] != CONNECTED:
            self._feed.lost(self._joint, value["message"] or value["next"])


def linkage_readers(
    linkage: str, ports: list[str], layout: KeyLayout, state: PageState
) -> list[BoardReader]:
    """Return the readers of the one or two boards that belong to a linkage file.

    Parameters
    ----------
    linkage : str
        Path of the linkage file.
    ports : list of str
        Port of joint 1 and port of joint 2, or the port of a board that has both strips. If empty,
        the boards are found by their ids.
    layout : KeyLayout
        Key layout to show for the strip of joint 1.
    state : PageState
        State of the web UI, for the twin and the strip of joint 1.

    Returns
    -------
    list of BoardReader

    Raises
    ------
    SpotsError
        If a file is invalid, or there are more than two ports.
    """
    twin, strips = loaded(linkage, ports)
    feed = TwinFeed(twin, state)
    # One search at a time: a search cannot open a board that the other search has opened.
    searching = threading.Lock()

    def reader(port: str | None, joints: Sequence[int], of_board: PageState) -> BoardReader:
        search, found_by = finder(port), board_of(strips[joints[0]])
        joint_of: dict[int, int] = {}  # by number of the joint's strip on the board

        def open_board(board_id: str | None) -> Board:
            with searching, ExitStack() as stack:
                board = stack.enter_context(search(board_id if port else found_by))
                for joint in joints:
                    joint_of[give(board, strips[joint], joint + 1)] = joint
                stack.pop_all()
                return board

        def take(touch: Touch) -> None:
            if touch.sensor in joint_of:
                feed.take(joint_of[touch.sensor], touch)

        return BoardReader(open_board, layout, of_board, on_touch=take)

    if len(ports) == 1 or (not ports and board_of(strips[0]) == board_of(strips[1])):
        return [reader((ports or [None])[0], (0, 1), state)]
    port1, port2 = ports or (None, None)
    return [reader(port1, (0,), state), reader(port2, (1,), _Aside(feed, 1))]


def driven_readers(driven: DrivenLinkage, layout: KeyLayout, state: PageState) -> list[BoardReader]:
    """Return the readers of the two boards that a `DrivenLinkage` opens.

    Parameters
    ----------
    driven : DrivenLinkage
        The linkage, for example a simulated linkage.
    layout : KeyLayout
        Key layout to show for the strip of joint 1.
    state : PageState
        State of the web UI, for the twin and the strip of joint 1.

    Returns
    -------
    list of BoardReader
    """
    feed = TwinFeed(Twin(driven.linkage, driven.encoders()), state)
    return [
        BoardReader(
            lambda board_id, joint=i: driven.open(joint),
            layout,
            of_board,
            on_touch=partial(feed.take, i),
        )
        for i, of_board in enumerate((state, _Aside(feed, 1)))
    ]
