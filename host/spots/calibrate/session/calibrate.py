"""``spots calibrate`` and ``spots rezero``: guided sessions with a strip, and with its joint."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from spots_device.sensor.smux import smux_map

from ...common import atomic
from ...common.signals import stop_explained
from ...errors import SettingError
from ...link.connect import open_named
from ...link.ports import SIMULATED, offered
from .. import pressers
from ..calibration_file import KIND, CalibrationFile, load
from .bench import Bench
from .guide import Guide
from .practice import KINDS, practise
from .presser import Presser
from .rezero import marks_of, rezero, use
from .session_file import Session
from .spectra import SpectrumReader
from .steps import COUNTS, LENGTH_UM, calibrate

_SESSION = "calibration.jsonl"  # default session file
_PLACES_MAX = 1000


def calibrate_command(options: argparse.Namespace) -> None:
    """Run ``spots calibrate`` with the options that `cli` parsed."""
    kind = "rough" if options.rough else options.kind
    if options.rough and options.kind != "fine":
        raise SettingError(f"--rough cannot be used with '{options.kind}': leave out one of them")
    usual, least = COUNTS[kind]
    count = usual if options.places is None else options.places
    if not least <= count <= _PLACES_MAX:
        raise SettingError(f"--places must be from {least} to {_PLACES_MAX} for '{kind}'")
    if (kind == "strain") != (options.strain_percent is not None):
        raise SettingError(
            "'spots calibrate strain' and --strain-percent belong together: give both, or leave "
            "out both"
        )
    if options.channels:
        try:
            smux_map(options.channels.split(","))
        except ValueError as error:
            raise SettingError(f"--channels: {error}") from None
    if options.practice:
        return _practise(options, kind, count)
    session = Session(Path(options.session or _SESSION))
    out = Path(options.out) if options.out else session.path.with_suffix(".toml")
    atomic.distinct({"--session": session.path, "--out": out})
    atomic.check_writable(session.path, append=True)
    atomic.check_writable(out, KIND)
    with stop_explained(session.progress), opened(options, session, out) as bench:
        calibrate(bench, session, kind, count, options.strain_percent, options)


def rezero_command(options: argparse.Namespace) -> None:
    """Run ``spots rezero`` with the options that `cli` parsed."""
    path = Path(options.calibration)
    made = load(path)
    atomic.check_writable(path)
    force_mN = options.force_N and 1000 * options.force_N
    chosen = {
        "presses": options.presses,
        "marks": int(options.marks),
        "force_mN": force_mN,
        "joint": options.joint,
        "presser": options.presser,
    }
    new = pressers.used_by(made, options.use) if options.use else None
    if new is None:
        marks_of(made, path, chosen["marks"], options.joint, force_mN)  # before the board is opened
    with opened(options, made, path) as bench:
        if new is None:
            unchanged = f"{path} and the board are unchanged; run the command again"
            with stop_explained(lambda: unchanged):
                new = rezero(bench, made, **chosen)
        bench.reader.restore()
        name = use(bench, made, new)
        tables = f"the tables are for {pressers.ONE[options.use]}"
        did = tables if options.use else new.rezeros[-1].drift
        bench.guide.say(f"{path}: {did}; the board stores calibration {name}")


def _practise(options: argparse.Namespace, kind: str, count: int) -> None:
    if kind not in KINDS:
        raise SettingError(f"--practice has no '{kind}': leave it out, or use --rough")
    if options.port not in (None, SIMULATED) or options.session or options.out:
        raise SettingError(
            "--practice presses a simulated strip and writes no file: leave out --port, --session "
            "and --out"
        )
    with Guide() as guide:
        practise(options, kind, count, guide)


@contextmanager
def opened(
    options: argparse.Namespace, made: Session | CalibrationFile, path: Path
) -> Iterator[Bench]:
    """Open the board that `options` selects; a person or a machine will press its strip.

    ``length_mm`` of the options is the length of the strip; None for the length in `made`, or 85 mm
    if `made` has no length. The board is closed on exit. SpotsError if a file is invalid, or the
    board cannot be opened. If a machine presses the strip, its kind of port has the ability
    ``calibration_setup(options, made, path, guide)``, see `link.ports`; it returns a `Bench`.
    `path` is the calibration file to write.
    """
    set_up = offered(options.port, "calibration_setup") or _by_hand
    bench = set_up(options, made, path, Guide())
    with bench.reader.board, bench.reader, bench.guide:
        yield bench


def _by_hand(options, made: Session | CalibrationFile, path: Path, guide: Guide) -> Bench:
    reader = SpectrumReader(open_named(options))
    length_um = 1000 * (options.length_mm or 0) or made.length_um or LENGTH_UM
    return Bench(reader, Presser(guide), guide, length_um, path)
