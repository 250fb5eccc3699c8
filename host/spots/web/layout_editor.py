"""Validates the key layouts that browsers edit, and stores them on the board and on disk."""

from concurrent.futures import Future
from pathlib import Path
from typing import Annotated, Any

import msgspec

from spots_device.layout import LIMITS
from spots_device.settings import checksum

from ..atomic import write_text
from ..errors import SpotsError
from ..keyboard import keys
from ..keyboard.layout import FLAVOURS, KeyLayout, compiled, load
from ..link.board import Board
from .feel import stored_layout
from .orders import Orders
from .state import PageState

_TEXT_MAX = 32_768  # characters; the largest layout of a board needs about 20,000
_DEFAULT = "digits"  # the layout of a board without a stored layout
_UNKNOWN = "everything on the board's present layout, which this program does not know"
_Text = Annotated[str, msgspec.Meta(max_length=_TEXT_MAX)]


class Check(msgspec.Struct, tag_field="do", tag="check", forbid_unknown_fields=True):
    """Request of a browser: validate the text of a layout file, without storing it."""

    text: _Text


class Push(msgspec.Struct, tag_field="do", tag="push", forbid_unknown_fields=True):
    """Request of a browser: replace the layout with checksum `base`.

    `loses` lists the actions that the new layout may lack.
    """

    text: _Text
    base: Annotated[str, msgspec.Meta(max_length=8)]
    loses: Annotated[
        list[Annotated[str, msgspec.Meta(max_length=200)]], msgspec.Meta(max_length=1024)
    ]


class Clear(msgspec.Struct, tag_field="do", tag="clear", forbid_unknown_fields=True):
    """Request of a browser: restore the board's default layout."""


_DECODER = msgspec.json.Decoder(Check | Push | Clear)


class LayoutEditor(Orders):
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
    request_max = 2 * _TEXT_MAX

    def __init__(self, path: Path, usual: KeyLayout, state: PageState):
        super().__init__("there is no board for the layout: plug one in")
        if path.suffix != ".toml":
            raise SpotsError(f"'{path}' is not a layout file: give a name that ends in .toml")
        self._path, self._state = path, state
        self.layout: KeyLayout = load(path) if path.exists() else usual
        self._show(None)

    def decode(self, body: bytes) -> Check | Push | Clear:
        """Return the request in a browser's message; raise a ValueError if invalid."""
        return _DECODER.decode(body)

    def submit(self, request: Check | Push | Clear) -> Future:
        """Answer a `Check` at once, without a board; queue any other request."""
        if not isinstance(request, Check):
            return super().submit(request)
        answer: Future = Future()
        self._answer(answer, self._check, request)
        return answer

    def attend(self, board: Board) -> bool:
        """Handle all waiting requests; return whether the layout may have changed."""
        if not self._attended:
            self._attended = True
            self._show(board.info)
        changed = False
        while asked := self._next():
            request, answer = asked
            handle = self._push if isinstance(request, Push) else self._clear
            self._answer(answer, handle, request, board)
            changed = True
        return changed

    def leave(self) -> None:
        """Handle the loss of the board: refuse all waiting requests."""
        super().leave()
        self._show(None)

    def _check(self, request: Check) -> dict[str, Any]:
        layout = compiled(Path(self._path.name), request.text)
        return {"content": layout.content, "loses": self._lost(layout)}

    def _push(self, request: Push, board: Board) -> dict[str, Any]:
        if request.base != checksum([self.layout.text]):
            raise SpotsError("another browser has changed the layout: reload this window")
        layout = compiled(Path(self._path.name), request.text)
        loses = self._lost(layout)
        if stored_layout(board.command("hello"), self.layout) == "other":
            loses = [_UNKNOWN, *loses]
        if not set(loses) <= set(request.loses):
            return {"loses": loses, "note": None}
        note = keys.push(board, layout)
        self.layout = layout
        self._show(board.command("hello"))
        write_text(layout.text, self._path)  # last: errors must not hide the board's layout
        return {"loses": [], "note": note}

    def _clear(self, request: Clear, board: Board) -> None:
        board.command("layout clear")
        board.command("save")
        self.layout = load(_DEFAULT)
        self._show(board.command("hello"))

    def _lost(self, layout: KeyLayout) -> list[str]:
        return [keys.say(layout, one) for one in sorted(self.layout.typed - layout.typed)]

    def _show(self, info) -> None:
        shown = {
            "file": self._path.name,
            "text": self.layout.text,
            "content": self.layout.content,
            "base": checksum([self.layout.text]),
            "stored": info and stored_layout(info, self.layout),
            "limits": LIMITS,
            "flavours": FLAVOURS,
        }
        self._state.put("editor", shown)
