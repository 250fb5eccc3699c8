"""Validates the text of a TOML file that browsers edit; a subclass stores the text."""

from concurrent.futures import Future
from pathlib import Path
from typing import Annotated, Any

import msgspec

from spots_device.settings import checksum

from ..errors import SpotsError
from ..link.board import Board
from .orders import Orders
from .state import PageState

_TEXT_MAX = 32_768  # characters; the largest layout of a board needs about 20,000
Text = Annotated[str, msgspec.Meta(max_length=_TEXT_MAX)]
Base = Annotated[str, msgspec.Meta(max_length=8)]


class Check(msgspec.Struct, tag_field="do", tag="check", forbid_unknown_fields=True):
    """Request of a browser: validate the text of a file, without storing it."""

    text: Text


class FileEditor(Orders):
    """Validates texts of a TOML file from browsers; a subclass stores them.

    A subclass also has the methods ``_check(request)``, which returns the answer to a `Check`, and
    ``_shown(info)``, which returns further values for the web UI; `info` is the board's ``hello``
    reply, or None.

    Parameters
    ----------
    path : Path
        The file. If it does not exist, the first request that stores a text creates it.
    kind : str
        Kind of file for error messages, such as "layout".
    part : str
        Name of the part of the state that describes the file.
    state : PageState
        State of the web UI; contains this part.

    Attributes
    ----------
    text : str
        Present text of the file.

    Raises
    ------
    SpotsError
        If the name of the file does not end in ``.toml``.
    """

    request_max = 2 * _TEXT_MAX
    _changes_board = True

    def __init__(self, path: Path, kind: str, part: str, state: PageState):
        super().__init__()
        self.nobody = f"there is no board for the {kind}: plug one in"
        if path.suffix != ".toml":
            raise SpotsError(f"'{path}' is not a {kind} file: give a name that ends in .toml")
        self._path, self._kind = path, kind
        self._part, self._state = part, state
        self._shown_for: str | None = None  # id of the strip for which the part was computed

    def submit(self, request: Any) -> Future:
        """Answer a `Check` at once, without a board; queue any other request."""
        if not isinstance(request, Check):
            return super().submit(request)
        answer: Future = Future()
        self._answer(answer, self._check, request)
        return answer

    def attend(self, board: Board) -> bool:
        """Handle all waiting requests; return whether something was stored."""
        if board.info["id"] != self._shown_for:
            self._shown_for = board.info["id"]
            self._show(board.info)
        return super().attend(board)

    def leave(self) -> None:
        """Handle the loss of the board: refuse all waiting requests."""
        super().leave()
        self._shown_for = None
        self._show(None)

    @property
    def base(self) -> str:
        """Checksum of the present text."""
        return checksum([self.text])

    def _check_base(self, base: str) -> None:
        if base != self.base:
            raise SpotsError(f"another browser has changed the {self._kind}: reload this window")

    def _show(self, info: Any) -> None:
        """Show the file in the web UI; `info` is the board's ``hello`` reply, or None."""
        shown = {"file": self._path.name, "text": self.text, "base": self.base}
        self._state.put(self._part, {**shown, **self._shown(info)})
