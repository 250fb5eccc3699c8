"""Reads spectra that a spectrometer has measured: CSV files with wavelength in nm and value."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np

from spots.common.bounded import read_text
from spots.errors import FileError

Table = tuple[tuple[float, float], ...]

_BETWEEN = re.compile(r"[;,\t ]+")
_LOW_NM, _HIGH_NM = 350.0, 1000.0  # the simulation uses no others
_NEEDED_NM = 430.0, 670.0  # a table must reach beyond both


def read(path: Path) -> Table:
    """Return the rows of a spectrum from 350 to 1000 nm; values below 0 become 0.

    Each line of the CSV file has a wavelength in nm and a value, separated by a comma, a semicolon,
    a tab or spaces; further columns, and lines before the first number, are ignored. Returned are
    ascending wavelengths, and values. FileError if this is no spectrum of visible light.
    """
    try:
        lines = read_text(path).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not UTF-8 text"
        raise FileError(
            f"cannot read the spectrum {path} ({reason}): give a CSV file", path
        ) from None
    rows: dict[float, float] = {}
    for number, line in enumerate(lines, 1):
        words = _BETWEEN.split(line.strip())
        if words == [""] or words[0].startswith("#"):
            continue
        try:
            nm, value = map(float, words[:2])
        except ValueError:
            nm = value = math.nan
        if not (math.isfinite(nm) and math.isfinite(value)):
            if not rows:
                continue  # a header
            raise FileError(
                f"line {number} of the spectrum {path} must be a wavelength in nm and a value, "
                f"such as 450,0.83, not {line.strip()!r}",
                path,
                f"line {number}",
            )
        if nm in rows:
            raise FileError(
                f"line {number} of the spectrum {path} repeats {nm:g} nm: remove it",
                path,
                f"line {number}",
            )
        rows[nm] = max(value, 0.0)
    table = tuple((nm, rows[nm]) for nm in sorted(rows) if _LOW_NM <= nm <= _HIGH_NM)
    low_nm, high_nm = _NEEDED_NM
    if not table or table[0][0] > low_nm or table[-1][0] < high_nm:
        raise FileError(
            f"the spectrum {path} must have lines such as 450,0.83 from {low_nm:g} nm or less to "
            f"{high_nm:g} nm or more",
            path,
        )
    if not any(value for _, value in table):
        raise FileError(f"the spectrum {path} has no value above 0: name another file", path)
    return table


def at(table: Table, wavelength_nm: np.ndarray) -> np.ndarray:
    """Return the values of a table at wavelengths; outside, its first or last value."""
    nm, values = np.array(table).T
    return np.interp(wavelength_nm, nm, values)
