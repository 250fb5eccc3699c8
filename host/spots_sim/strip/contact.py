"""The contact between the guides of a simulated strip, and what remains of it after a press."""

from __future__ import annotations

import math

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
_LEAST = 1e-7  # contact share in a cell; less is no light


class Sticking:
    """Contact that remains where a press has lifted, or from where it has moved, and decays.

    Parameters
    ----------
    contact : ContactFile
        Table of the sensor file, with ``sticking_percent`` and ``sticking_s``.
    """

    def __init__(self, contact: ContactFile):
        self._kept = contact.sticking_percent / 100
        self._decay_s = contact.sticking_s
        self._cells: dict[int, float] = {}  # remaining contact share by cell
        self._time_s = 0.0

    @property
    def free(self) -> bool:
        """Whether no contact remained at the last call of `remaining`."""
        return not self._cells

    def remaining(self, presses, shares, time_s: float) -> list[tuple[float, float]]:
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
        list of tuple
            For each cell with a remaining contact: its middle in mm from the sensor's end, and its
            contact share.
        """
        pressed: dict[int, float] = {}
        for press, share in zip(presses, shares):
            width_mm = max(press.width_mm, _CELL_MM)
            low_mm = press.position_mm - width_mm / 2
            high_mm = low_mm + width_mm
            for i in range(math.floor(low_mm / _CELL_MM), math.ceil(high_mm / _CELL_MM)):
                covered_mm = min((i + 1) * _CELL_MM, high_mm) - max(i * _CELL_MM, low_mm)
                pressed[i] = pressed.get(i, 0.0) + share * covered_mm / width_mm
        kept = math.exp((self._time_s - time_s) / self._decay_s)
        self._time_s = time_s
        cells = {i: kept * share for i, share in self._cells.items() if kept * share > _LEAST}
        for i, share in pressed.items():
            cells[i] = max(cells.get(i, 0.0), self._kept * share)
        self._cells = cells
        return [
            ((i + 0.5) * _CELL_MM, share - pressed.get(i, 0.0))
            for i, share in cells.items()
            if share > pressed.get(i, 0.0)
        ]
