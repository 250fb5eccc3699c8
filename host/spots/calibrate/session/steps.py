"""The steps of a calibration session: take the missing presses, fit them, store the calibration."""

from __future__ import annotations

import argparse

import numpy as np

from ...advice.calibrated import NO_FINGER
from ...errors import CalibrationError
from .. import calibration_file as file
from .. import pressers
from ..fit.fit import PLACES_MIN
from ..fit.points import Wanted
from ..fit.presses import ALL_MARKS, FIRM_MN, FORCE_PLACES, FULL_MN
from . import carry
from .bench import Bench
from .dialog import UndoError
from .hand import NextBest
from .joint import ANGLES_MIN
from .make import make, presser_of
from .order import Planned, along, run
from .rezero import rezero, use
from .session_file import Session
from .settle import settle
from .spectra import DARK_S
from .turn import turn_joint

LENGTH_UM = 85_000.0  # usual length of a strip
_RULER_UM = 100  # resolution of a ruler
# For each kind: default and least number of presses, positions, forces, or angles per direction.
COUNTS = {
    "fine": (39, PLACES_MIN),
    "rough": (12, 8),
    "position": (17, PLACES_MIN),
    "strain": (17, PLACES_MIN),
    "force": (16, 14),
    "joint": (11, ANGLES_MIN),
}
# The light begins a little below the least force that gives light in all channels, and grows
# steeply there. So the forces of a series, minus this share of the least force, are spaced
# geometrically.
_DARK_SHARE = 0.85
_LEAST_MARGIN = 1.05  # the measured least force is increased by this factor


def calibrate(
    bench: Bench,
    session: Session,
    kind: str,
    count: int,
    strain_percent: float | None,
    options: argparse.Namespace,
) -> None:
    """Take the missing presses of one kind; store a calibration if the session is then complete.

    `kind` is ``fine`` (with a scale) or ``rough`` (without) for presses by hand; or ``position``,
    ``strain``, ``force`` or ``joint``. `count` is the number of presses by hand, of positions, of
    forces, or of angles in each direction; 0 for the default. The options are ``channels``,
    names or None, and ``keep_settings``, whether to keep gain and LED current. SpotsError if the
    session has another board or other settings, or its presses give no calibration.
    """
    undone = False
    with session.locked():
        while True:
            try:
                if undone:
                    bench.release()
                    undone = False
                return _run(bench, session, kind, count or COUNTS[kind][0], strain_percent, options)
            except UndoError:
                dropped, undone = session.undo(), True
                bench.guide.say(f"undone: {dropped}" if dropped else "there is no press to undo")


def _run(bench: Bench, session: Session, kind: str, count: int, strain_percent, options) -> None:
    session.check(bench.reader.conditions, bench.length_um if kind != "joint" else None)
    before = file.KIND.present(bench.path)
    carry.check(before, bench.reader.conditions.board, bench.path)
    if before and (kind == "joint" or carry.continues(session, before)):
        session.refer(carry.undrifted(pressers.with_presser(before, before.presser)))
    if kind == "joint":
        return turn_joint(bench, session, count)
    if kind != "strain":
        settle(bench, session, options, kind)
    elif missing := missing_step(session):
        raise CalibrationError(f"calibrate position and force before strain: first run {missing}")
    if kind == "position":
        _places(bench, session, "position", count, 0)
    elif kind == "force":
        _forces(bench, session, count)
    elif kind == "strain":
        _places(bench, session, "strain", count, round(10_000 * strain_percent))
        bench.presser.stretch(0, bench.length_um)
    else:
        if kind == "fine" and session.points and presser_of(session) == file.FINGER:
            bench.guide.say("this session began with a finger: press with the same finger")
        bench.untouched(DARK_S)
        run(NextBest(bench, session, count, COUNTS[kind][1], kind == "rough"))
        return _finish(bench, session)
    if missing := missing_step(session):
        return bench.guide.say(f"next: {missing}")
    if not session.of("hand"):
        _marks(bench, session)
    _finish(bench, session)


def missing_step(session: Session) -> str | None:
    """Return the command that takes the next missing presses; None if no press is missing."""
    if len(session.of("hand")) >= COUNTS["rough"][1]:
        return None
    for kind, name in (("position", "place_um"), ("force", "force_mN")):
        taken = {getattr(p, name) for p in session.of(kind)}
        end_um = (session.length_um or 0) - _RULER_UM if kind == "position" else 0
        if len(taken) < COUNTS[kind][1] or max(taken) < end_um:
            return f"'spots calibrate {kind} --session {session.path}'"
    return None


