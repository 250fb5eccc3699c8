"""Editors: validate the TOML files that browsers edit, and store them.

A key layout is stored on the board and in a file. Settings of controller and gestures are stored
only in a file.
"""

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, NamedTuple, NoReturn

import msgspec

from spots.common import toml
from spots.controller import controller_settings
from spots.errors import BoardError, ChangedError, FileError, SpotsError, printable
from spots.keyboard import hosts, keys, timing_picture
from spots.keyboard.key_layout import FLAVORS, KeyLayout
from spots.keyboard.layout import compiled, load
from spots.keyboard.layout_format import RELEASE_AFTER_MS
from spots.link.board import Board
from spots.link.connect import ensured
from spots.outputs.usages import KEYBOARD, name_of
from spots.wearable import wearable
from spots.wearable.gestures import NAMES
from spots_device.board.settings import checksum
from spots_device.keys.layout import LIMITS

from .request_queue import RequestQueue
from .state import PageState
from .strip_feed import stored_layout
from .toml_text import edited, lost_comments
from .user_file import UserFile

_DEFAULT = "digits"  # the layout of a board without a stored layout
_UNKNOWN = "keys that are only in the board's present layout (this program does not know it)"
_TEXT_MAX = 32_768  # characters; the largest layout of a board needs about 20,000
Text = Annotated[str, msgspec.Meta(max_length=_TEXT_MAX)]
Base = Annotated[str, msgspec.Meta(max_length=8)]


class Check(msgspec.Struct, tag_field="do", tag="check", forbid_unknown_fields=True):
    """Request of a browser: validate a file, without storing it.

    `text` is the text of the file; if not given, the present text. With `content`, its values are
    changed to this content.
    """

    text: Text | None = None
    content: dict[str, Any] | None = None


class FileEditor(RequestQueue):
    """Validates a TOML file from browsers; a subclass stores it.

    A subclass also has these methods: ``_read(text)`` returns the content of a text, or raises
    SpotsError. ``_use(text)`` makes a valid text the present text. ``_checked(text)`` returns the
    answer to a `Check`. ``_shown(info)`` returns further values for the web UI; `info` is the
    board's ``hello`` reply, or None without a board.

    If the file does not exist, `usual` is the text to begin with, and the first request that stores
    a text creates the file. Only the part `part` of the state is set. FileError if the name of the
    file does not end in ``.toml``, or the file is invalid, or could not be written.
    """

    request_max = 2 * _TEXT_MAX
    _changes_board = True

    def __init__(self, path: Path, kind: str, part: str, state: PageState, usual: str):
        super().__init__()
        self.nobody = f"there is no board for the {kind}: plug one in"
        self.file, self._kind = UserFile(path, kind), kind
        self._part, self._state = part, state
        self._name = Path(printable(path.name))
        self._shown_for: str | None = None  # id of the strip for which the part was computed
        text = self.file.read()
        self._use(usual if text is None else text)
        self._show(None)

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

    def _check(self, request: Check) -> dict[str, Any]:
        text = before = self.text if request.text is None else request.text
        if request.content is not None:
            text = edited(before, self._read, request.content)
        return {**self._checked(text), "text": text, "lost": lost_comments(before, text)}

    def _check_base(self, base: str, info: Any) -> None:
        """Raise ChangedError if somebody else has changed the file; the web UI then shows it."""
        if base != self.base:
            raise ChangedError(
                f"another browser window has changed the {self._kind}: reload this window",
                self.file.path,
            )
        if self.file.changed:
            self._take_change(info)

    def _take_change(self, info: Any) -> NoReturn:
        changed = f"another program has changed {self._name}"
        try:
            text = self.file.read()
            self._use(self.text if text is None else text)
        except SpotsError as error:
            raise ChangedError(
                f"{changed}, and it cannot be used now: {error}", self.file.path
            ) from None
        self._show(info)
        raise ChangedError(
            f"{changed}: this window shows the file now; press Undo for your draft, which you can "
            "then store",
            self.file.path,
        )

    def _show(self, info: Any) -> None:
        """Show the file in the web UI; `info` is the board's ``hello`` reply, or None."""
        shown = {"file": str(self._name), "text": self.text, "base": self.base}
        self._state.put(self._part, {**shown, **self._shown(info)})


