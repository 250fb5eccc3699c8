"""Reads a recording as a table of pandas."""

from pathlib import Path
from typing import Any

import numpy as np

from ..errors import SettingError, did_you_mean, missing
from .arrays import RecordingBlocks
from .table import VALUES, columns, described, tables


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
        raise missing("a table of pandas needs", "pandas", "pandas") from None
    if kind not in VALUES:
        raise SettingError(f"there is no kind {kind!r}: {did_you_mean(kind, list(VALUES))}")
    recording = RecordingBlocks(path)
    description = described(recording)
    begun_s = description.header.host_s
    table = next(one for one in tables(description.channels) if one.name == kind)
    parts = [columns(table, block, begun_s) for block in recording]
    joined = {
        name: np.concatenate([part[name].array() for part in parts]) for name in table.dtype.names
    }
    if kind != "mark":
        marks = sorted((one.time_s - begun_s, one.text) for one in recording.marks)
        texts = np.array(["", *(text for _, text in marks)], object)
        joined["mark"] = texts[np.searchsorted([at for at, _ in marks], joined["time_s"], "right")]
    # Without rows, pandas does not find the type of a column of texts.
    text = pd.Series(["text"]).dtype
    dtypes = {name: text for name, one in joined.items() if one.dtype == object}
    dtypes.pop("content", None)  # dicts
    return pd.DataFrame(joined).astype(dtypes)
