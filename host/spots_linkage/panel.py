"""The panel of the web UI that shows a linkage, with the boards of its joints."""

import math
import threading
from argparse import Namespace
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from spots.cli.parser import Parser
from spots.link.board import Board
from spots.link.finder import finder
from spots.link.frames import Touch
from spots.terminal.view import Pace

from .digital_twin import Terminal, Twin
from .twin_source import (
    DrivenLinkage,
    board_of,
    give,
    linkage_factory,
    loaded,
)

Show = Callable[[Any], object]  # replaces the value that browsers draw
Sources = list[tuple[Callable, Callable, Callable]]  # see `TwinPanel.boards`

_SHOWN_PER_S = 20  # states of the linkage
# Each message contains the whole trail, so the trail's step and length are limited.
_STEP_MM = 0.5
_TRAIL = 1000


class TwinFeed:
    """Shows the digital twin of a linkage in the web UI. Two threads may call `take`.

    ``show(value)`` shows a new state, see docs/extend/web-messages.md. The joints have the
    indices 0 and 1.
    """

    def __init__(self, twin: Twin, show: Show):
        self._twin, self._show = twin, show
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
        """Add a reading of a joint, and show the new state of the linkage."""
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
        """Show why a joint cannot be read."""
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
        self._show({**self._shown, "trail": list(self._trail), "note": note})


class TwinPanel:
    """Panel ``twin`` of the web UI, an entry point of the group ``spots.panels``."""

    title = "Linkage"
    static = Path(__file__).parent / "static"
    boards_option = "--linkage FILE.toml"

    def __init__(self, show: Show, options: Namespace):
        self._show, self._options = show, options

    @staticmethod
    def add_options(parser: Parser) -> None:
        """Add the option that shows the panel."""
        parser.option("--linkage", "FILE.toml", "show the five-bar linkage of this file")

    def boards(self) -> Sources:
        """Return how to open, follow and miss the boards of ``--linkage``; empty without it."""
        options = self._options
        if options.linkage is None:
            return []
        if simulated := linkage_factory(options.port):
            return driven_sources(simulated(options), self._show)
        return linkage_sources(options.linkage, options.port, self._show)


def linkage_sources(linkage: str, ports: list[str], show: Show) -> Sources:
    """Return how to open, follow and miss each of the one or two boards of a linkage file.

    The ports are those of joint 1 and joint 2, or that of a board with both strips. Without ports,
    the boards are found by their ids. SpotsError if a file is invalid, or there are more than two
    ports.
    """
    twin, strips = loaded(linkage, ports)
    feed = TwinFeed(twin, show)
    # One search at a time: a search cannot open a board that the other search has opened.
    searching = threading.Lock()

    def source(port: str | None, joints: Sequence[int]):
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

        return open_board, take, partial(feed.lost, joints[0])

    if len(ports) == 1 or (not ports and board_of(strips[0]) == board_of(strips[1])):
        return [source((ports or [None])[0], (0, 1))]
    port1, port2 = ports or (None, None)
    return [source(port1, (0,)), source(port2, (1,))]


def driven_sources(driven: DrivenLinkage, show: Show) -> Sources:
    """Return the two boards that a `DrivenLinkage` opens, as `linkage_sources` does."""
    feed = TwinFeed(Twin(driven.linkage, driven.encoders()), show)
    return [
        (lambda board_id, joint=i: driven.open(joint), partial(feed.take, i), partial(feed.lost, i))
        for i in (0, 1)
    ]
