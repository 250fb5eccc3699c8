"""Converts frames and the state of a board to messages of ROS 2."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from spots.link.board import Board
from spots.link.timeouts import CONNECTED

from .types import FRAME, own, store

_WRENCH = "geometry_msgs/msg/WrenchStamped"
POINT = "geometry_msgs/msg/PointStamped"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
UNKNOWN_DARK = (math.nan,) * 6
_UNKNOWN_ERROR_S = 1.0  # a larger error of a time is no knowledge
Message = tuple[str, Any]
_TYPES = {
    "wrench": _WRENCH,
    "point": POINT,
    "reading": own("Reading"),
    "contact": own("Contact"),
    "spectrum": own("Spectrum"),
    "key": own("Key"),
}
# Topics with messages for a frame, by kind of frame.
TOPICS: Mapping[str, Sequence[str]] = {
    "touch": ("reading", "wrench", "point"),
    "contact": ("contact",),
    "spectrum": ("spectrum",),
    "key": ("key",),
}


class Strip(NamedTuple):
    """What messages of a strip contain besides its frames.

    In the coordinate frame `frame_id`, x is along the strip from the sensor's end, and z out of it.
    `channels` are the names of the six ADCs' channels, `dark` their dark counts; NaN if unknown.
    """

    frame_id: str
    channels: Sequence[str]
    exposure_us: int
    dark: Sequence[float]


def types() -> dict[str, str]:
    """Return the type of each topic of a strip, by the last part of the topic's name."""
    return dict(_TYPES)


def messages(
    kind: str, values: dict[str, Any], utc_s: float, error_s: float, strip: Strip
) -> Iterator[Message]:
    """Yield the messages for a frame, with the last part of their topics' names.

    A touch is a ``reading``. Unless it is untrusted, it is also a ``wrench``, which is zero without
    a touch, and with a touch a ``point``. `kind` is the frame's table in `spots.recording.table`;
    the values are those of `spots_net.sending.values`. `error_s` is the largest error of the time
    `utc_s` by the board's clock; NaN or infinite if unknown.
    """
    made = store().types
    head = header(utc_s, strip.frame_id)
    first = values["sequence"], values["t_us"]
    if kind == "touch":
        touching, trusted = values["touching"], values["trusted"]
        position_m, force_n = values["position_um"] / 1e6, values["force_mN"] / 1e3
        sigma_m = values["sigma_um"] / 1e6
        measured = position_m, sigma_m, force_n, values["contrast_log2"], values["brightness_log2"]
        flags = values["flags"], touching, trusted
        if not error_s < _UNKNOWN_ERROR_S:
            error_s = math.nan
        yield "reading", made[own("Reading")](head, error_s, *first, *flags, *measured)
        vector, point = made["geometry_msgs/msg/Vector3"], made["geometry_msgs/msg/Point"]
        if trusted or not touching:
            # The finger pushes into the strip.
            push = vector(0.0, 0.0, -force_n if touching else 0.0)
            wrench = made["geometry_msgs/msg/Wrench"](push, vector(0.0, 0.0, 0.0))
            yield "wrench", made[_WRENCH](head, wrench)
        if trusted:
            yield "point", made[POINT](head, point(position_m, 0.0, 0.0))
    elif kind == "contact":
        place = (values[name] / 1e6 for name in ("position_um", "sigma_um"))
        which = values["id"], values["state"]
        force_n = values["force_mN"] / 1e3
        yield "contact", made[own("Contact")](head, *first, *which, *place, force_n)
    elif kind == "spectrum":
        counts = np.array(values["counts"], np.uint16)
        dark = np.array(strip.dark, np.float32)
        how = 0.5 * 2 ** values["gain_code"], strip.exposure_us, list(strip.channels)
        flags = values["flags"]
        yield "spectrum", made[own("Spectrum")](head, *first, flags, *how, counts, dark)
    elif kind == "key":
        pressed = (values[name] for name in ("page", "usage", "modifiers", "pressed"))
        yield "key", made[own("Key")](head, *first, *pressed)


def frame_message(data: bytes, restarts: int) -> Any:
    """Return the message `FRAME` for whole frames that a board has sent."""
    return store().types[FRAME](restarts, np.frombuffer(data, np.uint8))


def diagnostics(board: Board, node: str, utc_s: float) -> Any:
    """Return the message `DIAGNOSTICS`, with a board's state and the counters of its link.

    rqt_robot_monitor shows it.
    """
    made = store().types
    status = made["diagnostic_msgs/msg/DiagnosticStatus"]
    pair = made["diagnostic_msgs/msg/KeyValue"]
    level = status.OK if board.state == CONNECTED else status.ERROR
    counters = [pair(name, str(count)) for name, count in asdict(board.stats).items()]
    one = status(level, f"{node}: link", board.state, board.info["id"], counters)
    return made[DIAGNOSTICS](header(utc_s, ""), [one])


def header(utc_s: float, frame_id: str) -> Any:
    """Return the header of a message, with a time in seconds since 1970."""
    made = store().types
    stamp = made["builtin_interfaces/msg/Time"](*divmod(round(1e9 * utc_s), 10**9))
    return made["std_msgs/msg/Header"](stamp, frame_id)
