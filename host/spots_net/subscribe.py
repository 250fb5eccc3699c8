"""``spots subscribe``: prints the JSON messages of boards that ``spots publish`` publishes."""

import argparse
import json
import math
import sys
import threading
import time
from collections.abc import Callable
from functools import lru_cache

from spots.errors import SettingError, printable
from spots.link.frames import Touch
from spots.link.replies import decoded
from spots.terminal.monitor import PLAIN_LINES_PER_S
from spots.terminal.view import Pace, plain

from .mailbox import Mailbox
from .optional import zenoh
from .port import configure
from .publish import FRAMES_ENCODING
from .zenoh_session import direct, key, open_session

_NAMES_MAX = 256  # number of Zenoh keys whose rate is limited separately
_NOT_SHOWN = {"utc_s", "sensor", "sequence", "t_us"}  # keys of a message that a line omits


def subscribe_command(options: argparse.Namespace) -> None:
    """Run ``spots subscribe`` with the options that `cli` parsed."""
    try:
        expression = zenoh.KeyExpr(options.expression)
    except zenoh.ZError:
        raise SettingError(
            f"'{options.expression}' is not a key expression of Zenoh: give one such as "
            "spots/*/0/touch"
        ) from None
    if not expression.intersects(key("**")):
        raise SettingError(
            f"no board publishes as '{options.expression}': give a key expression such as "
            "spots/*/0/touch"
        )
    mail = Mailbox()

    def receive(sample: zenoh.Sample) -> None:
        if str(sample.encoding) != FRAMES_ENCODING:
            mail.put(str(sample.key_expr), sample.payload)

    written = _as_json if options.json else _Lines().written
    configure(options)
    with open_session() as session:
        session.declare_subscriber(expression, direct(receive))
        listening = f"listening to {printable(str(expression))} (Ctrl-C ends it)"
        print(listening, file=sys.stderr, flush=True)
        try:
            _print(mail, written, options.seconds)
        except KeyboardInterrupt:
            pass
        finally:
            if mail.dropped:
                why = "too many to print in time, or too long"
                print(f"{mail.dropped} messages dropped: {why}", file=sys.stderr)


def _print(mail: Mailbox, written: Callable[[str, dict], str], seconds: float | None) -> None:
    end_s = math.inf if seconds is None else time.monotonic() + seconds
    while (left_s := end_s - time.monotonic()) > 0:
        with mail.changed:
            mail.changed.wait_for(lambda: mail, min(left_s, threading.TIMEOUT_MAX))
        while mail:
            name, data = mail.take()
            text = _text(written, name, data)
            if text is None:
                print(f"{printable(name)}: not a SPOTS message", file=sys.stderr)
            elif text:
                print(text, flush=True)


def _text(written: Callable[[str, dict], str], name: str, data: bytes) -> str | None:
    """Return the line to print for a message.

    Parameters
    ----------
    written : callable
        ``written(name, content)`` formats a message.
    name : str
        Zenoh key of the message.
    data : bytes
        JSON text of the message, from an untrusted sender.

    Returns
    -------
    str or None
        The line; empty if the message is not shown, None if the message is invalid.
    """
    try:
        return printable(written(name, decoded(data)))
    except Exception:  # anyone may publish anything under such a key
        return None


def _as_json(name: str, content: dict) -> str:
    return json.dumps({"key": name, **content})


class _Lines:
    """Formats the messages of published boards as lines of text; limits the rate of readings."""

    def __init__(self):
        self._began_s = time.time()
        # Anyone may publish under thousands of keys: the least recently used ones are dropped.
        self._pace = lru_cache(_NAMES_MAX)(lambda name: Pace(PLAIN_LINES_PER_S))

    def written(self, name: str, content: dict) -> str:
        _, board_id, *rest = name.split("/")
        kind = rest[-1]
        if kind in ("touch", "spectrum", "contact") and not self._pace(name).due(time.monotonic()):
            return ""
        if kind == "touch":
            # An unknown value is null; a line does not show contrast and brightness.
            known = {name: math.nan if one is None else one for name, one in content.items()}
            place, force, utc_s = (known[name] for name in ("position_um", "force_mN", "utc_s"))
            touch = Touch(0, 0, 0, known["flags"], 0, 0, place, force, utc_s)
            return f"{board_id}  {plain(touch, self._began_s)}"
        shown = (f"{name} {one}" for name, one in content.items() if name not in _NOT_SHOWN)
        return f"{board_id}  {content['utc_s'] - self._began_s:8.3f} s  {kind}  {'  '.join(shown)}"
