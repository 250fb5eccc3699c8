"""``spots subscribe``: prints what boards publish, as any program without this one could."""

from __future__ import annotations

import argparse
import json
import sys
import time
from functools import lru_cache

import zenoh

from ..errors import SpotsError, printable
from ..link.frames import Touch
from ..link.replies import decoded
from ..terminal.monitor import PLAIN_LINES_PER_S
from ..terminal.view import Pace, plain
from .mailbox import Mailbox
from .publish import FRAMES_ENCODING
from .zenoh_session import direct, open_session

_NAMES_MAX = 256


def subscribe_command(options: argparse.Namespace) -> None:
    """Run ``spots subscribe`` with the options that `cli` parsed."""
    try:
        expression = zenoh.KeyExpr(options.expression)
    except zenoh.ZError:
        raise SpotsError(
            f"'{options.expression}' is no key expression, such as spots/*/0/touch"
        ) from None
    mail = Mailbox()

    def receive(sample: zenoh.Sample) -> None:
        if str(sample.encoding) != FRAMES_ENCODING:
            mail.put(str(sample.key_expr), sample.payload)

    written = _as_json if options.json else _Lines().written
    with open_session() as session:
        session.declare_subscriber(expression, direct(receive))
        print(
            f"listening to {printable(str(expression))} (Ctrl-C ends it)",
            file=sys.stderr,
            flush=True,
        )
        try:
            _print(mail, written, options.seconds)
        except KeyboardInterrupt:
            pass
        finally:
            if mail.dropped:
                print(f"{mail.dropped} messages dropped: printing is too slow", file=sys.stderr)


def _print(mail: Mailbox, written, seconds: float | None) -> None:
    end_s = None if seconds is None else time.monotonic() + seconds
    while end_s is None or time.monotonic() < end_s:
        with mail.changed:
            left_s = None if end_s is None else end_s - time.monotonic()
            mail.changed.wait_for(lambda: mail, left_s)
        while mail:
            name, data = mail.take()
            text = _text(written, name, data)
            if text is None:
                print(f"{printable(name)}: not a SPOTS message", file=sys.stderr)
            elif text:
                print(text, flush=True)


def _text(written, name: str, data: bytes) -> str | None:
    """Return a message as a line, empty if it is not to be shown, or None if it is invalid."""
    try:
        return printable(written(name, decoded(data)))
    except Exception:  # anyone may publish anything under such a name
        return None


def _as_json(name: str, content: dict) -> str:
    return json.dumps({"key": name, **content})


class _Lines:
    """A line for a person, of readings and spectra not more than one can read."""

    def __init__(self):
        self._began_s = time.time()
        # Anyone may publish thousands of names: the least recently used are forgotten.
        self._pace = lru_cache(_NAMES_MAX)(lambda name: Pace(PLAIN_LINES_PER_S))

    def written(self, name: str, content: dict) -> str:
        _, board_id, *rest = name.split("/")
        kind = rest[-1]
        if kind in ("touch", "spectrum") and not self._pace(name).due(time.monotonic()):
            return ""
        if kind == "touch":
            text = plain(_touch(content), self._began_s)
        else:
            text = f"{content['utc_s'] - self._began_s:8.3f} s  {kind}  " + "  ".join(
                f"{name} {value}" for name, value in content.items() if name not in _ELSEWHERE
            )
        return f"{board_id}  {text}"


_ELSEWHERE = {"utc_s", "sensor", "sequence", "t_us"}


def _touch(content: dict) -> Touch:
    return Touch(
        content["sensor"],
        content["sequence"],
        content["t_us"],
        content["flags"],
        round(float(content["contrast_log2"]) * (1 << 20)),
        round(float(content["brightness_log2"]) * (1 << 20)),
        content["position_um"],
        content["force_mN"],
        content["utc_s"],
    )
