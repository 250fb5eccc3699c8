"""A simulated person who calibrates a simulated strip by hand, in a terminal that nobody sees."""

from __future__ import annotations

import argparse
import io
from functools import partial

from rich.console import Console

from spots.calibrate import calibration_file
from spots.calibrate.session import steps
from spots.calibrate.session.bench import Bench
from spots.calibrate.session.guide import Guide
from spots.calibrate.session.presser import Presser
from spots.calibrate.session.session_file import Session
from spots.common import atomic

from .person import Habits, Person, follow
from .stage import Stage

PRESSES = 45  # of a session
_USUAL = Habits()
_PATIENCE_S = 25.0  # timeout of a press; longer than the delays of the person


class _Terminal(io.StringIO):
    def __init__(self, person: Person):
        super().__init__()
        self._person, self._question = person, ""

    def write(self, text: str) -> int:
        self._question = text.strip() or self._question
        for line in text.splitlines():
            self._person.hear(line)
        return super().write(text)

    def readline(self, size: int = -1) -> str:
        return self._person.answer(self._question) + "\n"


def calibrate_by_hand(
    stage: Stage,
    seed: int,
    habits: Habits = _USUAL,
    count: int = PRESSES,
    kind: str = "fine",
) -> calibration_file.CalibrationFile:
    """Let a simulated person calibrate a strip, at the present settings of its board.

    The stage itself does not press. The session is ``fine``, with a scale, or ``rough``, without
    one. SpotsError if it gives no calibration.
    """
    person = Person(partial(follow, stage.held), stage.length_um / 1000, habits, seed)
    terminal = _Terminal(person)
    guide = Guide(Console(file=terminal, width=200), stdin=terminal)
    presser = Presser(guide)
    presser.patience_s = _PATIENCE_S
    with atomic.temporary() as folder:
        path = folder / "hand.toml"
        bench = Bench(stage.reader, presser, guide, stage.length_um, path)
        options = argparse.Namespace(channels=None, keep_settings=True)
        try:
            steps.calibrate(bench, Session(path.with_suffix(".jsonl")), kind, count, None, options)
        finally:
            vars(stage.held).pop("presses", None)  # the path of the person's finger ends
            stage.release()
        return calibration_file.load(path)
