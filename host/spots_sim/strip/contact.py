"""The contact between the guides of a simulated strip, and what remains of it after a press."""

from __future__ import annotations

import math

import numpy as np

from .files import ContactFile


def coupling(contact: ContactFile, force_mN: float) -> float:
    """Return the contact area under a finger at a force, as a share of full contact.

    The material is hyper-elastic: each further newton adds less area (paper, section III.B and
    Fig. 3A). Below the force of first contact (``threshold_mN``), a small share of the light
    crosses the air gap.

    Parameters
    ----------
    contact : ContactFile
        Table of the sensor file: contact area as a function of force.
    force_mN : float
        Force of the press in mN.

    Returns
    -------
    float
        Share of full contact, from 0 to 1.
    """
    over_mN = force_mN - contact.threshold_mN
    if over_mN <= 0:
        return contact.early_share * math.exp(over_mN / contact.early_mN)
    over = over_mN / contact.half_mN
    return contact.early_share + (1 - contact.early_share) * over / (1 + over)


_CELL_MM = 1.0  # remaining contact is computed in cells of this length along the strip
_BEYOND_MM = 20  # a finger may reach beyond the ends of the strip
_LONGEST = 1.5  # longest strain of a strip, plus 1
_LEAST = 1e-7  # contact share of a cell; less is no light


class Sticking:
    """Contact that remains where a press has lifted, or from where it has moved, and decays.

    Parameters
    ----------
    contact : ContactFile
        Table of the sensor file, with ``sticking_percent`` and ``sticking_s``.
    length_mm : float
        Length of the strip in mm.

    Attributes
    ----------
    places_mm : numpy.ndarray, shape (n,)
        Middles of the cells, in mm from the sensor's end.
    free : bool
        Whether no contact remained at the last call of `remaining`.
    """

    def __init__(self, contact: ContactFile, length_mm: float):
        self._kept = contact.sticking_percent / 100
        self._decay_s = contact.sticking_s
        cells = np.arange(-_BEYOND_MM, math.ceil(_LONGEST * length_mm) + _BEYOND_MM)
        self.places_mm = (cells + 0.5) * _CELL_MM
        self.free = True
        self._shares = np.zeros(len(cells))
        self._time_s = 0.0

    def remaining(self, presses, shares, time_s: float) -> np.ndarray | None:
        """Return the remaining contact in addition to that of the presses.

        Parameters
        ----------
        presses : list of scenario.Press
            All presses on the strip.
        shares : list of float
            Contact share of each press.
        time_s : float
            Time in s; it must never decrease.

        Returns
        -------
        numpy.ndarray, shape (n,), or None
            Contact share of each cell; None if no contact remains.
        """
        elapsed_s, self._time_s = time_s - self._time_s, time_s
        if self.free and not presses:
            return None
        remaining = self._shares
        remaining *= math.exp(-elapsed_s / self._decay_s)
        pressed = np.zeros(len(remaining))
        for press, share in zip(presses, shares):
            width_mm = max(press.width_mm, _CELL_MM)
            low_mm = press.position_mm - width_mm / 2 + _BEYOND_MM * _CELL_MM
            high_mm = low_mm + width_mm
            first, last = math.floor(low_mm / _CELL_MM), math.ceil(high_mm / _CELL_MM)
            for i in range(max(first, 0), min(last, len(pressed))):
                covered_mm = min((i + 1) * _CELL_MM, high_mm) - max(i * _CELL_MM, low_mm)
                pressed[i] += share * covered_mm / width_mm
        np.maximum(remaining, self._kept * pressed, out=remaining)
        remaining[remaining < _LEAST] = 0.0
        self.free = not remaining.any()
        return None if self.free else np.maximum(remaining - pressed, 0.0)
