"""What a calibration takes over from the one that it replaces: drift, joint, re-zeros.

A re-zero measures the drift of the strip since its calibration. Presses that a session takes after
the re-zero have this drift, and the earlier presses of the session do not. So the drift is removed
from the later presses, all presses together are fitted, and the fit is shifted by the drift again.
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime

import numpy as np
from msgspec.structs import replace

from ...errors import FileError
from .. import pressers
from ..calibration_file import CalibrationFile, Rezero
from ..fit.points import Point
from ..fit.shift import drift_at
from .session_file import Session


def check(before: CalibrationFile | None, board: str, path: object) -> None:
    """FileError if a calibration that would be replaced belongs to another board."""
    if before is not None and before.board != board:
        raise FileError(
            f"{path} is the calibration of board {before.board}, but this is board {board}: name "
            "another file with --out, or another session with --session",
            path,
        )


def continues(session: Session, before: CalibrationFile) -> bool:
    """Return whether a calibration was made from the first presses of a session."""
    fitted = [p for p in session.points if p.kind not in ("choose", "joint")]
    known = [p for p in fitted if datetime.fromisoformat(p.time) <= before.date]
    if not known or session.conditions != before.conditions:
        return False
    marks = before.marks.logs if before.marks else ()
    return all(
        tuple(np.log2(p.counts).round(6).tolist()) in marks for p in known if p.kind == "mark"
    )


def undrifted(rezeros: list[Rezero]) -> Callable[[Point], Point]:
    """Return a function that removes the drift, as the last re-zero before it found it, of a press.

    The re-zeros, with what pressed the strip, begin with the oldest.
    """

    def change(point: Point) -> Point:
        time = datetime.fromisoformat(point.time)
        last = next((one for one in reversed(rezeros) if one.date <= time), None)
        if last is None:
            return point
        x_um = point.place_um if point.position_um is None else point.position_um
        scale = np.exp2(-drift_at(x_um, last.place_um, last.shifts))
        return replace(
            point,
            counts=tuple((scale * np.array(point.counts)).tolist()),
            variance=tuple((scale**2 * np.array(point.variance)).tolist()),
            trace=tuple((row[0], *(scale * np.array(row[1:])).tolist()) for row in point.trace),
        )

    return change


def carried(
    new: CalibrationFile,
    before: CalibrationFile | None,
    session: Session,
    say: Callable[[str], None],
) -> CalibrationFile:
    """Return a calibration with what it does not measure itself, from the one that it replaces.

    `new` is from the presses of the session, without drift. ``say(line)`` shows what cannot be
    taken over.
    """
    if before is None:
        return new
    strains = {r.strain_ppm for r in before.residuals} - {r.strain_ppm for r in new.residuals}
    for strain_ppm in sorted(strains):
        percent = f"{strain_ppm / 10_000:g}"
        say(
            f"the calibration at {percent} % strain is not taken over, because this session has no "
            f"presses for it: run 'spots calibrate strain --strain-percent {percent}'"
        )
    if continues(session, before):
        if new.joint is None:
            new = replace(new, joint=before.joint, joint_marks=before.joint_marks)
        if before.rezeros:
            new = replace(new, original=new.lines, rezeros=before.rezeros)
        return pressers.used_as(new, before)
    if new.joint is None and before.joint is not None:
        say("the joint is taken over without its marks: run 'spots calibrate joint' to make them")
        new = replace(new, joint=before.joint)
    if before.rezeros:
        say("the re-zeros are not taken over, because all presses are new")
    return new
