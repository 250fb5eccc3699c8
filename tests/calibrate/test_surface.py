"""The fit of a session by hand: it also estimates the errors of given positions and forces."""

import numpy as np
import pytest

from evidence.effects import with_keys
from spots.calibrate.fit.curves import Curves
from spots.calibrate.fit.presses import Noise, Presses
from spots.calibrate.fit.surface_search import fitted
from spots_sim.measure.bound import Bound
from spots_sim.strip.files import SensorFile, load

pytestmark = pytest.mark.board

PLAN = "F3", "F4", "F5", "F6", "F7", "F8"


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_errors_of_weak_forces_do_not_spoil_firm_ones(sensor, seed):
    rng, length_um = np.random.default_rng(seed), 1000 * sensor.length_mm
    light = Bound(sensor, PLAN, 9, 10_000, 20)
    places_um, forces_mN = rng.uniform(2000, 83_000, 40), np.geomspace(230, 10_000, 40)
    counts = np.array([light.counts(x, f) for x, f in zip(places_um, forces_mN)])
    # 20 mN: a scale that shows grams, and creep of earlier presses.
    read_mN = forces_mN * (1 + 0.03 * rng.normal(size=40)) + 20 * rng.normal(size=40)
    read_um = places_um + 300 * rng.normal(size=40)
    taken = Presses(read_um, read_mN, counts, np.full_like(counts, 0.5), np.zeros(40, bool))
    surface = fitted(taken, Noise.of(taken), 75, length_um)
    assert surface.sizes.force_share <= 0.03
    at_um, at_mN = np.full(12, length_um / 2), np.geomspace(500, 9000, 12)
    expected = np.log2([light.counts(x, f) for x, f in zip(at_um, at_mN)]).mean(axis=1)
    assert np.abs(surface.logs(at_um, at_mN).mean(axis=1) - expected).mean() < 0.02


def test_straight_channels_show_the_errors_of_a_ruler():
    sensor = load(SensorFile, "long_200mm")
    light, length_um, off_um = Bound(sensor, PLAN, 9, 10_000, 20), 1000 * sensor.length_mm, []
    at_um, at_mN = np.linspace(0.05, 0.95, 19) * length_um, np.full(19, 3000.0)
    expected = np.log2([light.counts(x, f) for x, f in zip(at_um, at_mN)])
    slopes = np.gradient(expected, at_um, axis=0)
    for seed in range(6):
        rng = np.random.default_rng(seed)
        places_um, forces_mN = (
            rng.uniform(0, length_um, 39),
            rng.permutation(np.geomspace(450, 10_000, 39)),
        )
        counts = np.array([light.counts(x, f) for x, f in zip(places_um, forces_mN)])
        read_um = places_um + rng.uniform(-500, 500, 39)
        read_mN = forces_mN * (1 + rng.uniform(-0.05, 0.05, 39))
        taken = Presses(read_um, read_mN, counts, np.full_like(counts, 0.1), np.zeros(39, bool))
        off = expected - fitted(taken, Noise.of(taken), 75, length_um).logs(at_um, at_mN)
        off -= off.mean(axis=1, keepdims=True)
        colours = slopes - slopes.mean(axis=1, keepdims=True)
        off_um.append((off * colours).sum(axis=1) / (colours**2).sum(axis=1))
    assert np.sqrt(np.mean(np.square(off_um))) < 100


