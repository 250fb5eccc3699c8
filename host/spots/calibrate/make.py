"""Computes the content of a calibration file from the presses of a session."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec.structs import replace

from spots_device.calibration import Calibration, CalibrationError
from spots_device.views import Decoded

from ..errors import SpotsError
from . import calibration_file as file
from .fit import PLACES_MIN, fit
from .hand import material
from .joint import fit_joint, joint_marks
from .presses import FIRM_MN, MARKS, Noise, Presses
from .session import Session, presses
from .silicone import fit_session


def make(session: Session, say: Callable[[str], None] = print) -> file.CalibrationFile:
    """Compute a calibration from the presses of a session.

    Parameters
    ----------
    session : Session
        Presses of the session. A strain with fewer than `PLACES_MIN` presses is ignored, and so is
        a joint whose presses cannot be fitted.
    say : callable
        ``say(line)`` shows a message: the hysteresis and creep that the board will compensate, or
        why the calibration does not include the joint.

    Returns
    -------
    CalibrationFile
        The calibration, with the current date and time.

    Raises
    ------
    SpotsError
        If the presses do not give a calibration.
    """
    surface = misfit = noise = None
    if hand := session.of("hand"):
        surface, firm, pressed = material(session, session.length_um)
        taken = surface.taken
        noise = Noise.of(taken)
        misfit = taken.logs - surface.logs(taken.position_um, taken.force_mN)
    else:
        firm, pressed = presses(session.of("position")), presses(session.of("force"))
    along = {0: firm}
    for strain_ppm in sorted({p.strain_ppm for p in session.points if p.kind == "strain"}):
        at_strain = session.of("strain", strain_ppm)
        if len(at_strain) >= PLACES_MIN:
            along[strain_ppm] = presses(at_strain)
    noise = noise or Noise.of(*along.values(), pressed)
    lines = fit(along, pressed, noise, session.conditions, misfit)
    if surface and not surface.taken.force_mN.any():
        lines.append("relative")
    elif surface and (compensated := fit_session(hand, lines, surface.sizes.force_share)):
        lines.append(compensated.line)
        say(str(compensated))
    try:
        Calibration(lines)
    except CalibrationError as error:
        raise SpotsError(
            f"these presses give no calibration ({error}): take more presses"
        ) from None
    marks = presses(session.of("mark"))
    if surface:
        at_um = np.array(MARKS) * session.length_um
        marks = surface.presses(at_um, np.full(len(MARKS), FIRM_MN))
        along[0], pressed = surface.taken, surface.taken.keep(surface.taken.force_mN > 0)
    return file.CalibrationFile(
        date=file.now(),
        **session.conditions._asdict(),
        lines=tuple(lines),
        residuals=[_residual(lines, strain, at, pressed) for strain, at in along.items()],
        marks=_marks(marks),
        **_joint(session, say),
    )


def _marks(pressed: Presses) -> file.Marks | None:
    if len(pressed.force_mN) < len(MARKS):
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
        # The joint may be unfinished; the calibration of the strip does not need the joint.
        say(f"the calibration is written without the joint: {error}")
        return {}


def _residual(lines, strain_ppm: int, along: Presses, pressed: Presses) -> file.Residual:
    decode = Decoded()
    decode.calibration = Calibration(lines, strain_ppm)

    def decoded(presses: Presses) -> np.ndarray:
        rows = []
        for counts in presses.counts:
            decode.update_mean(counts)
            rows.append((decode.position_um, decode.force_mN))
        return np.array(rows, dtype=float)

    at_um, force_mN = decoded(along).T
    position = (at_um - along.position_um)[force_mN >= decode.calibration.touch_on_mN]
    found = file.Residual(
        strain_ppm=strain_ppm, position_rms_um=_rms(position), presses=len(position)
    )
    if strain_ppm or not len(pressed.force_mN):
        return found
    lit = pressed.lit_everywhere()
    return replace(
        found,
        force_rms_mN=_rms(decoded(lit)[:, 1] - lit.force_mN),
        presses=len(position) + len(pressed.force_mN),
    )


def _rms(values: np.ndarray) -> float:
    return round(float(np.sqrt(np.mean(values**2))), 1)
