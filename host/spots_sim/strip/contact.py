"""The contact area between the guides of a simulated strip, as a function of the force."""

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