def test_uneven_dye_shifts_no_position_on_a_stage_and_less_by_hand(sensor):
    # The displacement of the colours is up to 0.5 mm; a polynomial of each channel leaves 0.1 mm.
    uneven = {"dye.uneven_percent": 8.0, "dye.uneven_mm": 37.0, "dye.uneven_phase_deg": 200.0}
    length_um = 1000 * sensor.length_mm
    at_um, noise = np.linspace(0.02, 0.98, 49) * length_um, Noise(0.1, 0.0)
    for keys, most_um in ((uneven, 4), ({}, 3)):
        light, rng = Bound(with_keys(sensor, keys), PLAN, 9, 10_000, 20), np.random.default_rng(5)
        expected = np.log2([light.counts(x, 6000.0) for x in at_um])
        colours = np.gradient(expected, at_um, axis=0)
        colours -= colours.mean(axis=1, keepdims=True)

        def mean_off_um(logs, expected=expected, colours=colours):
            off = (logs - expected) - (logs - expected).mean(axis=1, keepdims=True)
            return np.abs((off * colours).sum(axis=1) / (colours**2).sum(axis=1)).mean()

        places_um = np.linspace(0, length_um, 33)
        counts = np.array([light.counts(x, 6000.0) for x in places_um])
        counts += rng.normal(size=counts.shape) * np.sqrt(noise.variance(counts) / 240)
        curves = Curves(places_um, np.log2(counts), noise.log_variance(counts))
        assert mean_off_um(curves.logs(at_um)) < most_um
        if not keys:
            continue
        places_um, forces_mN = rng.uniform(0, length_um, 45), np.geomspace(450, 10_000, 45)
        counts = np.array([light.counts(x, f) for x, f in zip(places_um, forces_mN)])
        read_um = places_um + rng.uniform(-500, 500, 45)
        taken = Presses(read_um, forces_mN, counts, np.full_like(counts, 0.1), np.zeros(45, bool))
        surface = fitted(taken, Noise.of(taken), 75, length_um).moved()
        assert mean_off_um(surface.logs(at_um, np.full(49, 6000.0))) < 200


def presses_by_hand(light, length_um, seed):
    """Return 39 `Presses` whose positions have errors up to 0.5 mm, and whose forces up to 5 %."""
    rng = np.random.default_rng((seed, 99))
    shares = rng.choice([0.05, 0.3, 0.7, 0.95], 39) + rng.uniform(-0.05, 0.05, 39)
    places_um = shares.clip(0, 1) * length_um
    forces_mN = rng.permutation(np.geomspace(450, 10_000, 39))
    counts = np.array([light.counts(x, f) for x, f in zip(places_um, forces_mN)])
    counts += 0.04 * rng.normal(size=counts.shape)
    read_um = places_um + rng.uniform(-500, 500, 39)
    read_mN = forces_mN * (1 + rng.uniform(-0.05, 0.05, 39))
    return Presses(read_um, read_mN, counts, np.full_like(counts, 0.1), np.zeros(39, bool))


def error_um(light, surface):
    """Return the mean absolute error in um of the positions that a fit computes from spectra."""
    at_um = np.linspace(0.05, 0.95, 19) * surface.length_um
    expected = np.log2([light.counts(x, 3000.0) for x in at_um])
    slopes = np.gradient(expected, at_um, axis=0)
    off = expected - surface.logs(at_um, np.full_like(at_um, 3000.0))
    off -= off.mean(axis=1, keepdims=True)
    colours = slopes - slopes.mean(axis=1, keepdims=True)
    return np.abs((off * colours).sum(axis=1) / (colours**2).sum(axis=1)).mean()


def fits(sensor, seeds):
    light, length_um = Bound(sensor, PLAN, 9, 10_000, 20), 1000 * sensor.length_mm
    for seed in seeds:
        taken = presses_by_hand(light, length_um, seed)
        yield light, fitted(taken, Noise.of(taken), 75, length_um)


def test_bends_agree_with_convex_curves(sensor):
    # Without the prior for the bends, the fit to these presses has a concave curve of F8, and
    # errors of 89 to 132 um.
    for light, surface in fits(sensor, (4, 6, 9)):
        assert error_um(light, surface) < 75
        assert surface.sizes.bends[PLAN.index("F8")] < surface.sizes.bends[PLAN.index("F7")]


def test_rounded_positions_of_a_fit_have_less_error_in_common(sensor):
    found = np.array(
        [(error_um(*one), error_um(one[0], one[1].moved())) for one in fits(sensor, range(5))]
    )
    assert found[:, 1].mean() < 0.8 * found[:, 0].mean()
