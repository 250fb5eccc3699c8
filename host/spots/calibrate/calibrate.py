"""``spots calibrate``: guided sessions for position, force, strain and joint, on any board."""

from __future__ import annotations

import argparse
from contextlib import ExitStack, suppress
from pathlib import Path

from spots_sim.stage import Stage

from ..errors import SpotsError
from ..link.connect import VIRTUAL, open
from .guide import Guide
from .presser import PersonPresser, StagePresser
from .session import Session, settings
from .spectra import Reader
from .steps import COUNTS, LEAST_COUNTS, Setup, calibrate
from .take import Taker

_LENGTH_MM = 85.0


def run(options: argparse.Namespace) -> None:
    """Run ``spots calibrate`` with the options that `cli` parsed."""
    count = COUNTS[options.kind] if options.places is None else options.places
    if count < LEAST_COUNTS[options.kind]:
        raise SpotsError(f"--places: {options.kind} needs {LEAST_COUNTS[options.kind]} or more")
    if (options.kind == "strain") != (options.strain_percent is not None):
        raise SpotsError("say --strain-percent with 'strain', and only there")
    session = Session(Path(options.session))
    out = Path(options.out) if options.out else session.path.with_suffix(".toml")
    if out.resolve() == session.path.resolve():
        raise SpotsError(
            f"the calibration would replace the session {session.path}: name another file with "
            "--out"
        )
    guide = Guide()
    with ExitStack() as stack:
        if options.port == VIRTUAL:
            setup = _virtual(options, session, out, guide)
        else:
            setup = _real(options, session, out, guide)
        stack.enter_context(setup.reader.board)
        stack.enter_context(guide)
        stack.callback(_give_back, setup.reader)
        calibrate(setup, options.kind, count, options.strain_percent, options)


def _give_back(reader: Reader) -> None:
    with suppress(SpotsError):  # of a board that is gone another error tells
        reader.give_back()


def _virtual(options, session: Session, out: Path, guide: Guide) -> Setup:
    from spots_sim.files import ScenarioFile, SensorFile, load

    sensor = load(SensorFile, options.sensor)
    scenario = load(ScenarioFile, options.scenario)
    stage = Stage(sensor, options.seed)
    # The stage is the finger; of a scenario there remains how the strip lies.
    stage.held.bend_deg = scenario.bend_deg
    # A virtual board forgets when it ends: it is as the session left it.
    made = session.conditions
    if made is not None and made.board == stage.reader.conditions.board:
        stage.board.command("set " + settings(made))
        stage.reader.set_up()
    length_um = 1000 * (options.length_mm or sensor.length_mm)
    return _setup(stage.reader, StagePresser(stage), guide, session, length_um, out)


def _real(options, session: Session, out: Path, guide: Guide) -> Setup:
    reader = Reader(open(options.port))
    told_um = options.length_mm and 1000 * options.length_mm
    length_um = told_um or session.length_um or 1000 * _LENGTH_MM
    return _setup(reader, PersonPresser(guide), guide, session, length_um, out)


def _setup(reader, presser, guide, session, length_um, out) -> Setup:
    taker = Taker(reader, presser, guide)
    return Setup(reader, presser, guide, session, taker, length_um, out)