class Push(msgspec.Struct, tag_field="do", tag="push", forbid_unknown_fields=True):
    """Request of a browser: replace the layout whose checksum is `base` by the layout `text`.

    `loses` lists the actions, such as typed keys, that only the old layout has. The user has
    agreed to lose these actions. If another action would be lost, the layout is not replaced.
    `texts` lists the texts and macros that only the new layout has, to which the user has agreed.
    """

    text: Text
    base: Base
    loses: Annotated[
        list[Annotated[str, msgspec.Meta(max_length=200)]], msgspec.Meta(max_length=1024)
    ]
    texts: Annotated[list[Text], msgspec.Meta(max_length=1024)] = []


class Clear(msgspec.Struct, tag_field="do", tag="clear", forbid_unknown_fields=True):
    """Request of a browser: restore the board's default layout."""


class Characters(msgspec.Struct, tag_field="do", tag="characters", forbid_unknown_fields=True):
    """Request of a browser: which characters the computer of a layout types."""

    host: str = ""
    os: str = ""


class LayoutEditor(FileEditor):
    """Validates key layouts from browsers, and stores them on the board and in a file.

    If the file does not exist, `usual` is the layout to begin with. The part ``editor`` of the
    state is set.
    """

    what = "the layout editor"
    requests = Check | Push | Clear | Characters

    def __init__(self, path: Path, usual: KeyLayout, state: PageState):
        self._sent: set[str] = set()  # checksums of layouts that this program sent to the board
        super().__init__(path, "layout", "editor", state, usual.text)

    def submit(self, request: Any) -> Future:
        """Answer a `Check` or `Characters` immediately, without a board; queue other requests."""
        if not isinstance(request, Characters):
            return super().submit(request)
        answer: Future = Future()
        self._answer(answer, self._characters, request)
        return answer

    def _characters(self, request: Characters) -> dict[str, Any]:
        system = request.os if request.os in hosts.SYSTEMS else hosts.BOTH
        host = hosts.host_of(request.host or hosts.AMERICAN, system)
        caps = {name_of(KEYBOARD, usage): host.cap(usage) for usage in hosts.KEYS}
        return {"characters": "".join(host.characters), "caps": caps}

    def _read(self, text: str) -> dict[str, Any]:
        return self._compiled(text).content

    def _compiled(self, text: str) -> KeyLayout:
        return compiled(self._name, text)

    def _use(self, text: str) -> None:
        layout = self._compiled(text)
        self._layout, self._draft, self.text = layout, None, text
        self._use_keys(layout)

    def _use_keys(self, layout: KeyLayout) -> None:
        """Use a layout, which is on the board, for the keys in the web UI."""
        self.strip_settings = {"layout": layout, "draft": lambda: self._draft}

    def _checked(self, text: str) -> dict[str, Any]:
        layout = self._compiled(text)
        self._draft = None if layout.lines == self._layout.lines else layout
        shown = {"content": layout.content, "problems": layout.problems}
        return {**shown, "loses": self._lost(layout)}

    def _handle(self, board: Board, request: Push | Clear) -> dict[str, Any] | None:
        if isinstance(request, Push):
            return self._push(request, board)
        try:
            ensured(board, "layout clear")
            ensured(board, "save")
        finally:
            # The file remains the layout that a later push replaces.
            info = self._show_board(board)
            if info and stored_layout(info, self._layout) == "default":
                self._use_keys(load(_DEFAULT))
        return None

    def _push(self, request: Push, board: Board) -> dict[str, Any]:
        info = board.command("hello")
        self._check_base(request.base, info)
        layout = self._compiled(request.text)
        loses = self._lost(layout)
        if stored_layout(info, self._layout) == "other" and info["layout"] not in self._sent:
            loses = [_UNKNOWN, *loses]
        texts = keys.new_texts(board, layout)
        if not set(loses) <= set(request.loses) or not set(texts) <= set(request.texts):
            return {"loses": loses, "texts": texts, "note": None}
        self._sent.add(checksum(layout.lines))
        pushed = False
        try:
            with self.file.replacing(request.text):
                note = keys.push(board, layout, expose=True).note
                pushed = True
        except SpotsError as error:
            why = getattr(error, "why", "")
            raise BoardError(self._outcome(board, layout, pushed, error), why) from None
        self._use(request.text)
        self._show_board(board)
        return {"loses": [], "texts": [], "note": note}

    def _outcome(self, board: Board, layout: KeyLayout, pushed: bool, error: SpotsError) -> str:
        """Return a message about a push that failed: what the board and the file have now."""
        info = self._show_board(board)
        if info is None:
            return (
                f"{error}; {self._name} is unchanged, and it is unknown which layout the board "
                "has: when the board is connected again, this window shows it"
            )
        if stored_layout(info, layout) != "this":
            return f"{error}; the layouts in {self._name} and on the board are unchanged"
        if pushed and self.file.changed:
            with suppress(SpotsError):
                self._take_change(info)
        self._use_keys(layout)
        if not pushed:
            return (
                f"{error}; the board has the new layout, perhaps only until it restarts, and "
                f"{self._name} is unchanged: press the button again"
            )
        return f"the board has the new layout, but {self._name} is unchanged: {error}"

    def _show_board(self, board: Board) -> Mapping[str, Any] | None:
        """Show which layout the board has; return its ``hello`` reply, None if it is silent."""
        try:
            info = board.command("hello")
        except SpotsError:
            info = None
        self._show(info)
        return info

    def _lost(self, layout: KeyLayout) -> list[str]:
        return [keys.say(layout, one) for one in sorted(self._layout.typed - layout.typed)]

    def _shown(self, info) -> dict[str, Any]:
        return {
            "content": self._layout.content,
            "stored": info and stored_layout(info, self._layout),
            "limits": {**LIMITS, "release_after_ms": RELEASE_AFTER_MS},
            "flavors": FLAVORS,
            "timing": timing_picture.pictures(),
            "hosts": list(hosts.every()),
            "systems": hosts.SYSTEMS,
        }


