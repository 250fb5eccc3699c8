"""The noise of each channel is separated from the tremor that all channels share."""

import numpy as np
import pytest

from spots.calibrate.fit.presses import own_variance

FAR_END = np.array([31.3, 33.1, 60.2, 195.4, 636.1, 488.3])  # counts at the far end of a long strip
TREMOR = 0.005


def own_variances(noise_per_count, count=24, seeds=range(200)):
    """Return the means and standard deviations of own_variance for presses at the far end."""
    found = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        counts = FAR_END * rng.normal(1, TREMOR, (count, 1))
        counts += rng.normal(size=counts.shape) * np.sqrt(noise_per_count * FAR_END)
        found.append(own_variance(np.round(counts)))
    return np.mean(found, axis=0), np.std(found, axis=0)


def test_bright_channels_have_only_their_own_noise_beside_dim_ones():
    mean, scatter = own_variances(0.0)
    assert (mean < 0.15).all()  # rounding has a variance of 1/12
    assert (scatter < 0.2).all()


def test_the_noise_is_found_without_a_bias():
    mean, _ = own_variances(0.01)
    assert mean == pytest.approx(0.01 * FAR_END + 1 / 12, rel=0.1)
