"""Passes readings and requests to the panels of other packages, and reads boards for them."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import msgspec

from spots.common.guarded import Guarded
from spots.keyboard.key_layout import KeyLayout
from spots.link.board import Board
from spots.link.frames import Touch
from spots.link.timeouts import CONNECTED

from .board_feed import BoardReader
from .panels import installed
from .request_queue import RequestQueue
from .state import PageState


class Source(NamedTuple):
    """A board that a panel reads; `on_touch` gets each reading.

    ``on_loss(why)`` is called when the board cannot be read, except for the first board, whose
    state is shown.
    """

    open_board: Callable[[str | None], Board]
    on_touch: Callable[[Touch], object]
    on_loss: Callable[[str], object]


class OpenPanels:
    """The panels of one web UI.

    `requests` has the handler of the requests to each panel, by path. `sources` are boards to read
    in place of the one that ``--port`` names. SpotsError if an option of a panel is wrong.
    """

    def __init__(self, state: PageState, options: Namespace):
        self.requests: dict[str, RequestQueue] = {}
        self.sources: list[Source | tuple] = []
        self._takers = []
        for panel in installed():
            opened = panel.open(shower(state, panel.name), options)
            if take := getattr(opened, "on_touch", None):
                self._takers.append(Guarded(take, f"the panel '{panel.name}'"))
            if handle := getattr(opened, "on_request", None):
                self.requests[f"panels/{panel.name}"] = PanelRequests(panel.name, handle)
            if panel.reads(options):
                self.sources += opened.boards()

    def on_touch(self, touch: Touch) -> None:
        """Pass a reading to all panels."""
        for take in self._takers:
            take(touch)


def shower(state: PageState, name: str) -> Callable[[Any], None]:
    """Return the function `show` of a panel, which copies a value into a part of the state."""
    return lambda value: state.put(f"panel-{name}", msgspec.to_builtins(value))


class PanelRequests(RequestQueue):
    """Passes requests of browsers to the method ``on_request`` of a panel."""

    request_max = 16_384
    requests = Any

    def __init__(self, name: str, handle: Callable[[Board, Any], Any]):
        super().__init__()
        self.what = f"the panel '{name}'"
        self._handler = handle

    def _handle(self, board: Board, request: Any) -> Any:
        return msgspec.to_builtins(self._handler(board, request))


def readers_of(
    sources: Sequence[Source | tuple], layout: KeyLayout, state: PageState, **options: Any
) -> list[BoardReader]:
    """Return a reader for each board of a panel; only the first one shows its strip.

    The options are those of the first `BoardReader`.
    """
    first, *others = (Source(*one) for one in sources)
    shown = BoardReader(first.open_board, layout, state, on_touch=first.on_touch, **options)
    return [
        shown,
        *(
            BoardReader(one.open_board, layout, _Unshown(one.on_loss), on_touch=one.on_touch)
            for one in others
        ),
    ]


class _Unshown(PageState):
    """Discards the state of a board that is not shown, but reports its loss."""

    def __init__(self, on_loss: Callable[[str], object]):
        super().__init__()
        self._on_loss = on_loss

    def put(self, name, value):
        if name == "board" and value["state"] != CONNECTED:
            self._on_loss(value["message"] or value["next"])
