"""Measures presses of a strip: waits until a press is steady, then reads and validates its counts.

A presser (a person or a machine) presses the strip on request. A hold is a time in which the force
is steady. A press with two forces has two holds. A short reading lasts 0.24 s, or 8 samples if
these take longer. A longer reading is the mean of several short readings.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...errors import CalibrationError
from ..fit.points import Wanted
from ..fit.presses import Noise, Presses
from .dialog import Dialog
from .presser import Presser
from .spectra import Reading, SpectrumReader, mean

TRIES = 5  # attempts at a press before the session ends with an error
_WINDOW_S = 0.24  # duration of a short reading
# Duration of a reading of a finger's press, by kind of press. It averages the finger's tremor.
_LONG_S = {"mark": 3.0, "hand": 0.75}
_WINDOW_MIN = 8  # samples
_DRIFT_MAX = 0.01  # largest change of the light in a short reading, in log2 units: 0.7 %
# The same limit for a finger, whose tremor looks like a slow drift in a short reading.
_FINGER_DRIFT_MAX = 0.05
_TREMBLE_MAX = 6.0  # largest ratio of the variance of a steady press to that of the noise
_SIGMAS = 5.0  # tolerance of noise in all checks, in standard deviations
_OUTLIER = 0.3  # log2: largest difference from the light expected from other presses
_VARIANCE_MIN = 0.25  # counts**2 of a sample; used while the noise is unknown
_PARTING = 0.97  # largest ratio of the light of two successive short readings, while guides part
_LEFT = 1 / 16  # of the light of a press: less is light of contact that sticks after a lift
_CHANGED = 1.25  # least ratio of the light before and after a change of the force
CONTINUES = "the presses taken so far are stored; start the session again to continue"


class BadPressError(Exception):
    """Raised if a press is not valid; the message gives the reason."""


class TooDarkError(BadPressError):
    """Raised if no press is seen, or if a channel has less than one count during a press."""


def samples_of(kind: str, exposure_us: int) -> int:
    """Return how many samples a reading of a press of a `Wanted.kind` needs.

    The kind is empty for a short reading of about 0.24 s.
    """
    return max(_WINDOW_MIN, round(_LONG_S.get(kind, _WINDOW_S) * 1e6 / exposure_us))


@dataclass
class Bench:
    """A board whose strip is pressed on request, for ``spots calibrate`` or ``spots rezero``.

    `length_um` is that of the strip at rest; `path` is its calibration file. `spent` is the number
    of requested presses, minus the stored presses by hand. It counts for example invalid, repeated
    and removed presses. If it is large, a session by hand (see `session`) asks for fewer presses.
    `trace` has all readings of the present press: time in s by the clock of `Board.now_s`, then the
    six counts. `holds` has start and end of each hold of the present press, by the same clock; one
    hold for each force.
    """

    reader: SpectrumReader
    presser: Presser
    guide: Dialog
    length_um: float
    path: Path
    spent: int = 0
    trace: list[tuple[float, ...]] = field(default_factory=list)
    holds: list[tuple[float, float]] = field(default_factory=list)
    _is_parted: bool = False  # keys may have been typed before

    @property
    def window(self) -> int:
        """Number of samples in a short reading of a press.

        A longer reading is the mean of several short readings.
        """
        return samples_of("", self.reader.info["exposure_us"])

    def take(
        self,
        wanted: Wanted,
        noise: Noise | None = None,
        judge: Callable[[Reading], None] = lambda reading: None,
        given_up: str = CONTINUES,
    ) -> Reading:
        """Ask for presses until one press is valid; on return, the strip is still pressed.

        If the kind of `wanted` is ``choose``, channels may be saturated or dark. ``judge(reading)``
        raises `BadPressError` if the reading does not fit earlier presses. CalibrationError if none
        of `TRIES` attempts gave a valid press; its sentence ends with `given_up`. A press by hand
        has one attempt: then BadPressError, and the strip is released.
        """
        self.guide.want(wanted)
        for _ in range(TRIES):
            self.spent += 1
            self.part()
            self.presser.press(wanted)
            try:
                reading = self.again(wanted.kind, noise)
                self._hold(wanted.hold_s)
                judge(reading)
                return reading
            except BadPressError as bad:
                if wanted.kind == "hand":
                    self.release()
                    raise
                trouble = f"{wanted}: {bad}"
            self.guide.say(f"{trouble}; try again")
            if wanted.angle_deg is None:  # the indenter of a joint stays on the strip
                self.release()
        raise CalibrationError(f"{trouble}; {given_up}")

    def again(self, kind: str, noise: Noise | None = None) -> Reading:
        """Wait until the present press is steady, and return its reading; start a new `trace`.

        BadPressError if the press does not become steady in time, or a channel is saturated or
        dark.
        """
        self.trace, self.holds = [], []
        with self.reader.watched():
            return self._held(noise, kind)

    def change(self, wanted: Wanted) -> None:
        """Ask for the second force of a press, without a release; wait until the press is steady.

        BadPressError if the press is not valid, for example because its force has not changed. The
        strip is then released.
        """
        before = sum(self.trace[-1][1:])
        self.presser.change(wanted)
        try:
            with self.reader.watched():
                self._held(None, wanted.kind, before)
        except BadPressError:
            self.release()
            raise

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

    def _window(self) -> Reading:
        """Return the next short reading, and append it to `trace` if the press has begun."""
        reading = self.reader.read(self.window)
        if self.trace or not reading.unlit:
            row = round(self.reader.board.now_s(), 3), *reading.counts.round(2).tolist()
            self.trace.append(row)
        return reading

    @property
    def _brightest(self) -> float:
        # The largest sum of the counts during the present press.
        return max((sum(counts) for _, *counts in self.trace), default=0.0)

    def _hold(self, hold_s: float) -> None:
        """Continue to read a press until its last hold has lasted `hold_s` seconds.

        Raises `BadPressError` if the press ends earlier.
        """
        begin_s, end_s = self.holds.pop()
        while end_s - begin_s < hold_s:
            reading = self._window()
            if reading.unlit:
                raise BadPressError(f"the press ended too early: hold it for {hold_s:.0f} s")
            end_s = self.trace[-1][0]
            self.guide.watch(reading, None, min((end_s - begin_s) / hold_s, 1.0))
        self.holds.append((begin_s, end_s))

    def _held(self, noise: Noise | None, kind: str, before: float | None = None) -> Reading:
        """Wait for a steady press and return its reading; `BadPressError` if the press is invalid.

        `before` is the sum of the counts before a change of the force; None without a change.
        """
        end_s = self.reader.board.now_s() + self.presser.patience_s
        reason: BadPressError = TooDarkError("no press is seen")
        long = -(-samples_of(kind, self.reader.info["exposure_us"]) // self.window)
        needed, steady = max(long, self.presser.steady), []
        while len(steady) < needed:
            if not steady and self.reader.board.now_s() >= end_s:
                raise reason
            reading, trouble = self._window(), None
            if before is not None and reading.unlit:
                raise BadPressError("the strip was released: change the force without lifting")
            try:
                _check_steady(reading, noise, self.window, kind)
                if before is None and reading.counts.sum() < _LEFT * self._brightest:
                    raise BadPressError("the press ended too early: hold it")
                if before is not None and 1 / _CHANGED < reading.counts.sum() / before < _CHANGED:
                    raise BadPressError("the force has not changed: change it without lifting")
                steady.append(reading)
            except BadPressError as bad:
                reason, trouble, steady = bad, str(bad), []
            self.guide.watch(reading, trouble, len(steady) / needed)
        if self.trace:
            self.holds.append((self.trace[-len(steady)][0], self.trace[-1][0]))
        reading = mean(steady[-long:])
        any_light = kind == "choose"
        if reading.saturated and not any_light:
            raise BadPressError(
                "a channel is saturated: press more gently, or lower gain or LED current"
            )
        if reading.dark and not any_light:
            raise TooDarkError(
                "the press is too dark: press harder, or raise gain, LED current or exposure"
            )
        return reading


def _check_steady(reading: Reading, noise: Noise | None, window: int, kind: str) -> None:
    """Raise `BadPressError` if a short reading has light in no channel, or is not steady.

    `window` is the number of samples in the reading. For the kinds ``mark`` and ``hand``, the
    brightness may change more, because a finger trembles.
    """
    if reading.unlit:
        raise TooDarkError("no press is seen")
    if noise is None:
        expected = np.maximum(reading.variance, _VARIANCE_MIN)
    else:
        expected = noise.variance(np.maximum(reading.counts, 0))
    total = max(reading.counts.sum(), 1.0)
    sigma = np.sqrt(4 * expected.sum() / window) / total / np.log(2)
    drift_max = _FINGER_DRIFT_MAX if kind in _LONG_S else _DRIFT_MAX
    if abs(reading.drift) > drift_max + _SIGMAS * sigma:
        raise BadPressError("the light changes: hold still")
    if not reading.saturated and np.mean(reading.variance / expected) > _TREMBLE_MAX:
        raise BadPressError("the colour fluctuates: hold still")


def judge_place(known: Presses, wanted: Wanted, counts: np.ndarray, noise: Noise, window: int):
    """Check the light of a press against presses with the same force at other positions.

    There are at least two earlier presses. The counts are dark-subtracted means of `window`
    samples. BadPressError if colour or brightness does not fit the neighbouring presses.
    """
    order = np.argsort(known.position_um)
    places, logs, log = known.position_um[order], known.logs[order], np.log2(counts)
    # Change of the colour from the first place to the last: log2 of the counts minus their mean.
    way = logs[-1] - logs[0]
    way = way - way.mean()
    at = int(np.searchsorted(places, wanted.place_um))
    contrasts = np.insert(logs @ way, at, log @ way)
    sigma = np.sqrt(2 * noise.log_variance(counts) @ way**2 / window)
    if (np.diff(contrasts) < -_SIGMAS * sigma).any():
        raise BadPressError(
            "the colour does not fit the neighbouring presses: check the position of this press "
            "and of the previous one"
        )
    near = np.sort(np.argsort(np.abs(places - wanted.place_um))[:2])
    if np.abs(places[near] - wanted.place_um).min() > 1.5 * np.ptp(places[near]):
        return
    line = np.polyfit(places[near] - wanted.place_um, logs[near].mean(axis=1), 1)
    if abs(log.mean() - line[1]) > _OUTLIER:
        raise BadPressError(
            "the brightness does not fit the neighbouring presses: press all with the same force"
        )


def judge_force(known: Presses, wanted: Wanted, counts: np.ndarray, noise: Noise, window: int):
    """Check the light of a press against presses with other forces at the same position.

    The arguments are those of `judge_place`. BadPressError if the brightness does not increase with
    the force.
    """
    forces = np.append(known.force_mN, wanted.force_mN)
    light = np.append(known.logs.mean(axis=1), np.log2(counts).mean())
    sigma = np.sqrt(2 * noise.log_variance(counts).sum() / window) / len(counts)
    if (np.diff(light[np.argsort(forces)]) < -_SIGMAS * sigma).any():
        raise BadPressError(
            "the brightness does not increase with the force: check this force and the previous one"
        )
