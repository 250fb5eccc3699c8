"""Common error of positions that were read from a ruler, with rounded and with Gaussian errors."""

import numpy as np
import pytest

from spots.calibrate.fit.ruler import common_error_um

COUNT, LENGTH_UM = 39, 85_000.0
NO_NOISE = np.zeros(COUNT)
WEAK = np.where(np.arange(COUNT) % 3, 5.0, 400.0)  # a third of the presses is weak


def errors_um(draw, sigma_um, noise_um=NO_NOISE, seeds=range(24)):
    """Return the mean absolute error of fitted lines, before and after `common_error_um`, in um.

    Parameters
    ----------
    draw : callable
        ``draw(rng)`` returns the errors of the positions that were read from the ruler, in um.
    sigma_um : float
        Standard deviation of these errors.
    noise_um : ndarray
        Standard deviations of the measured positions, in um, for each press.
    seeds : iterable of int
        Random seeds; the result is the mean over them.
    """
    found = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        true_um = rng.uniform(0, LENGTH_UM, COUNT)
        read_um = true_um + draw(rng)
        colour_um = true_um + noise_um * rng.normal(size=COUNT)
        weights = 1 / np.hypot(sigma_um, noise_um)
        line = np.polyval(np.polyfit(true_um, read_um - colour_um, 1, w=weights), true_um)
        off_um = colour_um + line - read_um
        common_um = common_error_um(read_um, off_um, noise_um, sigma_um)
        found.append((line, line - common_um))
    return np.abs(found).mean(axis=(0, 2))


@pytest.mark.board
def test_rounded_positions_have_much_less_error_in_common():
    fitted, corrected = errors_um(lambda rng: rng.uniform(-500, 500, COUNT), 300)
    assert corrected < 0.7 * fitted


@pytest.mark.board
def test_rounded_positions_have_less_error_in_common_in_spite_of_weak_presses():
    fitted, corrected = errors_um(lambda rng: rng.uniform(-500, 500, COUNT), 300, WEAK)
    assert corrected < 0.8 * fitted


@pytest.mark.board
def test_rounded_positions_with_parallax_are_corrected_too():
    fitted, corrected = errors_um(
        lambda rng: rng.uniform(-500, 500, COUNT) + rng.normal(0, 100, COUNT), 300
    )
    assert corrected < 0.95 * fitted


@pytest.mark.board
@pytest.mark.parametrize("sigma_um", [3, 300])
def test_gaussian_errors_stay_at_their_mean(sigma_um):
    fitted, corrected = errors_um(lambda rng: rng.normal(0, sigma_um, COUNT), sigma_um)
    assert corrected < 1.08 * fitted


@pytest.mark.board
@pytest.mark.parametrize("noise_um", [NO_NOISE, WEAK, np.where(np.arange(COUNT), 5.0, 3000.0)])
def test_exact_positions_have_no_common_error(noise_um):
    _, corrected = errors_um(lambda rng: np.zeros(COUNT), 1.0, noise_um, range(4))
    assert corrected < 2
