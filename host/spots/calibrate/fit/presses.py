"""Readings of steady presses as arrays, and the noise of the sensor."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

FIRM_MN = 6000.0  # force of a firm press, which measures the colour at a position
FULL_MN = 10_000.0  # largest force of a calibration
FORCE_PLACES = (0.1, 0.5, 0.9)  # positions with many forces, as shares of the length
MARKS = (0.1, 0.5, 0.9)  # positions that `spots rezero` presses again, as shares of the length
# Positions that a calibration stores for it, so that it can press 1, 3, 5 or 9 of them.
ALL_MARKS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)

ROUNDING_VARIANCE = 1 / 12  # counts**2; variance of the rounding error of a whole number
_REWEIGHTINGS = 4  # rounds of the reweighted least squares in `_reweighted`


@dataclass(frozen=True)
class Presses:
    """Readings of n steady presses with c channels, as arrays.

    Positions are counted from the strip's end at the sensor. `counts`, shape (n, c), are
    dark-subtracted means. `variance`, shape (n, c), is that of one sample in counts**2, without the
    noise that all channels share (that of the LED). `saturated` is whether at least one channel was
    saturated, for each press.
    """

    position_um: np.ndarray
    force_mN: np.ndarray
    counts: np.ndarray
    variance: np.ndarray
    saturated: np.ndarray

    @property
    def logs(self) -> np.ndarray:
        """log2 of the counts, an array of shape (n, c)."""
        return np.log2(self.counts)

    def keep(self, rows) -> Presses:
        """Return the presses that `rows` (a boolean mask or a list of indices) selects."""
        return Presses(*(array[rows] for array in vars(self).values()))

    def channels(self, columns) -> Presses:
        """Return all presses with the channels that `columns` (a mask or indices) selects."""
        counts, variance = self.counts[:, columns], self.variance[:, columns]
        return replace(self, counts=counts, variance=variance)

    def lit_everywhere(self) -> Presses:
        """Return the presses that are stronger than every press with at most 1 count in a channel.

        The forces of the returned presses give light in all channels at every position.
        """
        dark = self.force_mN[~(self.counts > 1).all(axis=1)]
        return self.keep(self.force_mN > (dark.max() if len(dark) else -1))


def own_variance(samples: np.ndarray) -> np.ndarray:
    """Return the variance of each channel in counts**2, without the noise that all channels share.

    The counts of each channel are divided by their mean. The difference of two channels then
    contains the noise of these two channels only. Weighted least squares over all pairs of channels
    separates the variances. `samples` are n dark-subtracted ones of a steady press, shape (n, c),
    all greater than 0.
    """
    mean = samples.mean(axis=0)
    relative = samples / mean
    i, j = np.triu_indices(samples.shape[1], 1)
    one = np.eye(samples.shape[1])
    design = one[i] + one[j]
    values = np.var(relative[:, i] - relative[:, j], axis=0, ddof=1)
    return _reweighted(design, values, ROUNDING_VARIANCE / mean**2) * mean**2


def _reweighted(design: np.ndarray, variances: np.ndarray, least: np.ndarray) -> np.ndarray:
    """Fit the parts of which measured variances are sums, by reweighted least squares.

    The error of a measured variance is proportional to the true variance. Weights from measured
    variances would favour low variances. So the weights are those of the variances that the
    previous round fitted, with `least` as the lower limits of the parts. Without weights, dim
    channels would hide the noise of bright ones.
    """
    found = least
    for _ in range(_REWEIGHTINGS):
        weight = 1 / (design @ np.maximum(found, least))
        found = np.linalg.lstsq(design * weight[:, None], variances * weight, rcond=None)[0]
    return found


@dataclass(frozen=True)
class Noise:
    """Noise of the sensor: the variance of one sample's count is a constant part plus shot noise.

    `constant` is in counts**2, `per_count` is variance by dark-subtracted count.
    """

    constant: float
    per_count: float

    @classmethod
    def of(cls, *presses: Presses) -> Noise:
        """Estimate the noise from the readings of many presses."""
        counts = np.concatenate([p.counts.ravel() for p in presses])
        variance = np.concatenate([p.variance.ravel() for p in presses])
        lit = counts > 1
        counts, variance = counts[lit], variance[lit]
        design = np.stack([np.ones_like(counts), counts], axis=1)
        # A steady press hides part of the rounding; the rounding variance is the lower limit.
        least = np.array([ROUNDING_VARIANCE, 0.0])
        return cls(*np.maximum(_reweighted(design, variance, least), least).tolist())

    def variance(self, counts: np.ndarray) -> np.ndarray:
        """Return the variance of dark-subtracted counts of one sample, in counts**2."""
        return self.constant + self.per_count * counts

    def log_variance(self, counts: np.ndarray) -> np.ndarray:
        """Return the variance of log2 of dark-subtracted counts of one sample."""
        counts = np.maximum(counts, 1e-3)
        return self.variance(counts) / (counts * np.log(2)) ** 2
