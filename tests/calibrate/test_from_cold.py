"""The sensor file `real`, an aged strip, from a cold LED on; see `evidence.from_cold`."""

import numpy as np
import pytest
from support.sensors import replaced

from evidence.from_cold import joint, typing
from spots_sim.measure.bound import Bound
from spots_sim.strip.files import SensorFile, load


@pytest.fixture(scope="module")
def real():
    """Sensor file `real`, with every physical effect; its LED warms up in half the time."""
    return replaced(load(SensorFile, "real"), temperature={"led_warm_up_s": 30.0})


@pytest.mark.board
def test_a_cold_strip_that_was_re_zeroed_once_types_what_was_touched(real):
    figures = typing(real, 0.2, 0, True)
    assert figures["right"] == figures["touches"] > 25
    assert figures["extra"] == figures["stuck"] == 0
    assert figures["host_agrees"]


@pytest.mark.board
def test_a_joint_is_accurate_to_a_twentieth_of_a_degree_after_one_re_zero(real):
    *_, before, after = joint(real, 3, 0, 6, warm_min=2)
    assert (before["rezeroed"], after["rezeroed"]) == (False, True)
    assert before["accuracy_deg"] > 0.5
    assert after["accuracy_deg"] < 0.05


@pytest.mark.parametrize(("average", "least_deg", "most_deg"), [(1, 0.06, 0.1), (6, 0.0, 0.04)])
def test_the_bound_of_a_joint_needs_an_average(real, average, least_deg, most_deg):
    plan = ["F3", "F4", "F5", "F6", "F7", "F8"]
    bound = Bound(real, plan, 9, 10_000, 20, average, real.change)
    places_um = 1000 * real.length_mm * np.linspace(0.1, 0.9, 31)
    sigma_um = np.mean([bound.sigma(x_um, real.joint.force_mN)[0] for x_um in places_um])
    # The mean absolute value of a normal variable is sqrt(2 / pi) times its standard deviation.
    mean_deg = np.sqrt(2 / np.pi) * sigma_um / (1000 * np.radians(real.joint.radius_mm))
    assert least_deg < mean_deg < most_deg
