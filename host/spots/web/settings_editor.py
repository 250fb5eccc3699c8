"""Validates the settings of controller and gestures that browsers edit, and stores them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from .. import toml
from ..atomic import write_text
from ..controller import controller_settings
from ..link.board import Board
from ..wearable import wearable
from ..wearable.gestures import NAMES
from .file_editor import Base, Check, FileEditor, Text
from .state import PageState


class Save(msgspec.Struct, tag_field="do", tag="save", forbid_unknown_fields=True):
    """Request of a browser: replace the text of the file with checksum `base`."""

    text: Text
    base: Base


class Kind(NamedTuple):
    """A kind of settings.

    Attributes
    ----------
    words : str
        Name of the kind for error messages.
    usual : Path
        File to begin with if the user's file does not exist.
    table : type
        Struct that describes the file; its bounds are sent to browsers.
    read : callable
        ``read(text, path)`` returns the settings of a text, or raises SpotsError.
    more : dict
        Further values for browsers.
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
        Kind of settings, a key of `KINDS`, and name of the part of the web UI.
    path : Path
        Settings file. If it does not exist, the first request that stores settings creates it.
    state : PageState
        State that gets the part.

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
