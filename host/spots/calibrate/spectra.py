"""Reads the dark-subtracted counts of a steady press from a board.

Dark-subtracted counts are counts minus those of the dark frame, which is taken with the LED off.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice

import numpy as np

from spots_device.reading.calibration import Conditions
from spots_device.reading.decode import DARK_SAMPLES, LED_OFF, SATURATED

from ..errors import SpotsError
from ..link.board import Board
from ..link.frames import Frame, Spectrum, Touch
from .presses import own_variance

_CHANNELS_MIN = 3  # with fewer channels, the noise that all channels share cannot be separated
_TIMEOUT_S = 10.0  # more than any dark frame takes


@dataclass(frozen=True)
class Reading:
    """Statistics of the samples of a steady press.

    Attributes
    ----------
    counts : numpy.ndarray, shape (6,)
        Mean dark-subtracted counts of each channel.
    variance : numpy.ndarray, shape (6,)
        Variance of one sample of each channel in counts**2, without the noise that all channels
        share. 0 for a channel with a mean of at most one count, and for all channels if fewer than
        three channels have more than that.
    drift : float
        Change of the brightness from the first half of the samples to the second, in log2 units.
    saturated : bool
        Whether at least one channel was saturated.
    """

    counts: np.ndarray
    variance: np.ndarray
    drift: float
    saturated: bool

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
    )


class SpectrumReader:
    """Reads single samples from a board.

    The board's setting ``average`` (samples per reading) is 1 until `restore` is called, or until
    a ``with`` block of the reader ends. Call `set_up` again if the board's settings change.

    Parameters
    ----------
    board : Board
        The board. Its strip should not be pressed during `set_up`, which the constructor calls.
    """

    def __init__(self, board: Board):
        self.board = board
        self._average = 1
        self.set_up()

    def __enter__(self) -> SpectrumReader:
        return self

    def __exit__(self, *exception) -> None:
        self.restore()

    def set_up(self, line: str = "", dark_s: float = 0.0) -> None:
        """Change settings of the board, then read all its settings and take the dark frame.

        Parameters
        ----------
        line : str
            Arguments of the board's command ``set``, for example ``gain=9``; empty for no change.
        dark_s : float
            Total exposure of the dark frames to average, in s; at least one frame is taken.

        Raises
        ------
        SpotsError
            If the board refuses a setting, or is disconnected.
        """
        if line:
            self.board.command("set " + line)
        self.info = self.board.command("hello")
        if self.info["average"] != 1:
            self._average = self.info["average"]
            self.board.command("set average=1")
            self.info = self.board.command("hello")
        darks = max(1, round(1e6 * dark_s / (DARK_SAMPLES * self.info["exposure_us"])))
        dark = [self.board.command("dark", timeout_s=30)["dark"] for _ in range(darks)]
        self._dark = np.mean(dark, axis=0) / DARK_SAMPLES
        self.board.command("stream spectrum")

    def restore(self) -> None:
        """Reset the board's ``average`` to its earlier value, unless the board is disconnected."""
        if self._average != 1:
            with suppress(SpotsError):
                self.board.command(f"set average={self._average}")

    @property
    def conditions(self) -> Conditions:
        """Board and settings, as `set_up` read them."""
        i = self.info
        return Conditions(i["id"], tuple(i["plan"]), i["gain"], i["exposure_us"], i["led_mA"])

    def samples(self, count: int) -> tuple[np.ndarray, bool]:
        """Return new dark-subtracted samples, shape (count, 6), and whether one was saturated.

        Raises
        ------
        SpotsError
            If the board sends too few samples in time.
        """
        limit_s = _TIMEOUT_S + 3e-6 * count * self.info["exposure_us"]
        frames = self._frames(count, _is_lit, limit_s)
        if len(frames) < count:
            raise SpotsError(
                "the board sends too few spectra: 'spots command get' shows its faults"
            )
        saturated = any(frame.flags & SATURATED for frame in frames)
        return np.array([frame.counts for frame in frames], dtype=float) - self._dark, saturated

    def positions_um(self, count: int, timeout_s: float) -> np.ndarray:
        """Return new positions that a calibrated board reports; the board must stream touches.

        Parameters
        ----------
        count : int
            Number of positions.
        timeout_s : float
            Longest time to wait for the positions, in s.

        Returns
        -------
        numpy.ndarray, shape (count,)
            Positions in um.

        Raises
        ------
        SpotsError
            If the board reports too few positions.
        """
        frames = self._frames(count, lambda f: isinstance(f, Touch) and f.trusted, timeout_s)
        if len(frames) < count:
            raise SpotsError(
                "the board reports too few positions: press the strip firmly with the indenter"
            )
        return np.array([frame.position_um for frame in frames], dtype=float)

    def _frames(self, count: int, is_wanted: Callable[[Frame], bool], limit_s: float) -> list:
        """Return up to `count` frames that `is_wanted` accepts; wait at most `limit_s` seconds.

        A frame is a message of the board, such as a spectrum. Only frames whose exposure begins
        after this call are returned.
        """
        begun_s = self.board.now_s() + 0.5e-6 * self.info["exposure_us"]
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
        return Reading(mean, variance, float(drift), clipped)


def _is_lit(frame: Frame) -> bool:
    return isinstance(frame, Spectrum) and not frame.flags & LED_OFF
