"""Takes the presses of a calibration session in an order: a planned list, or the next best one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

import numpy as np

from ..fit.points import Wanted
from . import baseline
from .bench import Bench, Held
from .judge import BadPressError
from .session_file import Session, point
from .spectra import Reading


class Order(Protocol):
    """Which presses to take. It is asked for the next one after the last one was stored."""

    def __iter__(self) -> Iterator[Wanted]: ...

    def instead(self, held: Held, bad: BadPressError) -> Wanted | None:
        """Return what to ask for after a bad press; None to end the session."""


class Planned:
    """The presses of a list that a session lacks."""

    def __init__(self, bench: Bench, session: Session, row: list[Wanted]):
        self._bench, self._session, self._row = bench, session, row

    def __iter__(self) -> Iterator[Wanted]:
        for wanted in self._row:
            if self._session.has(wanted, self._bench.reader.conditions.plan):
                self._bench.guide.skip()
            else:
                yield wanted

    def instead(self, held: Held, bad: BadPressError) -> Wanted | None:
        """Return the same press."""
        return held.wanted


def run(bench: Bench, session: Session, order: Order) -> None:
    """Take all presses of an order, and store them in the session.

    CalibrationError if a press is invalid at every attempt, or the order has nothing to ask for.
    """
    for wanted in order:
        read = None
        while read is None:  # a person may want to repeat the press
            held = bench.take(wanted, session, order.instead)
            bench.release()
            wanted = held.wanted
            read = bench.presser.read_off(wanted, bench.length_um)
        traced = {}
        if read.kind == "hand" and read.force_mN:  # the silicone is fitted to these
            traced = {"trace": tuple(held.trace), "holds": tuple(held.holds)}
        store(bench, session, read, held.reading, length_um=bench.length_um, **traced)


def store(bench: Bench, session: Session, wanted: Wanted, reading: Reading, **measured) -> None:
    """Add a press to the session, with the measured fields of its `Point`."""
    session.add(point(wanted, reading, bench.reader.conditions, **measured))
    baseline.check(session)
    bench.guide.taken(wanted, reading)


def along(length_um: float, count: int) -> list[float]:
    """Return `count` positions in um from end to end of a strip, rounded to 0.1 mm for a ruler."""
    return np.round(np.linspace(0, length_um, count), -2).tolist()
