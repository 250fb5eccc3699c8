"""The table that converts brightness to force: its errors are small, and have both signs."""

import numpy as np
import pytest

from spots import SpotsError
from spots.calibrate.fit.decoded import Decoded
from spots.calibrate.fit.fit import fit
from spots.calibrate.fit.presses import Noise, Presses
from spots_device.reading.calibration import Calibration, Conditions
from spots_sim.measure.bound import Bound
from spots_sim.person.stage import calibrate
from spots_sim.strip.files import SensorFile, load


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


@pytest.mark.board
@pytest.mark.parametrize("name", ["default", "short_30mm", "weak_dye", "strong_dye"])
def test_the_errors_of_the_force_are_balanced_and_small(name):
    errors = errors_mN(name)
    print(name, errors.mean(), np.abs(errors).mean(), np.abs(errors).max())
    assert abs(errors.mean()) < 2.5
    assert np.abs(errors).max() < 12


@pytest.mark.parametrize(
    ("lit", "says"), [(9, "only 9 forces give light in all channels"), (10, "does not rise")]
)
def test_too_few_forces_are_not_reported_as_a_brightness_that_does_not_rise(lit, says):
    def presses(position_um, force_mN, brightness):
        slopes = np.array([4e-5, 3e-5, 2e-5, 1.5e-5, 1e-5, 0.5e-5])
        logs = 10 + brightness[:, None] - position_um[:, None] * slopes
        saturated = np.zeros(len(logs), dtype=bool)
        return Presses(position_um, force_mN, 2.0**logs, np.full(logs.shape, 0.1), saturated)

    at_um = np.linspace(0, 85_000, 17)
    along = presses(at_um, np.full(17, 6000.0), np.zeros(17))
    force_mN = np.geomspace(100, 10_000, 14)
    pressed = presses(np.full(14, 42_500.0), force_mN, np.zeros(14))  # equally bright
    pressed.counts[: 14 - lit, 0] = 0.5
    conditions = Conditions("ab", ("F3", "F4", "F5", "F6", "F7", "F8"), 9, 2780, 10)
    with pytest.raises(SpotsError, match=says):
        fit({0: along}, pressed, Noise(0.1, 0.01), conditions)
