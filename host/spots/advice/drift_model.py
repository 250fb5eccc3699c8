"""Estimates the error of a position from the spectrum of a press at an unknown position.

A drift of the LED, the filters or the coupling changes log2 of the counts of each channel. The part
of this change that looks like another position or another force is not visible in one press; the
rest is the *residual*. A change by one of these causes is a smooth function of the wavelength. So a
residual shows which cause is probable, and with it the change of the position. This module computes
the changes of a usual white LED and of the AS7341; an estimate for another white LED is wrong by
some ten per cent. A change of the dye looks like another position; nothing of it is visible.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

# Centres and widths (FWHM) of the photodiodes in nm: AS7341 data sheet DS000504, table of optical
# characteristics.
BANDS_NM = {
    "F1": (415, 26),
    "F2": (445, 30),
    "F3": (480, 36),
    "F4": (515, 39),
    "F5": (555, 39),
    "F6": (590, 40),
    "F7": (630, 50),
    "F8": (680, 52),
}
_NM = np.arange(400.0, 760.0, 4.0)
# A usual white LED: centre and FWHM of blue chip and phosphor in nm, share of the blue light.
_BLUE_NM, _PHOSPHOR_NM, _BLUE_SHARE = (453.0, 22.0), (580.0, 120.0), 0.25
_TILT_NM = 415.0, 680.0  # the tilt of the coupling is linear between these wavelengths
_STEP = 0.2  # share of a change for its derivative


class Cause(NamedTuple):
    """A cause of drift, with its name for the user.

    `sizes` are changes of the spectrum, as keys of a change file (docs/calibrate/drift.md), and
    their usual sizes.
    """

    words: str
    sizes: tuple[tuple[str, float], ...]


_BLUE = "the blue light of the LED"
_RED = "the phosphor of the LED, or the light at the glued ends"
_WARM = "the temperature, or the sensor's filters"
# Changes within some months are assumed. Changes per kelvin are those of docs/calibrate/drift.md,
# for 10 K.
CAUSES = (
    Cause(_BLUE, (("die_nm", 0.3),)),
    Cause(_BLUE, (("blue_share_percent", 1.0),)),
    Cause(_RED, (("phosphor_nm", 0.5),)),
    Cause(_RED, (("phosphor_fwhm_nm", 1.0),)),
    Cause(_RED, (("tilt_percent", 0.5),)),
    Cause(_WARM, (("bands_nm", 0.1),)),
    Cause(
        _WARM,
        (
            ("die_nm", 0.4),
            ("phosphor_nm", 0.15),
            ("phosphor_fwhm_nm", 0.5),
            ("blue_share_percent", -0.11),
            ("bands_nm", 0.3),
        ),
    ),
)
GROUPS = tuple(dict.fromkeys(cause.words for cause in CAUSES))
# Row i adds up the causes of group i; the last row adds up all causes.
_SUMS = np.array([[words in (one.words, "") for one in CAUSES] for words in (*GROUPS, "")])
_READINGS = 30  # the noise of a mean of so many readings limits which causes can be distinguished


def _bell(centre_nm: float, fwhm_nm: float) -> np.ndarray:
    return np.exp(-4 * np.log(2) * ((_NM - centre_nm) / fwhm_nm) ** 2)


def _logs(plan: Sequence[str], decays: Sequence[float], x_um: float, **change: float) -> np.ndarray:
    """Return log2 of the counts of the channels in `plan` after a change; a constant is omitted."""
    now = dict.fromkeys((name for cause in CAUSES for name, _ in cause.sizes), 0.0) | change
    blue = _bell(_BLUE_NM[0] + now["die_nm"], _BLUE_NM[1])
    phosphor = _bell(
        _PHOSPHOR_NM[0] + now["phosphor_nm"], _PHOSPHOR_NM[1] + now["phosphor_fwhm_nm"]
    )
    share = _BLUE_SHARE + now["blue_share_percent"] / 100
    light = share * blue / blue.sum() + (1 - share) * phosphor / phosphor.sum()
    light *= 1 + now["tilt_percent"] / 100 * (_NM - _TILT_NM[0]) / (_TILT_NM[1] - _TILT_NM[0])
    centres = [BANDS_NM[name][0] for name in plan]
    light *= np.exp2(-np.interp(_NM, centres, decays) * x_um)
    bands = [_bell(BANDS_NM[name][0] + now["bands_nm"], BANDS_NM[name][1]) for name in plan]
    return np.log2(np.array(bands) @ light)


@lru_cache(maxsize=256)
def changes(plan: tuple[str, ...], decays: tuple[float, ...], x_um: float) -> np.ndarray:
    """Return the change of log2 of the counts by each of `CAUSES`; shape (causes, channels).

    `plan` names channels of `BANDS_NM` in ascending order of their wavelengths; `decays` are those
    of the light by the dye, in log2 units per um.
    """
    rows: list[np.ndarray] = []
    for cause in CAUSES:
        sizes = {name: _STEP * size for name, size in cause.sizes}
        less = {name: -size for name, size in sizes.items()}
        more, fewer = (_logs(plan, decays, x_um, **one) for one in (sizes, less))
        rows.append((more - fewer) / (2 * _STEP))
    return np.array(rows)


def weights(causes: np.ndarray, slopes: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Return the weights with which a residual gives the error of the position.

    `causes` has shape (n, 6), see `changes`; `slopes` are derivatives of log2 of the counts by the
    position in um, `variance` the variances of log2 of the counts of one reading. Row i of the
    result, shape (groups + 1, 6), times the change of log2 of the counts is the most probable error
    in um by the causes of group i of `GROUPS`; the last row gives the error by all causes. Neither
    the position nor the force changes the result.
    """
    scale = 1 / np.sqrt(variance)
    alike = np.stack([np.ones_like(slopes), slopes * 1000], axis=1) * scale[:, None]
    basis, _ = np.linalg.qr(alike)
    free = np.eye(len(slopes)) - basis @ basis.T
    seen = (causes * scale) @ free
    errors_um = 1000 * np.linalg.lstsq(alike, (causes * scale).T, rcond=None)[0][1]
    # The most probable sizes of the causes, if their usual sizes are standard deviations.
    sizes = np.linalg.solve(seen.T @ seen + np.eye(len(slopes)) / _READINGS, seen.T)
    return (_SUMS * errors_um) @ sizes.T @ free * scale
