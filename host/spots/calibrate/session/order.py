"""The loop that takes presses in an order, such as a planned list."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..fit.points import Wanted
from . import baseline
from .bench import CONTINUES, Bench, Held
from .judge import BadPressError
from .session_file import Session, point
from .spectra import Reading


class Order:
    """Which presses to take, and what to store of them.

    It is asked for the next press after the last one was stored. `session` has the earlier presses,
    with which each one is compared; None if there are none. `given_up` is that of `Bench.take`.
    """

    given_up = CONTINUES

    def __init__(self, bench: Bench, session: Session | None):
        self.bench, self.session = bench, session

    def __iter__(self) -> Iterator[Wanted]:
        raise NotImplementedError

    def instead(self, held: Held, bad: BadPressError) -> Wanted | None:
        """Return what to ask for after a bad press: the same one; None to end the session."""
        return held.wanted

    def store(self, held: Held, read: Wanted) -> None:
        """Store a valid press, which was at the place that was read off."""
        store(self.bench, self.session, read, held.reading, length_um=self.bench.length_um)


class Planned(Order):
    """The presses of a list that a session lacks."""

    def __init__(self, bench: Bench, session: Session, row: list[Wanted]):
        super().__init__(bench, session)
        self._row = row

    def __iter__(self) -> Iterator[Wanted]:
        for wanted in self._row:
            if self.session.has(wanted, self.bench.reader.conditions.plan):
                self.bench.guide.skip()
            else:
                yield wanted


def run(order: Order) -> None:
    """Take all presses of an order, and store them.

    CalibrationError if a press is invalid at every attempt, or the order has nothing to ask for.
    """
    bench = order.bench
    for wanted in order:
        read = None
        while read is None:  # a person may want to repeat the press
            held = bench.take(wanted, order.session, order.instead, order.given_up)
            bench.lift(held.wanted)
            wanted = held.wanted
            read = bench.presser.read_off(wanted, bench.length_um)
        order.store(held, read)


def store(bench: Bench, session: Session, wanted: Wanted, reading: Reading, **measured) -> None:
    """Add a press to the session, with the measured fields of its `Point`."""
    session.add(point(wanted, reading, bench.reader.conditions, **measured))
    baseline.check(session)
    bench.guide.taken(wanted, reading)


def along(length_um: float, count: int) -> list[float]:
    """Return `count` positions in um from end to end of a strip, rounded to 0.1 mm for a ruler."""
    return np.round(np.linspace(0, length_um, count), -2).tolist()
