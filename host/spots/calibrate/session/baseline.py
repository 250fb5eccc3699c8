"""Light of a strip that nothing presses, which a calibration subtracts: dust, touching guides.

Such light has the colour of a press at its place. So presses at known places show where it is.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from spots_device.reading.decode import DARK_SAMPLES

from ...errors import CalibrationError
from ..fit.points import presses
from ..fit.presses import FIRM_MN, Presses
from .session_file import Session

# Largest light without a press, as a share of a firm press at the same place. Dust of 2 % of a full
# contact has 3 %. With more light, the strip is not as it was cast.
_SHARE_MAX = 0.1
# Presses that show the place of such light while a session runs: their forces as shares of a firm
# one, and the least distance between the outermost ones, as a share of the strip's length.
_FIRM_SHARES, _SPREAD = (0.7, 1.5), 0.5


def line(baseline: Iterable[float]) -> list[str]:
    """Return the line `rest` of a calibration; no line if there is no such light.

    The light of the untouched strip is in counts of a sample for each channel, or nothing.
    """
    sums = [round(DARK_SAMPLES * one) for one in baseline]
    return [" ".join(["rest", *map(str, sums)])] if any(sums) else []


def replaced(lines: Iterable[str], baseline: Iterable[float]) -> list[str]:
    """Return lines of a calibration with another line `rest`, or without one; see `line`."""
    kept = [one for one in lines if not one.startswith("rest ")]
    return kept + line(baseline)


def described(baseline: Iterable[float], firm: Presses) -> str:
    """Return where the light without a press comes from, and how bright it is.

    `firm` are firm presses at two or more places. CalibrationError if the light is too bright to be
    subtracted.
    """
    place_um, share = _found(np.array(list(baseline)), firm)
    where = f"light at {place_um / 1000:.0f} mm without a press: dust, or the guides touch"
    if share > _SHARE_MAX:
        raise CalibrationError(
            f"{where}; it has {share:.0%} of the light of a firm press there, and at most "
            f"{_SHARE_MAX:.0%} can be subtracted: clean the strip there, or part its guides, and "
            "begin another session"
        )
    return f"{where} ({share:.1%} of the light of a firm press); it is subtracted"


def check(session: Session) -> None:
    """Refuse light without a press that is too bright as soon as firm presses show its place.

    The session has just stored a press. CalibrationError as in `described`.
    """
    last = session.points[-1]
    low_mN, high_mN = (share * FIRM_MN for share in _FIRM_SHARES)
    firm = [
        p
        for p in session.points
        if p.plan == last.plan
        and p.strain_ppm == last.strain_ppm == 0
        and not (p.saturated or p.angle_deg is not None)
        and (not p.force_mN or low_mN <= p.force_mN <= high_mN)
    ]
    places_um = [p.place_um for p in firm]
    if last.baseline and firm and np.ptp(places_um) >= _SPREAD * (session.length_um or np.inf):
        described(last.baseline, presses(firm))


def _found(baseline: np.ndarray, firm: Presses) -> tuple[float, float]:
    order = np.argsort(firm.position_um)
    places, logs = firm.position_um[order], firm.logs[order]
    # The colour changes monotonically from the first place to the last.
    way = logs[-1] - logs[0]
    way = way - way.mean()
    contrasts = np.maximum.accumulate(logs @ way)
    light = np.log2(np.maximum(baseline, 1 / DARK_SAMPLES))
    place_um = float(np.interp(light @ way, contrasts, places))
    expected = np.array([np.interp(place_um, places, log) for log in logs.T])
    return place_um, float(baseline.sum() / np.exp2(expected).sum())
