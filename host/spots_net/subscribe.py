"""``spots subscribe``: prints the messages of boards that ``spots publish`` publishes."""

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import cache, lru_cache
from typing import Any

import msgspec
import numpy as np

from spots.errors import SettingError, printable
from spots.link.frames import Touch
from spots.terminal.monitor import PLAIN_LINES_PER_S
from spots.terminal.view import Pace, plain

from .mailbox import Mailbox
from .optional import zenoh
from .options import configure
from .ros2.messages import DIAGNOSTICS, types
from .ros2.naming import ros_domain, short_name
from .ros2.types import own, store, topic
from .zenoh_session import direct, open_session

_NAMES_MAX = 256  # number of topics whose rate is limited separately
_PACED = own("Reading"), own("Spectrum"), own("Contact"), types()["wrench"], types()["point"]
_WAIT_S = 1.0  # Python sees a Ctrl-C that comes just before a wait at the end of this wait
_MESSAGE_BYTES_MAX = 1 << 13  # a longer message is none of a publisher
# Fields of a message that a line omits.
_NOT_SHOWN = {"utc_s", "frame_id", "stamp_error_s", "sequence", "t_us", "channels", "dark"}


def subscribe_command(options: argparse.Namespace) -> None:
    """Run ``spots subscribe`` with the options that `cli` parsed."""
    expression = _expression(options.topics, ros_domain())
    kinds = _kinds()
    mail = Mailbox()

    def receive(sample: zenoh.Sample) -> None:
        # In a network of ROS, messages of all types may have such a topic.
        if _ending(str(sample.key_expr)) in kinds:
            mail.put(str(sample.key_expr), sample.payload)

    written = _as_json if options.json else _Lines().written
    configure(options)
    with open_session() as session:
        session.declare_subscriber(expression, direct(receive))
        listening = f"listening to {printable(options.topics)} (Ctrl-C ends it)"
        print(listening, file=sys.stderr, flush=True)
        try:
            _print(mail, written, options.seconds)
        except KeyboardInterrupt:
            pass
        finally:
            if mail.dropped:
                why = "too many to print in time, or too long"
                print(f"{mail.dropped} messages dropped: {why}", file=sys.stderr)


def _ending(key: str) -> str:
    """Return the type and the type's hash, which are the end of the key of a topic."""
    return "/".join(key.split("/")[-2:])


@cache
def _kinds() -> dict[str, str]:
    """Return the types that are printed, by `_ending`."""
    known = {*types().values(), DIAGNOSTICS}
    return {_ending(topic("", kind).key(0)): kind for kind in known}


def _expression(topics: str, domain: int) -> zenoh.KeyExpr:
    """Return the Zenoh key expression of a topic in which ``*`` stands for any text."""
    wrong = SettingError(
        f"'{topics}' is not a topic of ROS 2: give one such as /spots_*/strip0/reading"
    )
    if not topics.startswith("/"):
        raise wrong
    chunks = topics[1:].split("/")
    # In Zenoh, a part of a chunk is $*. A topic is followed by its type and the type's hash.
    wild = [one if one in ("*", "**") else one.replace("*", "$*") for one in chunks]
    try:
        return zenoh.KeyExpr.autocanonize("/".join((str(domain), *wild, "*", "*")))
    except zenoh.ZError:
        raise wrong from None


def _print(mail: Mailbox, written: Callable[[str, str, Any], str], seconds: float | None) -> None:
    end_s = math.inf if seconds is None else time.monotonic() + seconds
    while (left_s := end_s - time.monotonic()) > 0:
        with mail.changed:
            mail.changed.wait_for(lambda: mail, min(left_s, _WAIT_S))
        while mail:
            key, data = mail.take()
            text = _text(written, key, data)
            if text is None:
                print(f"{printable(key)}: not a valid message", file=sys.stderr)
            elif text:
                print(text, flush=True)


def _text(written: Callable[[str, str, Any], str], key: str, data: bytes) -> str | None:
    """Return the line to print for a message of an untrusted sender.

    The line is empty if the message is not shown, None if the message is invalid. ``written(topic,
    kind, message)`` formats a message.
    """
    if len(data) > _MESSAGE_BYTES_MAX:
        return None
    try:
        kind = _kinds()[_ending(key)]
        name = "/" + "/".join(key.split("/")[1:-2])
        return printable(written(name, kind, store().deserialize_cdr(data, kind)))
    except Exception:  # anyone may publish anything under such a key
        return None


def _as_json(topic: str, kind: str, message: Any) -> str:
    known = msgspec.json.decode(msgspec.json.encode(_content(message)))  # NaN becomes null
    return json.dumps({"topic": topic, **known})  # in ASCII


def _content(message: Any) -> dict[str, Any]:
    """Return the fields of a message; those of its header become ``utc_s`` and ``frame_id``."""
    found = _plain(message)
    header = found.pop("header", None)
    if header is None:
        return found
    stamp = header["stamp"]
    utc_s = stamp["sec"] + 1e-9 * stamp["nanosec"]
    return {"utc_s": utc_s, "frame_id": header["frame_id"], **found}


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, list):
        return [_plain(one) for one in value]
    if hasattr(value, "__dataclass_fields__"):
        return {one.name: _plain(getattr(value, one.name)) for one in fields(value)}
    return value


class _Lines:
    """Formats the messages of published boards as lines of text; limits the rate of readings."""

    def __init__(self):
        self._began_s = time.time()
        # Anyone may publish under thousands of keys: the least recently used ones are dropped.
        self._pace = lru_cache(_NAMES_MAX)(lambda name: Pace(PLAIN_LINES_PER_S))

    def written(self, topic: str, kind: str, message: Any) -> str:
        if kind in _PACED and not self._pace(topic).due(time.monotonic()):
            return ""
        content = _content(message)
        utc_s = content["utc_s"]
        if kind == DIAGNOSTICS:
            (status,) = content["status"]
            node = status["name"].partition(":")[0]
            shown: Mapping = {one["key"]: one["value"] for one in status["values"]}
            name = f"link  {status['message']}"
        else:
            node, name = topic.split("/")[1], topic.rpartition("/")[2]
            shown = {name: one for name, one in content.items() if name not in _NOT_SHOWN}
        board = short_name(node)
        if kind == own("Reading"):
            place, force = 1e6 * message.position_m, 1e3 * message.force_n
            touch = Touch(0, 0, 0, message.flags, 0, 0, place, force, utc_s)
            return f"{board}  {plain(touch, self._began_s)}"
        fields = "  ".join(f"{name} {one}" for name, one in shown.items())
        return f"{board}  {utc_s - self._began_s:8.3f} s  {name}  {fields}"
