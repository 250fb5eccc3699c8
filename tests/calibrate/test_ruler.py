"""The common error of positions from a ruler, for rounded and for Gaussian errors."""

import numpy as np
import pytest

from spots.calibrate.ruler import common_error_um

COUNT, LENGTH_UM = 39, 85_000.0


def errors_um(draw, seeds=range(60)):
    """Return the mean error of lines through positions with errors, and the same, corrected."""
    found = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        true_um = rng.uniform(0, LENGTH_UM, COUNT)
        read_um = true_um + draw(rng)
        line = np.polyval(np.polyfit(true_um, read_um, 1), true_um)
        found.append((line - true_um, line - common_error_um(read_um, line - read_um) - true_um))
    return np.abs(found).mean(axis=(0, 2))


def test_rounded_positions_have_much_less_error_in_common():
    fitted, corrected = errors_um(lambda rng: rng.uniform(-500, 500, COUNT))
    assert corrected < 0.7 * fitted


def test_rounded_positions_with_parallax_are_corrected_too():
    fitted, corrected = errors_um(
        lambda rng: rng.uniform(-500, 500, COUNT) + rng.normal(0, 100, COUNT)
    )
    assert corrected < 0.95 * fitted


@pytest.mark.parametrize("sigma_um", [3, 150, 300])
def test_gaussian_errors_stay_at_their_mean(sigma_um):
    fitted, corrected = errors_um(lambda rng: rng.normal(0, sigma_um, COUNT))
    assert corrected < 1.08 * fitted


def test_exact_positions_have_no_common_error():
    read_um = np.linspace(0, LENGTH_UM, 12)
    assert np.abs(common_error_um(read_um, np.zeros(12))).max() < 1
