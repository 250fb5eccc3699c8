"""What a calibration is made from: readings of presses that were held, and their noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# What a session presses with.
FIRM_MN = 6000.0
FULL_MN = 10_000.0
FORCE_PLACES = (0.1, 0.5, 0.9)  # shares of the length
MARKS = (0.1, 0.5, 0.9)  # that a re-zero presses again

ROUNDING_VARIANCE = 1 / 12
_REWEIGHTINGS = 4


@dataclass(frozen=True)
class Presses:
    """Readings of presses that were held.

    Attributes
    ----------
    position_um, force_mN : numpy.ndarray, shape (n,)
    counts : numpy.ndarray, shape (n, c)
        Means of the dark-subtracted counts of each channel.
    variance : numpy.ndarray, shape (n, c)
        Variance of a single sample, without what is common to all channels.
    saturated : numpy.ndarray of bool, shape (n,)
    """

    position_um: np.ndarray
    force_mN: np.ndarray
    counts: np.ndarray
    variance: np.ndarray
    saturated: np.ndarray

    @property
    def logs(self) -> np.ndarray:
        """log2 of the counts, shape (n, c)."""
        return np.log2(self.counts)

    def keep(self, rows) -> Presses:
        """Return some of the rows."""
        return Presses(*(array[rows] for array in vars(self).values()))

    def channels(self, columns) -> Presses:
        """Return all rows with some of the channels."""
        return Presses(
            self.position_um,
            self.force_mN,
            self.counts[:, columns],
            self.variance[:, columns],
            self.saturated,
        )

    def lit_everywhere(self) -> Presses:
        """Return the presses of those forces that gave light at every place they were tried."""
        dark = self.force_mN[~(self.counts > 1).all(axis=1)]
        return self.keep(self.force_mN > (dark.max() if len(dark) else -1))


def own_variance(samples: np.ndarray) -> np.ndarray:
    """Return the variance of each channel without what all channels share.

    Parameters
    ----------
    samples : numpy.ndarray, shape (n, c)
        Dark-subtracted counts of one held press, greater than 0.

    Returns
    -------
    numpy.ndarray, shape (c,)
        Variances in counts**2. The logarithms of two channels differ by the noise of both and by
        nothing else: least squares over all pairs separates them.
    """
    mean = samples.mean(axis=0)
    relative = samples / mean
    channels = samples.shape[1]
    pairs = [(i, j) for i in range(channels) for j in range(i)]
    design = np.zeros((len(pairs), channels))
    values = np.zeros(len(pairs))
    for row, (i, j) in enumerate(pairs):
        design[row, [i, j]] = 1
        values[row] = np.var(relative[:, i] - relative[:, j], ddof=1)
    return np.linalg.lstsq(design, values, rcond=None)[0] * mean**2


@dataclass(frozen=True)
class Noise:
    """Variance of a count: a constant, and a part that grows with the count (shot noise)."""

    constant: float
    per_count: float

    @classmethod
    def of(cls, *presses: Presses) -> Noise:
        """Estimate it from the readings of many presses."""
        counts = np.concatenate([p.counts.ravel() for p in presses])
        variance = np.concatenate([p.variance.ravel() for p in presses])
        lit = counts > 1
        counts, variance = counts[lit], variance[lit]
        design = np.stack([np.ones_like(counts), counts], axis=1)
        found = cls(ROUNDING_VARIANCE, 0.0)
        for _ in range(_REWEIGHTINGS):
            # Each estimate is known to a share of the true variance, which is what the last
            # round says, and not what the estimate itself says: that would favour low ones.
            weight = 1 / (found.constant + found.per_count * counts)
            solution = np.linalg.lstsq(design * weight[:, None], variance * weight, rcond=None)[0]
            # Held presses hide part of the rounding, so it is the least that is believed.
            found = cls(max(float(solution[0]), ROUNDING_VARIANCE), max(float(solution[1]), 0.0))
        return found

    def log_variance(self, counts: np.ndarray) -> np.ndarray:
        """Return the variance of log2 of a sample with these dark-subtracted counts."""
        counts = np.maximum(counts, 1e-3)
        return (self.constant + self.per_count * counts) / (counts * np.log(2)) ** 2