def _places(bench: Bench, session: Session, kind: str, count: int, strain_ppm: int) -> None:
    """Take `count` presses along the strip, which has the strain `strain_ppm`.

    `kind` is the kind of the presses, see `points.Wanted`.
    """
    length_um = bench.length_um * (1 + strain_ppm * 1e-6)
    bench.presser.stretch(strain_ppm, length_um)
    bench.untouched()
    title = f"positions at {strain_ppm / 10_000:g} % strain" if strain_ppm else "positions"
    row = [
        Wanted(kind=kind, place_um=place_um, force_mN=FIRM_MN, strain_ppm=strain_ppm)
        for place_um in along(length_um, count)
    ]
    bench.begin(title, count, length_um)
    run(Planned(bench, session, row))


def _forces(bench: Bench, session: Session, count: int) -> None:
    """Take presses with `count` different forces at each of a few positions."""
    bench.untouched()
    places_um = [round(share * bench.length_um, -2) for share in sorted(FORCE_PLACES, reverse=True)]
    # The first press of a session has the least force, at the dimmest place.
    least_mN = min((p.force_mN for p in session.of("force")), default=None)
    if least_mN is None:
        dimmest = Wanted(kind="force", place_um=places_um[0], force_mN=FULL_MN)
        bench.begin("least force", 1)
        bench.guide.want(dimmest)
        found_mN = bench.presser.least_mN(dimmest, bench.reader)
        least_mN = round(_LEAST_MARGIN * found_mN, 1)
    dark_mN = _DARK_SHARE * least_mN
    steps_mN = np.geomspace(least_mN - dark_mN, FULL_MN - dark_mN, count)
    row = [
        Wanted(kind="force", place_um=place_um, force_mN=force_mN)
        for place_um in places_um
        for force_mN in (dark_mN + steps_mN).round(1).tolist()
    ]
    bench.begin("forces", len(row))
    run(Planned(bench, session, row))


def _marks(bench: Bench, session: Session) -> None:
    """Take presses at the marks, which a later re-zero repeats."""
    bench.untouched(DARK_S)
    places_um = [round(share * bench.length_um, -2) for share in ALL_MARKS]
    row = [Wanted(kind="mark", place_um=x, force_mN=FIRM_MN) for x in places_um]
    bench.begin("marks for a re-zero", len(row))
    run(Planned(bench, session, row))


def _finish(bench: Bench, session: Session) -> None:
    """Fit all presses of the session, write the calibration file, and upload its lines."""
    before = file.KIND.present(bench.path)
    calibration = make(session, bench.guide.say)
    calibration = carry.carried(calibration, before, session, bench.guide.say)
    file.save(calibration, bench.path, before)
    for residual in calibration.residuals:
        force = residual.force_rms_mN
        bench.guide.say(
            f"errors at {residual.strain_ppm / 10_000:g} % strain: position "
            f"{residual.position_rms_um:.0f} um rms"
            + ("" if force is None else f", force {force:.0f} mN rms")
        )
    bench.reader.restore()  # the board saves its settings with the calibration
    name = file.send(bench.reader.board, calibration)
    bench.guide.say(f"{bench.path}: the board uses calibration {name}, and has stored it")
    if pressers.lacks_finger(calibration):
        _with_finger(bench, calibration)


def _with_finger(bench: Bench, made: file.CalibrationFile) -> None:
    """End a session with an indenter with a re-zero by the finger that will press the strip.

    Skin changes the colour of a press. Who skips these presses is told.
    """
    presser = bench.presser.next_presser()
    if presser is None:
        return bench.guide.say(f"{NO_FINGER}: run 'spots rezero' before a finger uses the strip")
    if presser == made.presser:
        new = pressers.used_by(made, presser)
    else:
        new = _by_finger(bench, made, presser)
        bench.reader.restore()
    name = use(bench, made, new)
    bench.guide.say(f"{bench.path}: the board uses calibration {name}, for {pressers.ONE[presser]}")


def _by_finger(bench: Bench, made: file.CalibrationFile, presser: file.Presser):
    while True:
        try:
            return rezero(bench, made, presser=presser)
        except UndoError:
            bench.release()
            bench.guide.say("the marks begin again")
