"""Validates the key layouts that browsers edit, and stores them on the board and on disk."""

from pathlib import Path
from typing import Annotated, Any

import msgspec

from spots_device.layout import LIMITS

from ..atomic import write_text
from ..keyboard import keys
from ..keyboard.layout import FLAVOURS, KeyLayout, compiled, load
from ..link.board import Board
from .feel import stored_layout
from .file_editor import Base, Check, FileEditor, Text
from .state import PageState

_DEFAULT = "digits"  # the layout of a board without a stored layout
_UNKNOWN = "everything on the board's present layout, which this program does not know"


class Push(msgspec.Struct, tag_field="do", tag="push", forbid_unknown_fields=True):
    """Request of a browser: replace the layout with checksum `base`.

    `loses` lists the actions that the new layout may lack.
    """

    text: Text
    base: Base
    loses: Annotated[
        list[Annotated[str, msgspec.Meta(max_length=200)]], msgspec.Meta(max_length=1024)
    ]


class Clear(msgspec.Struct, tag_field="do", tag="clear", forbid_unknown_fields=True):
    """Request of a browser: restore the board's default layout."""


class LayoutEditor(FileEditor):
    """Validates key layouts from browsers, and stores them on the board and in a file.

    Parameters
    ----------
    path : Path
        Layout file. If it does not exist, the first push creates it.
    usual : KeyLayout
        Layout to begin with if the file does not exist.
    state : PageState
        State that gets the part ``editor``.

    Raises
    ------
    SpotsError
        If the name of the file does not end in ``.toml``, or the file is invalid.
    """

    what = "the layout editor"
    requests = Check | Push | Clear

    def __init__(self, path: Path, usual: KeyLayout, state: PageState):
        super().__init__(path, "layout", "editor", state)
        self._use(load(path) if path.exists() else usual)
        self._show(None)

    def _use(self, layout: KeyLayout) -> None:
        self._layout, self._draft, self.text = layout, None, layout.text
        self.feel = {"layout": layout, "draft": lambda: self._draft}

    def _check(self, request: Check) -> dict[str, Any]:
        layout = compiled(Path(self._path.name), request.text)
        self._draft = None if layout.lines == self._layout.lines else layout
        return {"content": layout.content, "loses": self._lost(layout)}

    def _handle(self, board: Board, request: Push | Clear) -> dict[str, Any] | None:
        if isinstance(request, Push):
            return self._push(request, board)
        board.command("layout clear")
        board.command("save")
        self._use(load(_DEFAULT))
        self._show(board.command("hello"))
        return None

    def _push(self, request: Push, board: Board) -> dict[str, Any]:
        self._check_base(request.base)
        layout = compiled(Path(self._path.name), request.text)
        loses = self._lost(layout)
        if stored_layout(board.command("hello"), self._layout) == "other":
            loses = [_UNKNOWN, *loses]
        if not set(loses) <= set(request.loses):
            return {"loses": loses, "note": None}
        note = keys.push(board, layout)
        self._use(layout)
        self._show(board.command("hello"))
        write_text(layout.text, self._path)  # last: errors must not hide the board's layout
        return {"loses": [], "note": note}

    def _lost(self, layout: KeyLayout) -> list[str]:
        return [keys.say(layout, one) for one in sorted(self._layout.typed - layout.typed)]

    def _shown(self, info) -> dict[str, Any]:
        return {
            "content": self._layout.content,
            "stored": info and stored_layout(info, self._layout),
            "limits": LIMITS,
            "flavours": FLAVOURS,
        }
