"""Shared by all tiers: a calibrated simulated sensor, made once."""

from __future__ import annotations

import os

import pytest
from hypothesis import settings

from spots.calibrate.stage import calibrate
from spots.sim.files import SensorFile, load

# A loaded machine is slow, not wrong.
settings.register_profile("spots", deadline=None, derandomize=bool(os.environ.get("CI")))
settings.load_profile("spots")


@pytest.fixture(scope="session")
def sensor():
    """The default sensor."""
    return load(SensorFile, "default")


@pytest.fixture(scope="session")
def calibration(sensor):
    """Lines of its calibration, from presses of the simulated stage."""
    return list(calibrate(sensor))
