"""Dark-subtracted counts of a held press, read from any board."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spots_device.calibration import Conditions
from spots_device.decode import DARK_SAMPLES, LED_OFF, SATURATED

from ..errors import SpotsError
from ..link.board import Board
from ..link.frames import Spectrum
from .presses import own_variance

_CHANNELS_MIN = 3  # of fewer, the noise that all share cannot be separated
_TIMEOUT_S = 10.0  # more than any dark window takes


@dataclass(frozen=True)
class Reading:
    """A held press.

    Attributes
    ----------
    counts : numpy.ndarray, shape (6,)
        Means of the dark-subtracted counts.
    variance : numpy.ndarray, shape (6,)
        Variance of a single sample, without what is common to all channels; 0 of one that is
        dark.
    drift : float
        Change of the brightness from the first to the second half, in units of log2.
    saturated : bool
    """

    counts: np.ndarray
    variance: np.ndarray
    drift: float
    saturated: bool

    @property
    def dark(self) -> bool:
        """Whether a channel saw less than a count."""
        return bool((self.counts < 1).any())


class SpectrumReader:
    """Reads spectra from a board. Call `set_up` again after a change of its settings.

    Each is of one sample, whatever the board averages over: see `give_back`.

    Parameters
    ----------
    board : Board
        Not pressed while it is set up.
    """

    def __init__(self, board: Board):
        self.board = board
        self._average = 1
        self.set_up()

    def set_up(self, line: str = "", dark_s: float = 0.0) -> None:
        """`set` something, if given; then read the settings and the mean of some dark frames.

        Parameters
        ----------
        line : str
            Arguments of the board's ``set``, for example ``gain=9``; empty for no change.
        dark_s : float
            Time of dark frames that are averaged; one is taken in any case.

        Raises
        ------
        SpotsError
            If the board refuses a setting, or is lost.
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

    def give_back(self) -> None:
        """Restore the board's average."""
        if self._average != 1:
            self.board.command(f"set average={self._average}")

    @property
    def conditions(self) -> Conditions:
        """What a calibration made now belongs to."""
        i = self.info
        return Conditions(i["id"], tuple(i["plan"]), i["gain"], i["exposure_us"], i["led_mA"])

    def samples(self, count: int) -> tuple[np.ndarray, bool]:
        """Return the next samples less the dark, shape (count, 6), and whether any was clipped."""
        begun_s = self.board.now_s() + 0.5e-6 * self.info["exposure_us"]
        rows, clipped = [], False
        limit_s = _TIMEOUT_S + 3e-6 * count * self.info["exposure_us"] * self.info["average"]
        for frame in self.board.frames(limit_s):
            if not isinstance(frame, Spectrum) or frame.flags & LED_OFF or frame.time_s < begun_s:
                continue
            rows.append(frame.counts)
            clipped |= bool(frame.flags & SATURATED)
            if len(rows) == count:
                break
        else:
            raise SpotsError("the board sends no spectra; 'spots command get' shows why")
        return np.array(rows, dtype=float) - self._dark, clipped

    def read(self, count: int) -> Reading:
        """Return a reading over `count` samples, 2 or more."""
        samples, clipped = self.samples(count)
        mean = samples.mean(axis=0)
        lit = mean > 1
        halves = np.maximum(samples.sum(axis=1), 1)
        drift = np.log2(halves[count // 2 :].mean() / halves[: count // 2].mean())
        variance = np.zeros_like(mean)
        if lit.sum() >= _CHANNELS_MIN:
            variance[lit] = own_variance(samples[:, lit])
        return Reading(mean, variance, float(drift), clipped)
