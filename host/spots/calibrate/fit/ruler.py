"""Estimates the common error of positions that a person read off a ruler.

The colours of the presses show their distances from each other, but not their distance from the
ruler's zero. This distance is estimated from the positions that the person read. If the errors of
these positions are Gaussian, the mean is the best estimate. But a ruler has lines, and a position
that is rounded to the nearest line has a uniform error, of at most half the distance between lines.
The ends of such a distribution show its middle better than the mean does. So the error is modelled
as either Gaussian, or the sum of a rounding error and a smaller logistic (nearly Gaussian) error.
The data determine the probabilities of these models, and the sizes of the errors. Weak presses have
a further error, the noise of their colour, whose size is known.
"""

from __future__ import annotations

import numpy as np

_MARKS_UM = (500.0, 1000.0, 2000.0)  # possible distances between the lines of a ruler
_GAUSSIAN = 0.5  # prior probability of Gaussian errors
# Possible standard deviations of Gaussian or logistic errors, as multiples of `sigma_um`.
_SIGMAS = 2.0 ** np.arange(-4.0, 1.5, 0.5)
_LOGISTIC = np.sqrt(3) / np.pi  # scale of a logistic distribution with the standard deviation 1
_REACH, _STEPS = 3.4, 29  # grid of the common error: +- standard deviations, number of steps


def common_error_um(
    read_um: np.ndarray, off_um: np.ndarray, noise_um: np.ndarray, sigma_um: float
) -> np.ndarray:
    """Return the common error of positions that were fitted to readings of a ruler.

    The error, position from the fit minus true position, is a straight line along the strip: an
    offset and a scale. The result is the mean of the posterior distribution of this line. A person
    read `read_um`; `off_um` are the positions from a fit to these by weighted least squares, minus
    `read_um`; `noise_um` their standard deviations due to the noise of the sensor. `sigma_um` is
    what the fit assumed for the errors of `read_um`.
    """
    expected_um = np.hypot(sigma_um, noise_um)
    lines = np.stack([np.ones_like(read_um), read_um], axis=1)
    unit, _ = np.linalg.qr(lines / expected_um[:, None])
    # The common error is `lines` times two coefficients. With Gaussian errors of the expected size,
    # each coefficient has a standard deviation of 1.
    lines = unit * expected_um[:, None]
    off_um = off_um - lines @ (unit.T @ (off_um / expected_um))
    grid = np.linspace(-_REACH, _REACH, _STEPS)
    common = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    errors_um = np.abs(off_um - common @ lines.T)
    logs = []
    for marks_um in (0.0, *_MARKS_UM):
        sizes_um = _SIGMAS * sigma_um
        if marks_um:
            sizes_um = sizes_um[sizes_um <= marks_um / 4]
        prior = (1 - _GAUSSIAN) / len(_MARKS_UM) if marks_um else _GAUSSIAN
        for size_um in sizes_um:
            own_um = np.hypot(size_um, noise_um)
            log = _log_density(errors_um, marks_um / 2, own_um).sum(axis=1)
            logs.append(log + np.log(prior / len(sizes_um)))
    weights = np.exp(np.array(logs) - np.max(logs)).sum(axis=0)
    return lines @ (weights @ common / weights.sum())


def _log_density(error_um: np.ndarray, half_um: float, sigma_um: np.ndarray) -> np.ndarray:
    """Return the logarithm of the probability density (in 1/um) of errors.

    An error is the sum of a uniform error of at most `half_um` and a logistic error. If `half_um`
    is 0, an error is Gaussian. `sigma_um` is the standard deviation of the logistic or Gaussian
    error. `error_um` contains absolute values.
    """
    if not half_um:
        return -0.5 * (error_um / sigma_um) ** 2 - np.log(sigma_um * np.sqrt(2 * np.pi))
    scale_um = sigma_um * _LOGISTIC
    out, edge = error_um / scale_um, half_um / scale_um
    # log of sinh(edge) / (cosh(edge) + cosh(out)) / (2 half_um), without an overflow
    rise = edge + np.log1p(-np.exp(-2 * edge))
    fall = np.logaddexp(np.logaddexp(edge, -edge), np.logaddexp(out, -out))
    return rise - fall - np.log(2 * half_um)
