"""Reads a recording as a table of pandas."""

from pathlib import Path
from typing import Any

import numpy as np

from spots_device.reading import decode
from spots_device.sensor.smux import CHANNELS

from ..errors import SettingError, did_you_mean, missing
from ..link.frames import DOUBTFUL, force_known, log2_unknown
from .arrays import Arrays, RecordingBlocks
from .table import VALUES, Description, described, tables

_NO_VALUE = float("nan")


def read_dataframe(path: str | Path, kind: str = "touch") -> Any:
    """Read the frames of one kind from a recording as a `pandas.DataFrame`.

    The columns are those of the exports, with units in their names; the six counts of a spectrum
    have the names of their channels, such as ``counts_F3``. What is unknown is NaN, so that means
    and plots leave it out: the position without a press, position and force while the LED is off.
    ``time_s`` counts from the beginning of the recording. ``mark`` is the text of the last mark
    before the row, see `Board.mark`; it is empty before the first one.

    Parameters
    ----------
    path : str or Path
        File of the recording. If this is the first of several files of one recording, the other
        files are read too.
    kind : str, optional
        ``touch``, ``spectrum``, ``key``, ``contact``, ``text`` or ``mark``.

    Returns
    -------
    pandas.DataFrame

    Raises
    ------
    FileError
        If the recording cannot be read.
    SettingError
        If there is no such kind.
    RequirementError
        If pandas is missing.

    Examples
    --------
    >>> table = spots.read_dataframe("run.spots")
    >>> int(table.position_um.isna().sum()), round(float(table.force_mN.max()))
    (62, 3527)
    """
    try:
        import pandas as pd
    except ImportError:
        raise missing("a table of pandas needs", "pandas", "export") from None
    if kind not in VALUES:
        raise SettingError(f"there is no kind {kind!r}: {did_you_mean(kind, list(VALUES))}")
    recording = RecordingBlocks(path)
    description = described(recording)
    begun_s = description.header.host_s
    table = next(one for one in tables(description.channels) if one.name == kind)
    parts = [_columns(kind, block, begun_s, description) for block in recording]
    names = [*table.dtype.names]
    if kind != "mark":
        names.append("mark")
    joined = {name: np.concatenate([part[name] for part in parts]) for name in names[:-1]}
    marks = sorted((one.time_s - begun_s, one.text) for one in recording.marks)
    if kind == "mark":
        joined["mark"] = np.array([text for _, text in marks], object)
    else:
        texts = np.array(["", *(text for _, text in marks)], object)
        joined["mark"] = texts[np.searchsorted([at for at, _ in marks], joined["time_s"], "right")]
    return pd.DataFrame(joined)


def _columns(kind: str, block: Arrays, begun_s: float, about: Description) -> dict[str, Any]:
    if kind in ("text", "mark"):
        rows = block.texts if kind == "text" else block.marks
        at_s = np.array([row[0] for row in rows], float)
        at_s = np.round(at_s - begun_s, 9)
        frames = [row[1] for row in rows] if kind == "text" else []
        found = {"time_s": at_s, "arrived_s": at_s}
        for name, dtype in (("sensor", "u1"), ("sequence", "u2"), ("t_us", "u4")):
            values = [getattr(one, name) for one in frames] or [0] * len(rows)
            found[name] = np.array(values, dtype)
        if kind == "text":
            found["content"] = np.array([one.content for one in frames], object)
        return found
    array = block.tables[list(VALUES).index(kind)]
    found: dict[str, Any] = {name: array[name] for name in array.dtype.names}
    for name in ("time_s", "arrived_s"):
        found[name] = np.round(found[name] - begun_s, 9)
    # As in the exports: an unknown time of the measurement is that of the arrival.
    found["time_s"] = np.where(np.isnan(found["time_s"]), found["arrived_s"], found["time_s"])
    if kind == "touch":
        flags = array["flags"]
        touching = flags & decode.TOUCHING != 0
        found |= {"touching": touching, "trusted": touching & (flags & DOUBTFUL == 0)}
        found["position_um"] = np.where(array["known"], array["position_um"], _NO_VALUE)
        found["force_mN"] = np.where(force_known(flags), array["force_mN"], _NO_VALUE)
        for name in ("contrast", "brightness"):
            values = array[f"{name}_q20"]
            unknown = log2_unknown(values, flags)
            found[f"{name}_log2"] = np.where(unknown, _NO_VALUE, values / (1 << 20))
    elif kind == "contact":
        found["force_mN"] = np.where(array["known"], array["force_mN"], _NO_VALUE)
    elif kind == "spectrum":
        found["gain_code"] = array["gain"]
        for i, channel in enumerate(about.channels[:CHANNELS]):
            found[f"counts_{channel}"] = array["counts"][:, i]
    return found
