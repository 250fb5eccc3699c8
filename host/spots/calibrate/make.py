"""From the presses of a session to the file of a calibration."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from spots_device.calibration import Calibration, CalibrationError
from spots_device.decode import Decode

from ..errors import SpotsError
from . import calibration_file as file
from .fit import PLACES_MIN, fit
from .joint import fit_joint, joint_marks
from .presses import MARKS, Noise, Presses
from .session import Session

_DECODED_SAMPLES = 64  # counts are means: in sums of so many little of them is lost


def make(session: Session, say: Callable[[str], None] = print) -> file.CalibrationFile:
    """Return the calibration that the presses of a session give.

    Parameters
    ----------
    session : Session
        Its joint is left out as long as it gives none.
    say : callable
        Given a line that says so.

    Returns
    -------
    CalibrationFile

    Raises
    ------
    SpotsError
        If they give none.
    """
    along = {0: session.presses("position")}
    for strain_ppm in session.strains_ppm:
        at_strain = session.presses("strain", strain_ppm)
        if len(at_strain.position_um) >= PLACES_MIN:
            along[strain_ppm] = at_strain
    pressed = session.presses("force")
    lines = fit(along, pressed, Noise.of(*along.values(), pressed), session.conditions)
    try:
        Calibration(lines)
    except CalibrationError as error:
        raise SpotsError(
            f"these presses give no calibration ({error}): take more of them"
        ) from None
    residuals = [
        _residual(lines, strain, places, pressed if strain == 0 else None)
        for strain, places in along.items()
    ]
    return file.CalibrationFile(
        date=file.now(),
        **session.conditions._asdict(),
        lines=tuple(lines),
        residuals=residuals,
        marks=_marks(session.presses("mark")),
        **_joint(session, say),
    )


def _marks(pressed: Presses) -> file.Marks | None:
    if len(pressed.position_um) < len(MARKS):
        return None
    return file.Marks(
        place_um=tuple(pressed.position_um.tolist()),
        force_mN=float(pressed.force_mN[0]),
        logs=tuple(map(tuple, pressed.logs.round(6).tolist())),
    )


def _joint(session: Session, say: Callable[[str], None]) -> dict:
    turned = session.of("joint")
    if not turned:
        return {}
    try:
        return {"joint": fit_joint(turned), "joint_marks": joint_marks(turned)}
    except SpotsError as error:
        # The strip is calibrated without it, too, and the joint may not be finished yet.
        say(f"the joint is left out: {error}")
        return {}


def _residual(lines, strain_ppm: int, along: Presses, pressed: Presses | None) -> file.Residual:
    decode = Decode()
    decode.calibration = Calibration(lines, strain_ppm)

    def decoded(presses: Presses) -> np.ndarray:
        rows = []
        for counts in presses.counts:
            sums = [max(round(_DECODED_SAMPLES * count), 0) for count in counts.tolist()]
            decode.update(sums, _DECODED_SAMPLES, [0] * len(sums), 0)
            rows.append((decode.position_um, decode.force_mN))
        return np.array(rows, dtype=float)

    position = decoded(along)[:, 0] - along.position_um
    force_rms_mN = None
    if pressed is not None:
        lit = pressed.lit_everywhere()
        force_rms_mN = _rms(decoded(lit)[:, 1] - lit.force_mN)
    return file.Residual(
        strain_ppm=strain_ppm,
        position_rms_um=_rms(position),
        force_rms_mN=force_rms_mN,
        presses=len(along.position_um) + (0 if pressed is None else len(pressed.force_mN)),
    )


def _rms(values: np.ndarray) -> float:
    return round(float(np.sqrt(np.mean(values**2))), 1)
