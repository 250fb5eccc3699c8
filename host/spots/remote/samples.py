"""A frame as an object that any language can read; the names are those of the exports."""

from __future__ import annotations

from typing import Any

import msgspec

from ..link.frames import Reading
from ..recording.table import values

encode = msgspec.json.Encoder().encode  # NaN becomes null


def sample(frame: Reading, utc_s: float) -> dict[str, Any]:
    """Return the object that is published for a frame.

    Parameters
    ----------
    frame : Touch, Spectrum or Key
        The frame.
    utc_s : float
        Time of the measurement, in seconds since 1970.

    Returns
    -------
    dict
    """
    first = {"utc_s": utc_s, "sensor": frame.sensor, "sequence": frame.sequence, "t_us": frame.t_us}
    return first | values(frame)
