"""``spots calibrate``: guided sessions for position, force, strain and joint, on any board."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from ..errors import SpotsError
from ..link.connect import open
from ..link.ports import offered
from .guide import Guide
from .presser import PersonPresser
from .session import Session
from .spectra import SpectrumReader
from .steps import COUNTS, LEAST_COUNTS, Setup, calibrate

_LENGTH_MM = 85.0


def calibrate_command(options: argparse.Namespace) -> None:
    """Run ``spots calibrate`` with the options that `cli` parsed."""
    count = COUNTS[options.kind] if options.places is None else options.places
    if count < LEAST_COUNTS[options.kind]:
        raise SpotsError(f"--places: {options.kind} needs {LEAST_COUNTS[options.kind]} or more")
    if (options.kind == "strain") != (options.strain_percent is not None):
        raise SpotsError("give --strain-percent with 'strain', and only there")
    session = Session(Path(options.session))
    out = Path(options.out) if options.out else session.path.with_suffix(".toml")
    if out.resolve() == session.path.resolve():
        raise SpotsError(
            f"the calibration would replace the session {session.path}: name another file with "
            "--out"
        )
    with opened(options, session, out, Guide()) as setup:
        calibrate(setup, options.kind, count, options.strain_percent, options)


@contextmanager
def opened(options: argparse.Namespace, made, out: Path, guide: Guide) -> Iterator[Setup]:
    """Open the board that options name, with whoever presses its strip.

    Parameters
    ----------
    options : argparse.Namespace
    made : Session or CalibrationFile
        What the board was calibrated with: ``conditions`` and ``length_um``.
    out : Path
    guide : Guide

    Yields
    ------
    Setup
        Board, presser and session; the board is closed at the end.

    Raises
    ------
    SpotsError
        If a file is wrong, or the board cannot be opened.
    """
    with ExitStack() as stack:
        set_up = offered(options.port, "calibration_setup") or _by_hand
        setup = set_up(options, made, out, guide)
        stack.enter_context(setup.reader.board)
        stack.enter_context(guide)
        stack.callback(_give_back, setup.reader)
        yield setup


def _give_back(reader: SpectrumReader) -> None:
    with suppress(SpotsError):  # the error of a lost board is reported elsewhere
        reader.give_back()


def _by_hand(options, session: Session, out: Path, guide: Guide) -> Setup:
    reader = SpectrumReader(open(options.port))
    given_um = options.length_mm and 1000 * options.length_mm
    length_um = given_um or session.length_um or 1000 * _LENGTH_MM
    return Setup(reader, PersonPresser(guide), guide, session, length_um, out)