class Save(msgspec.Struct, tag_field="do", tag="save", forbid_unknown_fields=True):
    """Request of a browser: replace the file's old text, which has the checksum `base`."""

    text: Text
    base: Base


class Kind(NamedTuple):
    """A kind of settings file, such as the settings of the controller.

    `words` names the kind in error messages. `usual` is the file to begin with. The bounds of the
    fields of `table` are sent to browsers. ``read(text, path)`` returns the settings of a text, or
    raises SpotsError. `more` has further values for the web UI, such as the names of all gestures.
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

    `name` is a key of `KINDS`, and the name of the part of the state.
    """

    what = "the editor of settings"
    requests = Check | Save

    def __init__(self, name: str, path: Path, state: PageState):
        self._is = KINDS[name]
        usual = self._is.usual.read_text(encoding="utf-8")
        super().__init__(path, self._is.words, name, state, usual)

    def _read(self, text: str) -> dict[str, Any]:
        self._is.read(text, self._name)
        return toml.loads(text)

    def _use(self, text: str) -> None:
        self.strip_settings = {self._part: self._is.read(text, self._name)}
        self.text = text

    def _checked(self, text: str) -> dict[str, Any]:
        return {"content": self._read(text)}

    def _handle(self, board: Board, request: Save) -> None:
        self._check_base(request.base, board.info)
        self._read(request.text)
        try:
            with self.file.replacing(request.text):
                pass
        except ChangedError:
            self._take_change(board.info)
        except SpotsError as error:
            raise FileError(f"{error}; {self._name} is unchanged", self.file.path) from None
        self._use(request.text)
        self._show(board.info)

    def _shown(self, info: Any) -> dict[str, Any]:
        return {
            "content": toml.loads(self.text),
            "stored": None if info is None else self.file.path.exists(),
            "schema": msgspec.json.schema(self._is.table)["$defs"],
            **self._is.more,
        }
