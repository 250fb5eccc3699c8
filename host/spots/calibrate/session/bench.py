"""A board and a person: asks for a press of the strip, waits until it is steady, and reads it.

A presser (a person or a machine) presses the strip on request. A hold is a time in which the force
is steady. A press with two forces has two holds. A short reading lasts 0.24 s, or 8 samples if
these take longer. A longer reading is the mean of several short readings.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...errors import CalibrationError
from ..fit.points import Wanted
from .dialog import Dialog
from .judge import BadPressError, Judge, TooDarkError, samples_of
from .presser import Presser
from .session_file import Session
from .spectra import DARK_S, Reading, SpectrumReader, mean

TRIES = 5  # attempts at a press before the session ends with an error
_PARTING = 0.97  # largest ratio of the light of two successive short readings, while guides part
_LEFT = 1 / 16  # of the light of a press: less is light of contact that sticks after a lift
_CHANGED = 1.25  # least ratio of the light before and after a change of the force
CONTINUES = "the presses taken so far are stored; start the session again to continue"


@dataclass
class Held:
    """A press while it is held, and its `reading` when it is steady.

    `trace` has all short readings: time in s by the clock of `Board.now_s`, then the six counts.
    `holds` has start and end of each hold by the same clock; one hold for each force.
    """

    wanted: Wanted
    trace: list[tuple[float, ...]] = field(default_factory=list)
    holds: list[tuple[float, float]] = field(default_factory=list)
    reading: Reading = field(init=False)

    @property
    def brightest(self) -> float:
        """Largest sum of the counts until now."""
        return max((sum(counts) for _, *counts in self.trace), default=0.0)


def _the_same(held: Held, bad: BadPressError) -> Wanted | None:
    return held.wanted


@dataclass
class Bench:
    """A board whose strip is pressed on request, for ``spots calibrate`` or ``spots rezero``.

    `length_um` is that of the strip at rest; `path` is its calibration file. `asked` is the number
    of requested presses, also of those that were refused.
    """

    reader: SpectrumReader
    presser: Presser
    guide: Dialog
    length_um: float
    path: Path
    asked: int = 0
    _is_parted: bool = False  # keys may have been typed before

    @property
    def window(self) -> int:
        """Number of samples in a short reading of a press.

        A longer reading is the mean of several short readings.
        """
        return samples_of("", self.reader.info["exposure_us"])

    def untouched(self, dark_s: float = 0.0) -> None:
        """Measure the dark frame and the light of the untouched strip.

        `dark_s` is that of `SpectrumReader.set_up`.
        """
        self.guide.say("taking dark frames: touch nothing")
        self.part()
        self.reader.set_up(dark_s=dark_s, untouched=True)
        light = self.reader.baseline
        if light.any():
            self.guide.say(
                f"light without a press, up to {light.max():.1f} counts: dust, or the guides "
                "touch; it is subtracted"
            )

    def with_joint(self, lines: Iterable[str]) -> None:
        """Take dark frames of a strip that the indenter of a joint always presses.

        The light of the untouched strip is that of the calibration with these lines.
        """
        self.guide.say("taking dark frames: do not turn the joint")
        self.reader.set_up(dark_s=DARK_S)
        self.reader.use_baseline(lines)

    def begin(self, title: str, count: int, length_um: float | None = None) -> None:
        """Show `title` above the next `count` presses; `length_um` is that of a stretched strip."""
        plan = self.reader.conditions.plan
        self.guide.begin(title, count, plan, length_um or self.length_um)

    def take(
        self,
        wanted: Wanted,
        session: Session | None = None,
        instead: Callable[[Held, BadPressError], Wanted | None] = _the_same,
        given_up: str = CONTINUES,
    ) -> Held:
        """Ask for presses until one press is valid; on return, the strip is still pressed.

        A press is judged by `Judge`, with the earlier ones of a session. ``instead(held, bad)``
        returns what to ask for after a bad press; None to give up. CalibrationError then, or if
        none of `TRIES` attempts gave a valid press; its sentence ends with `given_up`.
        """
        for _ in range(TRIES):
            self.guide.want(wanted)
            self.asked += 1
            self.part()
            self.presser.press(wanted)
            held = Held(wanted)
            try:
                self.read(held, session)
                return held
            except BadPressError as bad:
                trouble = f"{wanted}: {bad}"
                self.lift(wanted)
                found = instead(held, bad)
            if found is None:
                break
            wanted = found
            self.guide.say(f"{trouble}; try again")
        raise CalibrationError(f"{trouble}; {given_up}")

    def read(self, held: Held, session: Session | None = None) -> None:
        """Read the present press, with all its holds; `BadPressError` if it is not valid."""
        judge = Judge(held.wanted, self.reader.conditions, session)
        with self.reader.watched():
            held.reading = self._steady(held, judge)
        self._hold(held)
        judge.fits(held.reading)
        if held.wanted.then_mN:
            self._change(held, judge)

    def _change(self, held: Held, judge: Judge) -> None:
        """Ask for the second force of a press, without a release; wait until it is steady."""
        before = sum(held.trace[-1][1:])
        self.presser.change(held.wanted)
        with self.reader.watched():
            self._steady(held, judge, before)

    def lift(self, wanted: Wanted) -> None:
        """Release the strip after a press; the indenter of a joint stays on it."""
        if wanted.angle_deg is None:
            self.release()

    def release(self) -> None:
        """Ask the presser to release the strip, and wait until the strip is released.

        CalibrationError if the strip stays bright after the request.
        """
        peak = self.reader.read(2).counts.max()
        self.presser.release()
        end_s = self.reader.board.now_s() + self.presser.patience_s
        while self.reader.board.now_s() < end_s:
            reading = self.reader.read(2)
            if reading.counts.max() < max(1.0, peak / 2):
                self._is_parted = False
                return
            self.guide.watch(reading, "release", 0.0)
        raise CalibrationError(
            "the strip stays bright after the release: shade the strip, and do not press it"
        )

    def part(self) -> None:
        """Wait until the guides have parted after the last press.

        Contact of soft guides can stick for some seconds, and its light looks like a weak press.
        The wait ends when there is no light, or when it hardly falls: then it has another cause.
        """
        before = np.inf
        while not self._is_parted:
            reading = self.reader.read(self.window)
            light = reading.counts.sum()
            self._is_parted = reading.unlit or light > _PARTING * before
            before = light

    def _short(self, held: Held) -> Reading:
        """Return the next short reading, and append it to the trace if the press has begun."""
        reading = self.reader.read(self.window)
        if held.trace or not reading.unlit:
            row = round(self.reader.board.now_s(), 3), *reading.counts.round(2).tolist()
            held.trace.append(row)
        return reading

    def _hold(self, held: Held) -> None:
        """Continue to read a press until its last hold is as long as wanted."""
        begin_s, end_s = held.holds.pop()
        hold_s = held.wanted.hold_s
        while end_s - begin_s < hold_s:
            reading = self._short(held)
            if reading.unlit:
                raise BadPressError(f"the press ended too early: hold it for {hold_s:.0f} s")
            end_s = held.trace[-1][0]
            self.guide.watch(reading, None, min((end_s - begin_s) / hold_s, 1.0))
        held.holds.append((begin_s, end_s))

    def _steady(self, held: Held, judge: Judge, before: float | None = None) -> Reading:
        """Wait for a steady press and return its reading.

        `before` is the sum of the counts before a change of the force; None without a change.
        """
        end_s = self.reader.board.now_s() + self.presser.patience_s
        reason: BadPressError = TooDarkError("no press is seen")
        samples = samples_of(held.wanted.kind, self.reader.info["exposure_us"])
        long = -(-samples // self.window)
        needed, steady = max(long, self.presser.steady), []
        while len(steady) < needed:
            if not steady and self.reader.board.now_s() >= end_s:
                raise reason
            reading, trouble = self._short(held), None
            light = reading.counts.sum()
            if before is not None and reading.unlit:
                raise BadPressError("the strip was released: change the force without lifting")
            try:
                judge.steady(reading)
                if before is None and light < _LEFT * held.brightest:
                    raise BadPressError("the press ended too early: hold it")
                if before is not None and 1 / _CHANGED < light / before < _CHANGED:
                    raise BadPressError("the force has not changed: change it without lifting")
                steady.append(reading)
            except BadPressError as bad:
                reason, trouble, steady = bad, str(bad), []
            self.guide.watch(reading, trouble, len(steady) / needed)
        if held.trace:
            held.holds.append((held.trace[-len(steady)][0], held.trace[-1][0]))
        found = mean(steady[-long:])
        judge.lit(found)
        return found
