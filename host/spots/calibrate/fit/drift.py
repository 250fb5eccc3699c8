"""Reports the probable causes of a drift: a redder LED, a paler dye, more blue light.

Drift is the change of the counts since the calibration. It is measured at the marks, the positions
that ``spots rezero`` presses again. Different causes can change the channels alike. A shift of the
sensor's filters looks like a shift of the LED in the opposite direction. A press couples light into
the dyed light guide. If more light of one end of the spectrum is coupled than before, this looks
like a small shift of the LED.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from .choose import DIODES

# Centre wavelengths of the diodes: AS7341 data sheet DS000504, table of optical characteristics.
_CENTRE_NM = dict(zip(DIODES, (415, 445, 480, 515, 555, 590, 630, 680)))
# Below this wavelength, the light of a white LED is from its blue chip; above, from its phosphor.
_BLUE_NM = 500
_PHOSPHOR_FWHM_NM = 130.0  # of usual white LEDs
# Least change that is reported, and its text. Such a change shifts positions on an 85 mm strip by
# about 0.1 mm.
_WORDS = (
    (0.25, "dye {:.1f} % paler", "dye {:.1f} % darker"),
    (0.05, "LED {:.2f} nm redder", "LED {:.2f} nm bluer"),
    (0.25, "{:.1f} % more blue light", "{:.1f} % less blue light"),
)


def described(
    place_um: Sequence[float], logs: ArrayLike, shifts: ArrayLike, plan: Sequence[str]
) -> str:
    """Describe the probable causes of a drift of the channels in words, or ``no drift``.

    `place_um` are the distances of n marks from the strip's end at the sensor, ascending. A drift
    of the dye can be detected only with two marks or more. `logs`, shape (n, 6), is log2 of the
    dark-subtracted counts at the calibration; `shifts` is log2 of the present counts, minus `logs`.
    """
    known = [i for i, name in enumerate(plan) if name in _CENTRE_NM]
    nm = np.array([_CENTRE_NM[plan[i]] for i in known])
    logs, shifts = np.asarray(logs)[:, known], _centred(np.asarray(shifts)[:, known])
    near = logs[0]
    if len(place_um) > 1:  # extrapolated to the sensor's end: the light without the dye
        near = near - (logs[1] - logs[0]) * place_um[0] / (place_um[1] - place_um[0])
    # A paler dye absorbs less by the same share everywhere; the absorption grows along the strip.
    absorbed = _centred(near - logs)
    grows = absorbed - absorbed.mean(axis=0)
    paler = float((grows * shifts).sum() / max((grows**2).sum(), 1e-12))
    redder = 8 * nm / _PHOSPHOR_FWHM_NM**2  # change of log2 of a Gaussian peak, per nm of its shift
    design = _centred(np.stack([redder, nm < _BLUE_NM])).T
    rest = (shifts - paler * absorbed).mean(axis=0)
    (shift_nm, bluer), *_ = np.linalg.lstsq(design, rest, rcond=None)
    found = [
        (more if value > 0 else less).format(abs(value))
        for value, (least, more, less) in zip((100 * paler, shift_nm, 100 * (2**bluer - 1)), _WORDS)
        if abs(value) >= least
    ]
    return ", ".join(found) or "no drift"


def _centred(logs: np.ndarray) -> np.ndarray:
    return logs - logs.mean(axis=-1, keepdims=True)
