"""A Zenoh session, the names of what is published there, and which boards are."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from typing import Any

import zenoh

from ..bounded import ZENOH_MAX_BYTES, read_bytes
from ..errors import SpotsError
from ..guarded import Guarded

# Zenoh's own name for where its configuration is.
CONFIG_VARIABLE = "ZENOH_CONFIG"
# The remote queries, and the key of each.
READ_ONLY = {"hello": "info", "get": "get", "sync": "sync"}

_NESTED_MAX = 1000  # tables and lists of a configuration; the longest one has some 150
_PATIENCE_S = 3.0
_OTHERS_S = 0.5  # so long after the first board others may still come
_FOUND_MAX = 16  # boards that are looked at; anyone may publish thousands of names


def key(board_id: str, *rest: str | int) -> str:
    """Return the name of something of a board: ``spots/<board>/…``.

    Parameters
    ----------
    board_id : str
        The board's id.
    *rest : str or int
        Further parts of the name.

    Returns
    -------
    str
    """
    return "/".join(("spots", board_id, *map(str, rest)))


def open_session() -> zenoh.Session:
    """Open a session as the file says that ZENOH_CONFIG names, else as Zenoh does by itself.

    Raises
    ------
    SpotsError
        If there is no such file, it is no configuration, or no session can be opened with it.
    """
    path = os.environ.get(CONFIG_VARIABLE)
    if path:
        _check_config(path)
    try:
        config = zenoh.Config.from_file(path) if path else zenoh.Config()
    except zenoh.ZError as error:
        raise SpotsError(f"{path} is no Zenoh configuration: {_first_line(error)}") from None
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        where = path or "its usual settings; --zenoh-config takes others"
        raise SpotsError(f"Zenoh does not start with {where}: {_first_line(error)}") from None


def _check_config(path: str) -> None:
    """Refuse what Zenoh's own reader would wait for, or end the program with."""
    try:
        text = read_bytes(path, ZENOH_MAX_BYTES)
    except OSError:
        raise SpotsError(
            f"there is no Zenoh configuration {path}: --zenoh-config or the variable ZENOH_CONFIG "
            "names one"
        ) from None
    if text.count(b"[") + text.count(b"{") > _NESTED_MAX:
        raise SpotsError(f"{path} is no Zenoh configuration: it is nested too deep")


def find(session: zenoh.Session, wanted: str) -> str:
    """Wait until a board is published and return its id.

    Parameters
    ----------
    session : zenoh.Session
    wanted : str
        The id; empty for the only board that there is.

    Returns
    -------
    str

    Raises
    ------
    SpotsError
        If no board is published in time, or there are several and none was named.
    """
    alive: set[str] = set()
    changed = threading.Condition()

    def note(sample: zenoh.Sample) -> None:
        with changed:
            board_id = str(sample.key_expr).split("/")[1]
            if sample.kind != zenoh.SampleKind.PUT:
                alive.discard(board_id)
            elif len(alive) < _FOUND_MAX:
                alive.add(board_id)
            changed.notify_all()

    tokens = key(wanted or "*", "alive")
    try:
        watch = session.liveliness().declare_subscriber(tokens, direct(note), history=True)
    except zenoh.ZError:
        raise SpotsError(f"'{wanted}' is no board's id: zenoh: alone takes the only one") from None
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
        raise SpotsError(f"{what} published on Zenoh: run 'spots publish' where it is plugged in")
    if len(found) > 1:
        names = ", ".join(f"zenoh:{board_id}" for board_id in found)
        raise SpotsError(f"more than one board is published, name one of: {names}")
    return found[0]


def direct(callback: Callable[[Any], None]) -> zenoh.handlers.Callback:
    """Return a handler that runs in Zenoh's own threads.

    The usual one starts a thread of Python, for which a program would wait at its end if a board
    was not closed. The callback must not wait, nor call Zenoh. An exception in it is reported as
    one sentence, and the next message is taken.
    """
    guarded = Guarded(callback, "taking what came from Zenoh")
    return zenoh.handlers.Callback(guarded, indirect=False)


def is_published(session: zenoh.Session, board_id: str) -> bool:
    """Return whether someone publishes a board, as far as the session knows yet.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    board_id : str
        The board's id.

    Returns
    -------
    bool
    """
    return any(reply.ok for reply in session.liveliness().get(key(board_id, "alive")))


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0].split(" at ")[0].rstrip(". ")
