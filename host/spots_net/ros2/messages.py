"""Converts frames to messages of ROS 2."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from .types import own, store

_WRENCH, _POINT = "geometry_msgs/msg/WrenchStamped", "geometry_msgs/msg/PointStamped"
UNKNOWN_DARK = (float("nan"),) * 6
Message = tuple[str, Any]
_TYPES = {
    "wrench": _WRENCH,
    "point": _POINT,
    "reading": own("Reading"),
    "contact": own("Contact"),
    "spectrum": own("Spectrum"),
}


class Strip(NamedTuple):
    """What messages of a strip contain besides its frames.

    Attributes
    ----------
    frame_id : str
        Coordinate frame of the messages: x along the strip from the sensor's end, z out of it.
    channels : sequence of str
        Names of the channels of the six ADCs.
    exposure_us : int
        Integration time in us.
    dark : sequence of float
        Six dark counts; NaN if unknown.
    """

    frame_id: str
    channels: Sequence[str]
    exposure_us: int
    dark: Sequence[float]


def types() -> dict[str, str]:
    """Return the type of each topic, by the last part of the topic's name."""
    return dict(_TYPES)


def messages(kind: str, values: dict[str, Any], utc_s: float, strip: Strip) -> Iterator[Message]:
    """Yield the messages for a frame, with the last part of their topics' names.

    A touch is a ``reading``. Unless it is untrusted, it is also a ``wrench``, which is zero without
    a touch, and with a touch a ``point``. Presses of keys have no message.

    Parameters
    ----------
    kind : str
        Name of the frame's table in `spots.recording.table`.
    values : dict
        Values by column, as `spots_net.outlet.values` returns them.
    utc_s : float
        Time of the measurement, in seconds since 1970.
    strip : Strip
        The strip that the frame is of.

    Yields
    ------
    tuple of str and message
        The messages have the types that `types` returns.
    """
    made = store().types
    stamp = made["builtin_interfaces/msg/Time"](*divmod(round(1e9 * utc_s), 10**9))
    header = made["std_msgs/msg/Header"](stamp, strip.frame_id)
    first = values["sequence"], values["t_us"]
    if kind == "touch":
        touching, trusted = values["touching"], values["trusted"]
        position_m, force_n = values["position_um"] * 1e-6, values["force_mN"] * 1e-3
        measured = position_m, force_n, values["contrast_log2"], values["brightness_log2"]
        flags = values["flags"], touching, trusted
        yield "reading", made[own("Reading")](header, *first, *flags, *measured)
        vector, point = made["geometry_msgs/msg/Vector3"], made["geometry_msgs/msg/Point"]
        if trusted or not touching:
            # The finger pushes into the strip.
            push = vector(0.0, 0.0, -force_n if touching else 0.0)
            wrench = made["geometry_msgs/msg/Wrench"](push, vector(0.0, 0.0, 0.0))
            yield "wrench", made[_WRENCH](header, wrench)
        if trusted:
            yield "point", made[_POINT](header, point(position_m, 0.0, 0.0))
    elif kind == "contact":
        place = (values[name] * 1e-6 for name in ("position_um", "sigma_um"))
        which = values["id"], values["state"]
        force_n = values["force_mN"] * 1e-3
        yield "contact", made[own("Contact")](header, *first, *which, *place, force_n)
    elif kind == "spectrum":
        counts = np.array(values["counts"], np.uint16)
        dark = np.array(strip.dark, np.float32)
        how = 0.5 * 2 ** values["gain_code"], strip.exposure_us, list(strip.channels)
        flags = values["flags"]
        yield "spectrum", made[own("Spectrum")](header, *first, flags, *how, counts, dark)
