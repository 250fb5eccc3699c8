"""Opens a Zenoh session, and finds published boards."""

import os
import threading
from collections.abc import Callable
from typing import Any

from spots.common import kinds
from spots.common.bounded import ZENOH_MAX_BYTES, read_bytes
from spots.common.guarded import Guarded
from spots.errors import FileError, PortError, RequirementError, SettingError

from .optional import zenoh
from .ros2.naming import is_name, node_of, short_name
from .ros2.types import FRAME, topic

# The environment variable with the path of Zenoh's configuration; Zenoh's own name.
CONFIG_VARIABLE = "ZENOH_CONFIG"
READ_ONLY = "hello", "get", "sync"  # commands whose replies a publisher returns

_WANTED = "a Zenoh configuration"
_NESTED_MAX = 1000  # objects and lists in a configuration; the longest example has about 150
_PATIENCE_S = 3.0  # longest wait for the first published board
_OTHERS_S = 0.5  # time for other boards to appear after the first one
_FOUND_MAX = 16  # boards that are listed; anyone may publish under thousands of ids


def open_session() -> zenoh.Session:
    """Open a session with the configuration file that ZENOH_CONFIG names, or with the defaults.

    FileError if the file is missing or invalid, RequirementError if no session can be opened.
    """
    path = os.environ.get(CONFIG_VARIABLE)
    if path:
        _check_config(path)
    try:
        config = zenoh.Config.from_file(path) if path else zenoh.Config()
    except zenoh.ZError as error:
        raise FileError(
            f"{path} is not a Zenoh configuration ({_first_line(error)}): name another file", path
        ) from None
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        what = path or "its default configuration"
        raise RequirementError(
            f"Zenoh does not start with {what}: {_first_line(error)}; name another configuration "
            "with --zenoh-config"
        ) from None


def _check_config(path: str) -> None:
    """Raise FileError for a file on which Zenoh's own parser would block or crash."""
    try:
        text = read_bytes(path, ZENOH_MAX_BYTES)
    except FileNotFoundError:
        raise FileError(
            f"cannot read the Zenoh configuration {path}, because there is no such file: name the "
            "file with --zenoh-config or the variable ZENOH_CONFIG",
            path,
        ) from None
    except OSError as error:
        raise kinds.not_read(path, error, _WANTED) from None
    kinds.check(path, text, _WANTED)
    if text.count(b"[") + text.count(b"{") > _NESTED_MAX:
        raise FileError(
            f"{path} is not a Zenoh configuration (nested too deep): name another file", path
        )


def find(session: zenoh.Session, wanted: str, domain: int) -> str:
    """Wait until a board is published, and return the name of its node.

    `wanted` is the id of the board, or the name of the node; empty for the only published board.
    PortError if the board is not published within 3 s, or if several boards are published and
    `wanted` is empty; SettingError if it cannot be a name.
    """
    if wanted and not is_name(wanted):
        raise SettingError(
            f"'{wanted}' is not a board's id: give zenoh:ID, or zenoh: for the only board"
        )
    alive: set[str] = set()
    changed = threading.Condition()

    def note(sample: zenoh.Sample) -> None:
        name = node_of(str(sample.key_expr))
        if not is_name(name) or wanted not in ("", name, short_name(name)):
            return
        with changed:
            if sample.kind != zenoh.SampleKind.PUT:
                alive.discard(name)
            elif len(alive) < _FOUND_MAX:
                alive.add(name)
            changed.notify_all()

    tokens = topic("", FRAME).tokens(domain, "*")
    watch = session.liveliness().declare_subscriber(tokens, direct(note), history=True)
    try:
        with changed:
            changed.wait_for(lambda: alive, _PATIENCE_S)
            if not wanted:
                changed.wait_for(lambda: len(alive) > 1, _OTHERS_S)
            found = sorted(alive)
    finally:
        watch.undeclare()
    if not found:
        what = f"no board {wanted} is" if wanted else "no board is"
        raise PortError(
            f"{what} published on Zenoh: run 'spots publish' on the machine of the board"
        )
    if len(found) > 1:
        names = ", ".join(f"zenoh:{short_name(name)}" for name in found)
        raise PortError(f"more than one board is published: give one of these: {names}")
    return found[0]


def direct(callback: Callable[[Any], None]) -> zenoh.handlers.Callback:
    """Return a handler that calls a function in Zenoh's own threads.

    Zenoh's usual handler starts a Python thread, which blocks the exit of a program that has not
    closed its board. The function must neither wait nor call Zenoh. An exception in the function is
    reported in one line; the handler continues with the next message.
    """
    guarded = Guarded(callback, "the handler of Zenoh messages")
    return zenoh.handlers.Callback(guarded, indirect=False)


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0].split(" at ")[0].rstrip(". ")
