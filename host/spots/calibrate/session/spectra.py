"""Reads the dark-subtracted counts of a steady press from a board.

Dark-subtracted counts are counts minus those of the dark frame, which is taken with the LED off.
Light that crosses between the guides without a press (the *baseline*, for example at dust) is
subtracted, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import islice

import numpy as np

from spots_device.reading.calibration import Calibration, Conditions
from spots_device.reading.decode import DARK_SAMPLES, DARK_SUBTRACTED, LED_OFF, SATURATED
from spots_device.sensor.smux import CHANNELS

from ...errors import BoardError, CalibrationError, SpotsError
from ...link.board import Board
from ...link.frames import Frame, Spectrum, Touch
from ..fit.presses import own_variance

DARK_S = 2.5  # exposure of dark frames before marks: less gives more noise, more cools the LED
_CHANNELS_MIN = 3  # with fewer channels, the noise that all channels share cannot be separated
_TIMEOUT_S = 10.0  # more than any dark frame takes
# Light of the untouched strip: duration of the lit samples before and after a dark frame, and their
# least number; and how many standard deviations it must have, so that noise is not subtracted.
_REST_S = 0.32
_REST_SAMPLES = 8
_REST_SIGMAS = 5.0
_REST_VARIANCE = 0.25  # counts**2: assumed least variance of a sample, with its rounding error
# A hand can shade ambient light. With more ambient light than this number of counts (sum of all
# channels), dark samples are also taken during a press; each comes after this number of samples.
_AMBIENT_MIN = 12.0
_DARK_EVERY = 8
# The dark samples of a press are used if the chi-squared of their mean is above this limit.
_SHADED = 60.0


@dataclass(frozen=True)
class Reading:
    """Statistics of the samples of a steady press.

    `counts` are dark-subtracted means. `variance` is that of one sample of each channel in
    counts**2, without the noise that all channels share. It is 0 for a channel with a mean of at
    most one count, and for all channels if fewer than three channels have more than that. `drift`
    is the change of the brightness from the first half of the samples to the second, in log2 units.
    `saturated` is whether at least one channel was saturated. `baseline` is the light of the
    untouched strip that was subtracted from `counts`, see `SpectrumReader`.
    """

    counts: np.ndarray
    variance: np.ndarray
    drift: float
    saturated: bool
    baseline: np.ndarray = field(default_factory=lambda: np.zeros(CHANNELS))

    @property
    def dark(self) -> bool:
        """Whether the mean of at least one channel is less than one count."""
        return bool((self.counts < 1).any())

    @property
    def unlit(self) -> bool:
        """Whether the mean of every channel is less than one count."""
        return bool((self.counts < 1).all())


def mean(readings: list[Reading]) -> Reading:
    """Return the mean of successive readings of a press; its `drift` is that of the last reading.

    All readings have the same number of samples.
    """
    return Reading(
        np.mean([r.counts for r in readings], axis=0),
        np.mean([r.variance for r in readings], axis=0),
        readings[-1].drift,
        any(r.saturated for r in readings),
        readings[-1].baseline,
    )


class SpectrumReader:
    """Reads single samples from a board.

    The board's setting ``average`` (samples per reading) is 1 until `restore` is called, or until a
    ``with`` block of the reader ends. Call `set_up` again if the board's settings change.
    `baseline` is the light of the untouched strip in counts of a sample, without the dark frame; it
    is subtracted from all samples. 0 if it was not measured, or if noise alone can cause it.
    """

    def __init__(self, board: Board):
        self.board = board
        self.baseline = np.zeros(CHANNELS)
        self._average = 1
        self._baselines: dict[Conditions, np.ndarray] = {}
        self.set_up()

    def __enter__(self) -> SpectrumReader:
        return self

    def __exit__(self, *exception) -> None:
        self.restore()

    def set_up(self, line: str = "", dark_s: float = 0.0, untouched: bool = False) -> None:
        """Change settings of the board, then read all its settings and take the dark frame.

        `line` has arguments of the board's command ``set``, for example ``gain=9``. `dark_s` is the
        total exposure of the dark frames to average; at least one frame is taken. If nothing
        presses the strip (`untouched`), `baseline` can be measured; otherwise it becomes what was
        last measured at these settings.
        """
        if line:
            self.board.command("set " + line)
        self.info = self.board.command("hello")
        if self.info["average"] != 1:
            self._average = self.info["average"]
            self.board.command("set average=1")
            self.info = self.board.command("hello")
        darks = max(1, round(1e6 * dark_s / (DARK_SAMPLES * self.info["exposure_us"])))
        self.baseline = self._baselines.get(self.conditions, np.zeros(CHANNELS))
        self.board.command("stream spectrum")
        if untouched:
            self._measure_baseline(darks)
        else:
            self._dark = np.mean([self._dark_frame() for _ in range(darks)], axis=0)

    def use_baseline(self, lines: Iterable[str]) -> None:
        """Use the light of the untouched strip in a calibration, at the present exposure."""
        made = Calibration(lines)
        longer = self.conditions.exposure_us / made.conditions.exposure_us
        self.baseline = np.array(made.baseline or [0] * CHANNELS) / DARK_SAMPLES * longer
        self._baselines[self.conditions] = self.baseline

    def _dark_frame(self) -> np.ndarray:
        return np.array(self.board.command("dark", timeout_s=30)["dark"]) / DARK_SAMPLES

    def _measure_baseline(self, darks: int) -> None:
        """Take `darks` dark frames, and lit samples before and after each.

        Ambient light is equal before and after a frame, or its change is included in the error.
        """
        count = max(_REST_SAMPLES, round(_REST_S * 1e6 / self.info["exposure_us"]))
        self.baseline = self._dark = np.zeros(CHANNELS)
        rows = []
        for _ in range(darks):
            before, _ = self.samples(count)
            dark = self._dark_frame()
            after, _ = self.samples(count)
            rows.append((before.mean(axis=0), dark, after.mean(axis=0), before.var(axis=0, ddof=1)))
        before, dark, after, variance = np.array(rows).transpose(1, 0, 2)
        self._dark = dark.mean(axis=0)
        found = ((before + after) / 2 - dark).mean(axis=0)
        noise = np.maximum(variance.mean(axis=0), _REST_VARIANCE).sum()
        shares = 1 / (2 * count) + 1 / self._dark_samples
        moved = ((after - before).sum(axis=1) / 2) ** 2
        sigma = np.sqrt((noise * shares + moved.mean()) / darks)
        if found.sum() > _REST_SIGMAS * sigma:
            self.baseline = found.clip(0)
        self._baselines[self.conditions] = self.baseline

    @property
    def _dark_samples(self) -> int:
        # Samples in a dark frame: 64, or as many as fit in 2 s, see `dark.Dark.request_pool`.
        windows = int(2e6 // (4 * self.info["exposure_us"]))
        return 4 * min(max(windows, 1), DARK_SAMPLES // 4)

    def restore(self) -> None:
        """Reset the board's ``average`` to its earlier value, unless the board is disconnected."""
        if self._average != 1:
            with suppress(SpotsError):
                self.board.command(f"set average={self._average}")

    @property
    def conditions(self) -> Conditions:
        """Board and settings, as `set_up` read them."""
        i = self.info
        return Conditions(i["id"], tuple(i["channels"]), i["gain"], i["exposure_us"], i["led_mA"])

    def samples(self, count: int) -> tuple[np.ndarray, bool]:
        """Return new dark-subtracted samples, shape (count, 6), and whether one was saturated.

        BoardError if the board sends too few samples in time.
        """
        limit_s = _TIMEOUT_S + 3e-6 * count * self.info["exposure_us"]
        frames, darks = self._spectra(count, limit_s)
        if len(frames) < count:
            raise BoardError(
                "the board sends too few spectra: 'spots command get' shows its faults", "too_few"
            )
        saturated = any(frame.flags & SATURATED for frame in frames)
        counts = np.array([frame.counts for frame in frames], dtype=float)
        return counts - self._dark_at(frames, darks) - self.baseline, saturated

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Take dark samples between the lit ones in this block, if there is ambient light.

        `samples` then subtracts the ambient light that is left in the shadow of a hand.
        """
        if self.info["led"] == "always" or self._dark.sum() < _AMBIENT_MIN:
            yield
            return
        self.board.command(f"set dark_every={_DARK_EVERY}")
        try:
            yield
        finally:
            with suppress(SpotsError):
                self.board.command(f"set dark_every={self.info['dark_every']}")

    def _spectra(self, count: int, limit_s: float) -> tuple[list[Spectrum], list[Spectrum]]:
        """Return the next `count` lit samples, and the dark samples between them."""
        lit: list[Spectrum] = []
        darks: list[Spectrum] = []
        unlit = 0  # successive samples with the LED off; it was on during a part of the first one
        begun_s = self._now_s()
        for frame in self.board.frames(limit_s):
            if not isinstance(frame, Spectrum):
                continue
            is_off = frame.flags & (LED_OFF | DARK_SUBTRACTED) == LED_OFF
            unlit = unlit + 1 if is_off else 0
            if frame.time_s < begun_s:
                continue
            if unlit > 1:
                darks.append(frame)
            elif not frame.flags & LED_OFF:
                lit.append(frame)
                if len(lit) == count:
                    break
        return lit, darks

    def _dark_at(self, frames: list[Spectrum], darks: list[Spectrum]) -> np.ndarray:
        """Return the dark counts for each lit sample; those of the dark frame, if they fit."""
        if not darks:
            return self._dark
        counts = np.array([dark.counts for dark in darks], dtype=float)
        variance = _REST_VARIANCE * (1 / len(darks) + 1 / self._dark_samples)
        if ((counts.mean(axis=0) - self._dark) ** 2).sum() < _SHADED * variance:
            return self._dark
        times_s = [frame.time_s for frame in frames]
        dark_s = [dark.time_s for dark in darks]
        return np.stack([np.interp(times_s, dark_s, channel) for channel in counts.T], axis=1)

    def _now_s(self) -> float:
        # Only samples that begin after this time are used. The time of a frame is its middle.
        return self.board.now_s() + 0.5e-6 * self.info["exposure_us"]

    def positions_um(self, count: int, timeout_s: float) -> np.ndarray:
        """Return new positions that a calibrated board reports; the board must stream touches.

        CalibrationError if the board reports too few positions in time.
        """
        frames = self._frames(count, lambda f: isinstance(f, Touch) and f.trusted, timeout_s)
        if len(frames) < count:
            raise CalibrationError(
                "the board reports too few positions: press the strip firmly with the indenter"
            )
        return np.array([frame.position_um for frame in frames], dtype=float)

    def _frames(self, count: int, is_wanted: Callable[[Frame], bool], limit_s: float) -> list:
        """Return up to `count` frames that `is_wanted` accepts; wait at most `limit_s` seconds.

        A frame is a message of the board, such as a spectrum. Only frames whose exposure begins
        after this call are returned.
        """
        begun_s = self._now_s()
        found = (f for f in self.board.frames(limit_s) if is_wanted(f) and f.time_s >= begun_s)
        return list(islice(found, count))

    def read(self, count: int) -> Reading:
        """Return the statistics of the next `count` samples; `count` is at least 2."""
        samples, clipped = self.samples(count)
        mean = samples.mean(axis=0)
        lit = mean > 1
        halves = np.maximum(samples.sum(axis=1), 1)
        drift = np.log2(halves[count // 2 :].mean() / halves[: count // 2].mean())
        variance = np.zeros_like(mean)
        if lit.sum() >= _CHANNELS_MIN:
            variance[lit] = own_variance(samples[:, lit])
        return Reading(mean, variance, float(drift), clipped, self.baseline)
