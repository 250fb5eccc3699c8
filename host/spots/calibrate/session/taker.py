"""Takes presses with a bench: shows what to press, judges the reading, adds it to the session."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from ..fit.points import Wanted, presses
from ..fit.presses import Noise
from . import baseline
from .bench import Bench, judge_force, judge_place
from .session_file import Session, point
from .spectra import Reading

_JUDGES = {"position": judge_place, "strain": judge_place, "force": judge_force}
_NOISE_POINTS = 6  # least number of presses that show the noise of the sensor


@dataclass(frozen=True)
class Taker:
    """Takes presses with `bench` for `session`."""

    bench: Bench
    session: Session

    def untouched(self, dark_s: float = 0.0) -> None:
        """Measure the dark frame and the light of the untouched strip.

        `dark_s` is that of `SpectrumReader.set_up`.
        """
        reader, guide = self.bench.reader, self.bench.guide
        guide.say("taking dark frames: touch nothing")
        self.bench.part()
        reader.set_up(dark_s=dark_s, untouched=True)
        if reader.baseline.any():
            guide.say(
                f"light without a press, up to {reader.baseline.max():.1f} counts: dust, or the "
                "guides touch; it is subtracted"
            )

    def begin(self, title: str, count: int, length_um: float | None = None) -> None:
        """Show `title` above the next `count` presses; `length_um` as for `series`."""
        plan = self.bench.reader.conditions.plan
        self.bench.guide.begin(title, count, plan, length_um or self.bench.length_um)

    def series(self, title: str, row: list[Wanted], length_um: float | None = None) -> None:
        """Take those presses of the list `row` that the session lacks; show `title` above them.

        `length_um` is the length of the strip, if it is stretched.
        """
        self.begin(title, len(row), length_um)
        for wanted in row:
            if self.session.has(wanted, self.bench.reader.conditions.plan):
                self.bench.guide.skip()
                continue
            noise = self.noise()
            reading = self.bench.take(wanted, noise, partial(self._judge, wanted, noise))
            self.add(wanted, reading, length_um=self.bench.length_um)
            self.bench.release()

    def add(self, wanted: Wanted, reading: Reading, **measured) -> None:
        """Add a press to the session, with the measured fields of its `Point`."""
        self.session.add(point(wanted, reading, self.bench.reader.conditions, **measured))
        baseline.check(self.session)
        self.bench.guide.taken(wanted, reading)

    def noise(self) -> Noise | None:
        """Return the noise of the sensor, or None if there are too few presses to estimate it."""
        known = [p for p in self.session.points if p.kind != "choose"]
        if len(known) < _NOISE_POINTS:
            return None
        read = presses(known)
        found = Noise.of(read)
        # Few presses with one force do not separate the two parts of the noise. A constant part
        # that is too small would reject weak presses.
        return Noise(max(found.constant, float(np.median(read.variance))), found.per_count)

    def _judge(self, wanted: Wanted, noise: Noise | None, reading: Reading) -> None:
        known = self.session.of(wanted.kind, wanted.strain_ppm)
        if wanted.kind == "force":
            known = [p for p in known if p.place_um == wanted.place_um]
        if wanted.kind in _JUDGES and len(known) > 1:
            others = presses(known)
            noise = noise or Noise.of(others)
            taken = self.session.referred(wanted, reading, self.bench.reader.conditions)
            _JUDGES[wanted.kind](others, wanted, np.array(taken.counts), noise, self.bench.window)


def along(length_um: float, count: int) -> list[float]:
    """Return `count` positions in um from end to end of a strip, rounded to 0.1 mm for a ruler."""
    return np.round(np.linspace(0, length_um, count), -2).tolist()
