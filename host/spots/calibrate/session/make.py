"""Computes the content of a calibration file from the presses of a session."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec.structs import replace

from spots_device.reading.calibration import Calibration
from spots_device.reading.calibration_lines import CalibrationError as LinesError
from spots_device.reading.decode import CROSS

from ...common.press_spectra import press_spectra
from ...errors import CalibrationError, SpotsError
from .. import calibration_file as file
from .. import pressers
from ..fit.decoded import Decoded
from ..fit.fit import PLACES_MIN, fit
from ..fit.points import presses
from ..fit.presses import ALL_MARKS, FIRM_MN, MARKS, Noise, Presses
from ..fit.silicone import fit_session
from . import baseline
from .hand import material
from .joint import fit_joint, joint_marks
from .session_file import Session

# Limits of the rms errors at the presses, above which a calibration is refused: of the positions in
# um, and of the forces as a share of their rms. A stage reaches 10 um and 2 %; a person who reads
# a ruler to 0.5 mm and a scale to 5 % reaches 300 um and 4 %.
_STAGE_MAX = 200.0, 0.1
_HAND_MAX = 800.0, 0.2
_UNFIT = "the calibration does not fit its presses, and was not stored"
_TOUCHES = 0.5  # least share of the presses that the calibration must read as touches


def make(session: Session, say: Callable[[str], None] = print) -> file.CalibrationFile:
    """Compute a calibration from the presses of a session.

    A strain with fewer than `PLACES_MIN` presses is ignored, and so is a joint whose presses cannot
    be fitted. ``say(line)`` shows the hysteresis and creep that the board will compensate, or why
    the calibration does not include the joint. CalibrationError if the presses do not give a
    calibration, or do not fit the calibration that they give.
    """
    try:
        return _made(session, say)
    except np.linalg.LinAlgError:
        raise CalibrationError(
            f"the presses in {session.path} contradict each other: check their positions and "
            "forces, remove the lines of wrong ones, or begin another session with --session"
        ) from None


def _made(session: Session, say: Callable[[str], None]) -> file.CalibrationFile:
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
    if not press_spectra(lines):
        say(
            f"a calibration for {len(along)} strains has no room for the spectra of presses: drift "
            "is reported only if readings become untrusted, and 'spots doctor --mark' checks a "
            "position"
        )
    if light := session.baseline:
        say(baseline.described(light, firm))
        lines += baseline.line(light)
    _validate(lines)
    if surface and not surface.taken.force_mN.any():
        lines.append("relative")
    elif surface and (compensated := fit_session(hand, lines, surface.sizes.force_share)):
        if compensated.line:
            lines.append(compensated.line)
            _validate(lines)
        say(str(compensated))
    marks = presses(session.of("mark"))
    if surface:
        at_um = np.array(ALL_MARKS) * session.length_um
        marks = surface.presses(at_um, np.full(len(at_um), FIRM_MN))
        along[0], pressed = surface.taken, surface.taken.keep(surface.taken.force_mN > 0)
    limits = _HAND_MAX if surface else _STAGE_MAX
    presser = presser_of(session)
    return file.CalibrationFile(
        date=file.now(),
        **session.conditions._asdict(),
        presser=presser,
        lines=tuple(pressers.marked(lines, presser, chosen=False)),
        residuals=[_residual(session, lines, at, along[at], pressed, *limits) for at in along],
        marks=_marks(marks),
        **_joint(session, lines, say),
    )


def presser_of(session: Session) -> file.Presser:
    """Return what presses a session: a finger if it has no scale."""
    rough = any(not p.force_mN for p in session.of("hand"))
    return file.FINGER if rough else file.INDENTER


def _validate(lines: list[str]) -> None:
    try:
        Calibration(lines)
    except LinesError as error:
        raise CalibrationError(
            f"these presses give no calibration ({error}): check the length of the strip and the "
            "positions of the presses, or take more presses"
        ) from None


def _marks(pressed: Presses) -> file.Marks | None:
    if len(pressed.force_mN) < len(MARKS):
        return None
    if not (np.diff(pressed.position_um) > 0).all():
        raise CalibrationError(
            "two marks of this session have the same position: remove the lines of its presses of "
            "the kind mark, and start the session again"
        )
    return file.Marks(
        place_um=tuple(pressed.position_um.tolist()),
        force_mN=float(pressed.force_mN[0]),
        logs=tuple(map(tuple, pressed.logs.round(6).tolist())),
    )


def _joint(session: Session, lines: list[str], say: Callable[[str], None]) -> dict:
    turned = session.of("joint")
    if not turned:
        return {}
    decode = Decoded()
    decode.calibration = Calibration(lines)
    if decode.tables[CROSS]:
        # The board had perhaps no correction for the force of the indenter.
        turned = [replace(p, position_um=_position_um(decode, p.counts)) for p in turned]
    try:
        return {"joint": fit_joint(turned), "joint_marks": joint_marks(turned)}
    except SpotsError as error:
        # The joint may be unfinished; the calibration of the strip does not need the joint.
        say(f"the calibration is written without the joint: {error}")
        return {}


def _position_um(decode: Decoded, counts) -> float:
    decode.update_mean(counts)
    return float(decode.position_um)


def _residual(
    session: Session,
    lines,
    strain_ppm: int,
    along: Presses,
    pressed: Presses,
    limit_um: float,
    limit_share: float,
) -> file.Residual:
    """Return the errors of the board's positions and forces at the presses of one strain.

    Raises CalibrationError if the rms errors are above `limit_um`, or above the share `limit_share`
    of the forces.
    """
    decode = Decoded()
    decode.calibration = Calibration(lines, strain_ppm)

    def decoded(presses: Presses) -> np.ndarray:
        rows = []
        for counts in presses.counts:
            decode.update_mean(counts)
            rows.append((decode.position_um, decode.force_mN))
        return np.array(rows, dtype=float)

    at_um, force_mN = decoded(along).T
    touches = force_mN >= decode.calibration.touch_on_mN
    if touches.mean() < _TOUCHES:
        raise CalibrationError(
            f"{_UNFIT}: only {touches.sum()} of {len(touches)} presses are read as touches; begin "
            "another session, and press more firmly"
        )
    touched = along.keep(touches)
    off_um = at_um[touches] - touched.position_um
    found = file.Residual(strain_ppm=strain_ppm, position_rms_um=_rms(off_um), presses=len(off_um))
    if found.position_rms_um > limit_um:
        rms = f"positions by {found.position_rms_um / 1000:.2g} mm rms instead of at most"
        raise _unfit(session, f"{rms} {limit_um / 1000:.2g} mm", touched, off_um)
    if strain_ppm or not len(pressed.force_mN):
        return found
    lit = pressed.lit_everywhere()
    off_mN = decoded(lit)[:, 1] - lit.force_mN
    share = _rms(off_mN) / _rms(lit.force_mN)
    if share > limit_share:
        by = f"forces by {share:.0%} instead of at most {limit_share:.0%}"
        raise _unfit(session, by, lit, off_mN)
    return replace(found, force_rms_mN=_rms(off_mN), presses=found.presses + len(pressed.force_mN))


def _unfit(session: Session, errors: str, taken: Presses, off: np.ndarray) -> SpotsError:
    """Return the error for a calibration that does not fit its presses; name the worst press."""
    worst = int(np.argmax(np.abs(off)))
    at = taken.position_um[worst], taken.force_mN[worst]
    places = [(p.place_um, p.force_mN) for p in session.points]
    line = len(places) - places[::-1].index(at)
    return CalibrationError(
        f"{_UNFIT}: it differs from the {errors}; check the length of the strip, and the press at "
        f"{session.points[line - 1]}, which fits worst: remove line {line} of {session.path} to "
        "repeat it, or begin another session with --session"
    )


def _rms(values: np.ndarray) -> float:
    return round(float(np.sqrt(np.mean(values**2))), 1)
