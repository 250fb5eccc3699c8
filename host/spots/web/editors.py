"""Editors: validate the TOML files that browsers edit, and store them.

A key layout is stored on the board and in a file. Settings of controller and gestures are stored
only in a file.
"""

from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import msgspec

from spots_device.board.settings import checksum
from spots_device.keys.layout import LIMITS

from .. import toml
from ..atomic import write_text
from ..controller import controller_settings
from ..errors import SpotsError
from ..keyboard import keys
from ..keyboard.layout import FLAVOURS, KeyLayout, compiled, load
from ..link.board import Board
from ..wearable import wearable
from ..wearable.gestures import NAMES
from .feel import stored_layout
from .orders import Orders
from .state import PageState

_DEFAULT = "digits"  # the layout of a board without a stored layout
_UNKNOWN = "keys that are only in the board's present layout (this program does not know it)"
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
    reply, or None without a board.

    Parameters
    ----------
    path : Path
        The file. If it does not exist, the first request that stores a text creates it.
    kind : str
        Kind of file for error messages, such as "layout".
    part : str
        Name of the part of `state` that describes the file, see `PageState.put`.
    state : PageState
        State of the web UI; only this part is set.

    Attributes
    ----------
    text : str
        Current text of the file.

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
        """Answer a `Check` immediately, without a board; queue any other request."""
        if not isinstance(request, Check):
            return super().submit(request)
        answer: Future = Future()
        self._answer(answer, self._check, request)
        return answer

    def attend(self, board: Board) -> bool:
        """Handle all waiting requests; return whether there were any."""
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
            raise SpotsError(
                f"another browser window has changed the {self._kind}: reload this window"
            )

    def _show(self, info: Any) -> None:
        """Show the file in the web UI; `info` is the board's ``hello`` reply, or None."""
        shown = {"file": self._path.name, "text": self.text, "base": self.base}
        self._state.put(self._part, {**shown, **self._shown(info)})


class Push(msgspec.Struct, tag_field="do", tag="push", forbid_unknown_fields=True):
    """Request of a browser: replace the layout whose checksum is `base` by the layout `text`.

    `loses` lists the actions, such as typed keys, that only the old layout has. The user has
    agreed to lose these actions. If another action would be lost, the layout is not replaced.
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
        State of the web UI; its part ``editor`` is set, see `PageState.put`.

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
        # Last, so that the web UI shows the layout of the board even if the file cannot be written.
        write_text(layout.text, self._path)
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


class Save(msgspec.Struct, tag_field="do", tag="save", forbid_unknown_fields=True):
    """Request of a browser: replace the file's old text, which has the checksum `base`."""

    text: Text
    base: Base


class Kind(NamedTuple):
    """A kind of settings file, such as the settings of the controller.

    Attributes
    ----------
    words : str
        Name of the kind for error messages.
    usual : Path
        File to begin with if the user's file does not exist.
    table : type
        Struct that describes the file; the bounds of its fields are sent to browsers.
    read : callable
        ``read(text, path)`` returns the settings of a text, or raises SpotsError.
    more : dict
        Further values for the web UI, by name, such as the names of all gestures.
    """

    words: str
    usual: Path
    table: type
    read: Callable[[str, Path], Any]
    more: dict[str, Any] = {}


KINDS = {
    "controller": Kind(
        "controller settings",
        controller_settings.DEFAULT,
        controller_settings.ControllerSettings,
        controller_settings.parsed,
    ),
    "gestures": Kind(
        "gestures",
        wearable.DEFAULT,
        wearable.GesturesFile,
        lambda text, path: wearable.Mapping(path, text),
        {"names": NAMES},
    ),
}


class SettingsEditor(FileEditor):
    """Validates settings from browsers, and stores them in a file.

    Parameters
    ----------
    name : str
        Kind of settings, a key of `KINDS`; also the name of the part of `state`.
    path : Path
        Settings file. If it does not exist, the first request that stores settings creates it.
    state : PageState
        State of the web UI; its part with this name is set, see `PageState.put`.

    Raises
    ------
    SpotsError
        If the name of the file does not end in ``.toml``, or the file is invalid.
    """

    what = "the editor of settings"
    requests = Check | Save

    def __init__(self, name: str, path: Path, state: PageState):
        self._is = KINDS[name]
        super().__init__(path, self._is.words, name, state)
        begin = path if path.exists() else self._is.usual
        _, self.text = toml.find(begin, begin.parent, self._is.words)
        self.feel = {name: self._is.read(self.text, path)}
        self._show(None)

    def _check(self, request: Check) -> dict[str, Any]:
        self._is.read(request.text, Path(self._path.name))
        return {"content": toml.loads(request.text)}

    def _handle(self, board: Board, request: Save) -> None:
        self._check_base(request.base)
        found = self._is.read(request.text, Path(self._path.name))
        write_text(request.text, self._path)
        self.text, self.feel = request.text, {self._part: found}
        self._show(board.info)

    def _shown(self, info: Any) -> dict[str, Any]:
        return {
            "content": toml.loads(self.text),
            "stored": None if info is None else self._path.exists(),
            "schema": msgspec.json.schema(self._is.table)["$defs"],
            **self._is.more,
        }
