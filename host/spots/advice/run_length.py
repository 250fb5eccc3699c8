"""The threshold of a sequential test (CUSUM), computed from its mean time between false alarms.

Each press gives a number x with the standard deviation 1 and the mean 0. After a shift, the mean
is d. The test adds d x - d**2 / 2, the logarithm of the likelihood ratio of both cases, to a sum
that never falls below 0; an alarm is a sum above the threshold h. One press adds at most h / 2.5,
so that an alarm needs three presses or more. The mean number of presses until a false alarm (the
run length) follows from a Markov chain with the sum as its state: D. Brook and
D. A. Evans, An approach to the probability distribution of CUSUM run length, Biometrika 59 (1972).
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

MOST = 1 / 2.5  # share of the threshold that one press adds at most
_STATES = 60
# Least threshold, as a share of the largest one. Where the noise is small, other errors are more
# frequent, such as those of two fingers.
_LEAST = 1 / 3
_SEARCH = 12  # bisections
# Shifts for which thresholds are computed, in standard deviations. The thresholds at the ends are
# more than sufficient for smaller and larger shifts.
_SHIFTS = np.geomspace(0.5, 6.0, 12)


def run_length(shift: float, threshold: float) -> float:
    """Return the mean number of presses until a false alarm.

    `shift` is what the test looks for, in standard deviations; `threshold` is that of the sum of
    the logarithms.

    >>> round(run_length(1.0, 5.0))
    930
    """
    width = 2 * threshold / (2 * _STATES - 1)  # state 0 has half of this width
    starts = width * np.arange(_STATES)
    upper = width * (np.arange(_STATES) + 0.5)
    step = upper[None, :] - starts[:, None]
    below = np.where(step >= MOST * threshold, 1.0, _normal((step + shift**2 / 2) / shift))
    moves = np.diff(below, axis=1, prepend=0.0)
    return float(np.linalg.solve(np.eye(_STATES) - moves, np.ones(_STATES))[0])


@lru_cache
def thresholds(presses: float) -> tuple[np.ndarray, np.ndarray]:
    """Return shifts, and for each shift the threshold with this mean number of presses."""
    return _SHIFTS, np.array([_threshold(float(shift), presses) for shift in _SHIFTS])


def threshold(shift: float, presses: float) -> float:
    """Return a threshold with which a false alarm comes after `presses` presses on average.

    For large shifts, it is so large that false alarms come less often.
    """
    return float(np.interp(shift, *thresholds(presses)))


def _threshold(shift: float, presses: float) -> float:
    # The run length is at least exp(threshold), see G. Lorden, Annals of Mathematical Statistics 42
    # (1971), also if large steps are limited.
    low, high = math.log(presses) * _LEAST, math.log(presses)
    for _ in range(_SEARCH):
        middle = (low + high) / 2
        if run_length(shift, max(middle, 1e-6)) < presses:
            low = middle
        else:
            high = middle
    return high


def _normal(values: np.ndarray) -> np.ndarray:
    """Return the distribution function of the standard normal distribution."""
    return 0.5 * np.vectorize(math.erfc)(-values / math.sqrt(2))
