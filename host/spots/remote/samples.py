"""A frame as an object that any language reads; the names are those of the exports."""

from __future__ import annotations

import msgspec

from ..link.frames import Frame
from ..recording.table import TABLES

encode = msgspec.json.Encoder().encode


def sample(frame: Frame, utc_s: float) -> dict:
    """Return what is published of a reading, a spectrum or a key.

    Parameters
    ----------
    frame : Frame
    utc_s : float
        When it was measured, since 1970.
    """
    table = TABLES[type(frame)]
    first = utc_s, frame.sensor, frame.sequence, frame.t_us
    return dict(zip(_NAMES[table.name], first + table.rest(frame)))


_NAMES = {
    table.name: ("utc_s", *(name for name in table.columns if name not in ("time_s", "arrived_s")))
    for table in TABLES.values()
}
