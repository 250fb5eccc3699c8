"""The contact between the guides of a simulated strip, and what remains of it after a press."""

from __future__ import annotations

import math

import numpy as np

from .files import ContactFile
from .scenario import Press


def coupling(contact: ContactFile, force_mN: float) -> float:
    """Return the contact area under a finger at a force, as a share of full contact.

    The material is hyper-elastic: each further newton adds less area (paper, section III.B and Fig.
    3A). Below the force of first contact (``threshold_mN``), a small share of the light crosses the
    air gap.
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
    """Contact that remains where a press has lifted, and decays; a sliding press takes it along.

    `places_mm` are the middles of the n cells, from the sensor's end. `free` is whether no contact
    remained at the last call of `remaining`.
    """

    def __init__(self, contact: ContactFile, length_mm: float):
        self._kept = contact.sticking_percent / 100
        self._decay_s = contact.sticking_s
        cells = np.arange(-_BEYOND_MM, math.ceil(_LONGEST * length_mm) + _BEYOND_MM)
        self.places_mm = (cells + 0.5) * _CELL_MM
        self.free = True
        self._shares = np.zeros(len(cells))
        self._held: list[tuple[float, float, float]] = []  # place, width and contact of presses
        self._time_s = 0.0

    def remaining(
        self, presses: list[Press], shares: list[float], time_s: float
    ) -> np.ndarray | None:
        """Return the remaining contact in addition to that of the presses, as a share by cell.

        None if no contact remains. The time must never decrease.
        """
        elapsed_s, self._time_s = time_s - self._time_s, time_s
        if self.free and not presses:
            return None
        kept = math.exp(-elapsed_s / self._decay_s)
        remaining = self._shares
        remaining *= kept
        pressed, held = np.zeros(len(remaining)), []
        for press, share in zip(presses, shares):
            place_mm, width_mm = press.position_mm, max(press.width_mm, _CELL_MM)
            sticking = self._kept * share
            for before in [one for one in self._held if abs(one[0] - place_mm) < width_mm]:
                self._held.remove(before)
                sticking = max(sticking, kept * before[2])
            held.append((place_mm, width_mm, sticking))
            self._add(pressed, place_mm, width_mm, share)
        for place_mm, width_mm, sticking in self._held:
            lifted = np.zeros(len(remaining))
            self._add(lifted, place_mm, width_mm, kept * sticking)
            np.maximum(remaining, lifted, out=remaining)
        self._held = held
        remaining[remaining < _LEAST] = 0.0
        self.free = not (held or remaining.any())
        found = np.maximum(remaining - pressed, 0.0)
        for (place_mm, width_mm, sticking), share in zip(held, shares):
            if sticking > share:  # while the press lifts
                self._add(found, place_mm, width_mm, sticking - share)
        return found if found.any() else None

    def _add(self, cells: np.ndarray, place_mm: float, width_mm: float, share: float) -> None:
        low_mm = place_mm - width_mm / 2 + _BEYOND_MM * _CELL_MM
        high_mm = low_mm + width_mm
        first, last = math.floor(low_mm / _CELL_MM), math.ceil(high_mm / _CELL_MM)
        for i in range(max(first, 0), min(last, len(cells))):
            covered_mm = min((i + 1) * _CELL_MM, high_mm) - max(i * _CELL_MM, low_mm)
            cells[i] += share * covered_mm / width_mm
