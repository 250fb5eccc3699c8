"""Calibration by hand of a strip whose colour depends on the force."""

import numpy as np
import pytest
from support.press_model import Strip, has_cross

from spots.calibrate.fit.decoded import Decoded
from spots.calibrate.fit.fit import fit
from spots.calibrate.fit.presses import FIRM_MN, FORCE_PLACES, MARKS, Noise, Presses
from spots.calibrate.fit.surface import Surface
from spots.calibrate.fit.surface_search import fitted
from spots.calibrate.fit.surface_sizes import Sizes
from spots_device.reading.calibration import Calibration

pytestmark = pytest.mark.board

PRESSES, SAMPLES = 39, 40
FORCES_MN = 600.0, 1000.0, 3000.0, 9000.0


def pressed_by_hand(strip, seed):
    """Return presses that the fit has asked for, read to 0.5 mm and 5 %."""
    rng, length_um = np.random.default_rng((seed, 5)), strip.length_um
    rows, sizes = [], Sizes()
    firm = [(share * length_um, FIRM_MN) for share in MARKS]
    wanted = [*firm, (length_um / 2, FIRM_MN / 3)]
    while len(rows) < PRESSES:
        if not wanted:
            taken = presses(rows)
            if len(rows) % 6:
                surface = Surface(taken, Noise.of(taken), SAMPLES, length_um, sizes)
            else:
                surface = fitted(taken, Noise.of(taken), SAMPLES, length_um, sizes)
                sizes = surface.sizes
            wanted.append(surface.bent.next_press(0.0))
        x_um, force_mN = wanted.pop(0)
        x_um = float(np.clip(round(x_um, -3), 2000, length_um - 2000))
        counts = strip.counts(x_um, force_mN, SAMPLES)
        if counts.min() < 1:
            wanted.append((x_um, 1.4 * force_mN))
            continue
        read_mN = max(round(force_mN * (1 + rng.uniform(-0.05, 0.05)), -1), 10.0)
        rows.append((x_um + rng.uniform(-500, 500), read_mN, counts))
    return presses(rows)


def presses(rows):
    x_um, force_mN, counts = map(np.array, zip(*rows))
    return Presses(x_um, force_mN, counts, np.full_like(counts, 0.3), np.zeros(len(rows), bool))


def calibrated(strip, seed):
    taken = pressed_by_hand(strip, seed)
    surface = fitted(taken, Noise.of(taken), SAMPLES, strip.length_um).moved()
    along = surface.presses(np.linspace(0, strip.length_um, 33), np.full(33, FIRM_MN))
    forces_mN = np.geomspace(1.2 * surface.least_mN, surface.most_mN, 30)
    places_um = np.array(FORCE_PLACES) * strip.length_um
    pressed = surface.presses(np.tile(places_um, 30), np.repeat(forces_mN, len(places_um)))
    misfit = taken.logs - surface.logs(taken.position_um, taken.force_mN)
    return fit({0: along}, pressed, Noise.of(taken), strip.conditions, misfit)


def errors_mm(strip, lines):
    """Return mean and largest error of readings without noise, over places and forces."""
    decode = Decoded()
    decode.calibration = Calibration(lines)
    off = []
    for force_mN in FORCES_MN:
        for share in np.linspace(0.06, 0.94, 12):
            decode.update_mean(strip.bound.counts(share * strip.length_um, force_mN))
            off.append(abs(decode.position_um - share * strip.length_um) / 1000)
    return np.mean(off), np.max(off)


def test_presses_by_hand_show_the_colour_of_the_force():
    strip = Strip(exposure_us=10_000, seed=20, gap_percent=4.5, mode_percent=2.5)
    mean, worst = errors_mm(strip, calibrated(strip, 20))
    assert mean <= 0.12
    assert worst <= 0.35


def test_an_ideal_strip_gets_no_correction_by_hand():
    strip = Strip(exposure_us=10_000, seed=0)
    lines = calibrated(strip, 0)
    assert not has_cross(lines)
    assert errors_mm(strip, lines)[0] < 0.15
