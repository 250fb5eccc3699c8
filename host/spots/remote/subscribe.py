"""``spots subscribe``: prints what boards publish, as any program without this one could."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import defaultdict

import msgspec
import zenoh

from ..errors import SpotsError
from ..frames import Touch
from ..view import Pace, plain
from ..watch import PLAIN_LINES_PER_S
from .mailbox import Mailbox
from .publish import FRAMES_ENCODING
from .session import direct, open_session

EVERYTHING = "spots/**"


def run(options: argparse.Namespace) -> None:
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
            mail.put(str(sample.key_expr), bytes(sample.payload))

    show = _as_json if options.json else _Lines().show
    with open_session() as session:
        session.declare_subscriber(expression, direct(receive))
        print(f"listening to {expression} (Ctrl-C ends it)", file=sys.stderr, flush=True)
        try:
            _print(mail, show, options.seconds)
        except KeyboardInterrupt:
            pass
        finally:
            if mail.dropped:
                print(f"{mail.dropped} messages dropped: printing is too slow", file=sys.stderr)


def _print(mail: Mailbox, show, seconds: float | None) -> None:
    end_s = None if seconds is None else time.monotonic() + seconds
    while end_s is None or time.monotonic() < end_s:
        with mail.changed:
            left_s = None if end_s is None else end_s - time.monotonic()
            mail.changed.wait_for(lambda: mail, left_s)
        while mail:
            name, data = mail.take()
            try:
                show(name, msgspec.json.decode(data, type=dict))
            except (msgspec.DecodeError, KeyError, TypeError):
                print(f"{name}: none of ours", file=sys.stderr)


def _as_json(name: str, content: dict) -> None:
    print(json.dumps({"key": name, **content}), flush=True)


class _Lines:
    """A line for a person, of readings and spectra not more than one can read."""

    def __init__(self):
        self._began_s = time.time()
        self._paces: dict[str, Pace] = defaultdict(lambda: Pace(PLAIN_LINES_PER_S))

    def show(self, name: str, content: dict) -> None:
        _, board_id, *rest = name.split("/")
        kind = rest[-1]
        if kind in ("touch", "spectrum") and not self._paces[name].due(time.monotonic()):
            return
        if kind == "touch":
            text = plain(_touch(content), self._began_s)
        else:
            text = f"{content['utc_s'] - self._began_s:8.3f} s  {kind}  " + "  ".join(
                f"{name} {value}" for name, value in content.items() if name not in _ELSEWHERE
            )
        print(f"{board_id}  {text}", flush=True)


_ELSEWHERE = {"utc_s", "sensor", "sequence", "t_us"}


def _touch(content: dict) -> Touch:
    return Touch(
        content["sensor"],
        content["sequence"],
        content["t_us"],
        content["flags"],
        round(content["contrast_log2"] * (1 << 20)),
        round(content["brightness_log2"] * (1 << 20)),
        content["position_um"],
        content["force_mN"],
        content["utc_s"],
    )
