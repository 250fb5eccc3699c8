"""Practice of a session by hand: a simulated finger presses, and a person answers the questions.

The person reads a simulated ruler and scale. At the end, the calibration is compared with the
simulated strip. All files are in a temporary directory.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass

from ...common import atomic
from ...link.ports import SIMULATED, offered
from .. import calibration_file as file
from .bench import Bench
from .dialog import Dialog
from .session_file import Session
from .steps import COUNTS, calibrate

KINDS = ("fine", "rough")


@dataclass(frozen=True)
class Score:
    """Errors of a calibration on a simulated strip, and of the answers that it was made from.

    The former are those of the calibrated board; its error of forces is None for a rough session,
    whose forces are relative. The latter are those of what the person read off ruler and scale;
    None without a scale.
    """

    position_rms_um: float
    position_worst_um: float
    force_rms_mN: float | None
    read_rms_um: float
    read_rms_mN: float | None

    def __str__(self) -> str:
        force = read_force = ""
        if self.force_rms_mN is not None:
            force = f", force {self.force_rms_mN / 1000:.2f} N rms"
        if self.read_rms_mN is not None:
            read_force = f" and {self.read_rms_mN / 1000:.2f} N"
        return (
            f"score: position {self.position_rms_um / 1000:.2f} mm rms, "
            f"{self.position_worst_um / 1000:.2f} mm at most{force}; your answers differ by "
            f"{self.read_rms_um / 1000:.2f} mm{read_force} rms from ruler and scale"
        )


@dataclass(frozen=True)
class Practice:
    """A simulated strip with a simulated finger.

    The ability ``practice(options, path, guide)`` of the simulator (see `link.ports`) returns a
    context manager that yields one. `path` is the calibration file to write.

    The presser of the bench asks the person what ruler and scale show. ``score(session,
    calibration)`` returns the `Score` of a finished session.
    """

    bench: Bench
    score: Callable[[Session, file.CalibrationFile], Score]


def practise(options: argparse.Namespace, kind: str, count: int, guide: Dialog) -> Score:
    """Run a session by hand on a simulated strip, and return the score.

    The options are ``sensor`` and ``seed`` of the simulated strip; ``channels`` and
    ``keep_settings`` as for `steps.calibrate`; ``length_mm``, which must be None or the length of
    the simulated strip. `kind` is ``fine`` or ``rough``; `count` is 0 for the default. SpotsError
    if there is no simulator, or the session ends early.
    """
    begin: Callable[..., AbstractContextManager[Practice]] = offered(SIMULATED, "practice")
    with atomic.temporary() as folder:
        session = Session(folder / "practice.jsonl")
        out = session.path.with_suffix(".toml")
        with begin(options, out, guide) as practice:
            calibrate(practice.bench, session, kind, count or COUNTS[kind][0], None, options)
            score = practice.score(session, file.load(out))
    guide.say(str(score))
    guide.say("this was practice: strip and board were simulated, and their files are removed")
    return score
