"""What a drift of the channels looks like: a redder LED, a paler dye, more blue light.

Indicative only. Sensor filters that shift look like an LED that shifts the other way, and a tilted
coupling like a little of it.
"""

from __future__ import annotations

import numpy as np

# DS000504, table of optical characteristics.
_CENTRE_NM = {
    "F1": 415,
    "F2": 445,
    "F3": 480,
    "F4": 515,
    "F5": 555,
    "F6": 590,
    "F7": 630,
    "F8": 680,
}
_BLUE_NM = 500  # above it white LEDs shine by their phosphor
_PHOSPHOR_FWHM_NM = 130.0  # of usual white LEDs
# What is worth a word: percent, nm, percent; each is some 0.1 mm on a strip of 85 mm.
_LEAST = 0.25, 0.05, 0.25


def described(place_um, logs, shifts, plan) -> str:
    """Return a drift in words.

    Parameters
    ----------
    place_um : sequence of float, length n
        Marks, ascending.
    logs, shifts : array_like, shape (n, 6)
        log2 of the counts there at the calibration, and by how much they differ now. Of one mark
        the dye cannot be named.
    plan : sequence of str
        Channels.

    Returns
    -------
    str
    """
    known = [i for i, name in enumerate(plan) if name in _CENTRE_NM]
    nm = np.array([_CENTRE_NM[plan[i]] for i in known])
    logs, shifts = np.asarray(logs)[:, known], _centred(np.asarray(shifts)[:, known])
    near = logs[0]
    if len(place_um) > 1:  # the light before the dye
        near = near - (logs[1] - logs[0]) * place_um[0] / (place_um[1] - place_um[0])
    # A paler dye absorbs less in proportion to what it absorbs, which grows along the strip.
    absorbed = _centred(near - logs)
    grows = absorbed - absorbed.mean(axis=0)
    paler = float((grows * shifts).sum() / max((grows**2).sum(), 1e-12))
    redder = 8 * nm / _PHOSPHOR_FWHM_NM**2  # log2 of a bell, per nm that it shifts
    design = _centred(np.stack([redder, nm < _BLUE_NM])).T
    rest = (shifts - paler * absorbed).mean(axis=0)
    (shift_nm, bluer), *_ = np.linalg.lstsq(design, rest, rcond=None)
    parts = [
        _part(100 * paler, _LEAST[0], "dye {:.1f} % paler", "dye {:.1f} % darker"),
        _part(shift_nm, _LEAST[1], "LED {:.2f} nm redder", "LED {:.2f} nm bluer"),
        _part(
            100 * (2**bluer - 1), _LEAST[2], "{:.1f} % more blue light", "{:.1f} % less blue light"
        ),
    ]
    return ", ".join(filter(None, parts)) or "no drift"


def _centred(logs: np.ndarray) -> np.ndarray:
    return logs - logs.mean(axis=-1, keepdims=True)


def _part(value: float, least: float, more: str, less: str) -> str:
    return "" if abs(value) < least else (more if value > 0 else less).format(abs(value))
