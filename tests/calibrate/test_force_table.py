"""The table that converts brightness to force: its errors are small, and have both signs."""

import numpy as np
import pytest

from spots_device.calibration import Calibration
from spots_device.views import Decoded
from spots_sim.bound import Bound
from spots_sim.files import SensorFile, load
from spots_sim.stage import calibrate


def errors_mN(name):
    """Return the errors in mN of forces that a board computes from light without noise.

    `name` is a sensor file. The forces are from about 0.6 to 9.8 N, in the middle of the strip.
    """
    sensor = load(SensorFile, name)
    decode = Decoded()
    decode.calibration = table = Calibration(calibrate(sensor))
    c = table.conditions
    light = Bound(sensor, c.plan, c.gain, c.exposure_us, c.led_mA)
    forces_mN = np.linspace(max(600, 2 * table.forces_mN[0]), 9_800, 120)
    errors = []
    for force_mN in forces_mN:
        counts = light.counts(500 * sensor.length_mm, force_mN)
        decode.update_mean(counts)
        errors.append(decode.force_mN - force_mN)
    return np.array(errors)


@pytest.mark.parametrize("name", ["default", "short_30mm", "weak_dye", "strong_dye"])
def test_the_errors_of_the_force_are_balanced_and_small(name):
    errors = errors_mN(name)
    print(name, errors.mean(), np.abs(errors).mean(), np.abs(errors).max())
    assert abs(errors.mean()) < 2.5
    assert np.abs(errors).max() < 12
