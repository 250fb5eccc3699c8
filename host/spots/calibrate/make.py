"""Makes the calibration file of a session from its presses."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec.structs import replace

from spots_device.calibration import Calibration, CalibrationError
from spots_device.decode import Decode

from ..errors import SpotsError
from . import calibration_file as file
from .fit import PLACES_MIN, fit
from .joint import fit_joint, joint_marks
from .presses import MARKS, Noise, Presses
from .session import Session, presses

_DECODED_SAMPLES = 64  # mean counts are rounded only after multiplication by this


def make(session: Session, say: Callable[[str], None] = print) -> file.CalibrationFile:
    """Return the calibration from the presses of a session.

    Parameters
    ----------
    session : Session
        Presses of the session. An unfinished joint or strain is ignored.
    say : callable
        ``say(line)`` shows why the calibration has no joint.

    Returns
    -------
    CalibrationFile
        The calibration, with the current date and time.

    Raises
    ------
    SpotsError
        If the presses do not give a calibration.
    """
    along = {0: presses(session.of("position"))}
    for strain_ppm in sorted({p.strain_ppm for p in session.points if p.kind == "strain"}):
        at_strain = session.of("strain", strain_ppm)
        if len(at_strain) >= PLACES_MIN:
            along[strain_ppm] = presses(at_strain)
    pressed = presses(session.of("force"))
    lines = fit(along, pressed, Noise.of(*along.values(), pressed), session.conditions)
    try:
        Calibration(lines)
    except CalibrationError as error:
        raise SpotsError(
            f"these presses give no calibration ({error}): take more presses"
        ) from None
    return file.CalibrationFile(
        date=file.now(),
        **session.conditions._asdict(),
        lines=tuple(lines),
        residuals=[_residual(lines, strain, at, pressed) for strain, at in along.items()],
        marks=_marks(session),
        **_joint(session, say),
    )


def _marks(session: Session) -> file.Marks | None:
    if len(session.of("mark")) < len(MARKS):
        return None
    pressed = presses(session.of("mark"))
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
        # The strip is calibrated without its joint, and the joint may be unfinished.
        say(f"the joint is left out: {error}")
        return {}


def _residual(lines, strain_ppm: int, along: Presses, pressed: Presses) -> file.Residual:
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
    found = file.Residual(
        strain_ppm=strain_ppm, position_rms_um=_rms(position), presses=len(position)
    )
    if strain_ppm:
        return found
    lit = pressed.lit_everywhere()
    return replace(
        found,
        force_rms_mN=_rms(decoded(lit)[:, 1] - lit.force_mN),
        presses=len(position) + len(pressed.force_mN),
    )


def _rms(values: np.ndarray) -> float:
    return round(float(np.sqrt(np.mean(values**2))), 1)
