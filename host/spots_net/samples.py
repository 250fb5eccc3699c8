"""Converts frames to dicts for JSON; keys are ``utc_s`` and columns of ``spots export``."""

from typing import Any

import msgspec

from spots.link.frames import Reading
from spots.recording.table import VALUES

encode = msgspec.json.Encoder().encode  # NaN becomes null
_FIRST = "sensor", "sequence", "t_us"
# Fields of frames whose names differ from those of their columns, by column.
_FIELDS = {"contrast_log2": "contrast", "brightness_log2": "brightness", "gain_code": "gain"}


def sample(frame: Reading, utc_s: float) -> dict[str, Any]:
    """Return the dict that is published as JSON for a frame.

    Parameters
    ----------
    frame : Touch, Spectrum, Key or Contact
        The frame.
    utc_s : float
        Time of the measurement, in seconds since 1970.

    Returns
    -------
    dict
        ``utc_s``, ``sensor``, ``sequence``, ``t_us``, and the values in `recording.table.VALUES`.
    """
    names = (*_FIRST, *VALUES[type(frame).__name__.lower()])
    return {"utc_s": utc_s} | {name: getattr(frame, _FIELDS.get(name, name)) for name in names}
