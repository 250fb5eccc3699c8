"""Converts frames to JSON objects, whose keys are the column names of the exports."""

from __future__ import annotations

from typing import Any

import msgspec

from ..link.frames import Contact, Key, Reading, Spectrum

encode = msgspec.json.Encoder().encode  # NaN becomes null


def sample(frame: Reading, utc_s: float) -> dict[str, Any]:
    """Return the object to publish for a frame.

    Parameters
    ----------
    frame : Touch, Spectrum, Key or Contact
        The frame.
    utc_s : float
        Time of the measurement, in seconds since 1970.

    Returns
    -------
    dict
    """
    first = {"utc_s": utc_s, "sensor": frame.sensor, "sequence": frame.sequence, "t_us": frame.t_us}
    if isinstance(frame, Spectrum):
        return {**first, "flags": frame.flags, "gain_code": frame.gain, "counts": frame.counts}
    if isinstance(frame, Key):
        names = "page", "usage", "modifiers", "pressed"
    elif isinstance(frame, Contact):
        names = "id", "state", "position_um", "sigma_um", "force_mN"
    else:
        names = "touching", "trusted", "position_um", "force_mN"
        names += "contrast_log2", "brightness_log2", "flags"
    return first | {name: getattr(frame, name.removesuffix("_log2")) for name in names}
