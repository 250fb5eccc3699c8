"""Unusual strips: channels with nearly the same decay, a long strip, a weak dye."""

import numpy as np
import pytest
from msgspec import structs
from support.refusals import refusal

from evidence.effects import errors
from spots.calibrate.fit.fit import estimators
from spots.errors import CalibrationError, SettingError
from spots_device.reading.calibration import Calibration
from spots_sim.measure import measurements
from spots_sim.measure.measurements import (
    Run,
    _force,
    _position,
    characterize,
)
from spots_sim.measure.pair import OnePair
from spots_sim.measure.rig import Rig
from spots_sim.person.stage import calibrate
from spots_sim.strip.files import SensorFile, load

pytestmark = pytest.mark.board


def test_a_brown_dye_under_a_narrow_green_phosphor_is_calibrated(sensor):
    green = structs.replace(
        sensor.led,
        phosphor_nm=550.0,
        phosphor_fwhm_nm=60.0,
        blue_share=0.2,
        irradiance_uW_cm2_per_mA=100.0,
    )
    brown = structs.replace(sensor.dye, strength_per_mm=0.01, edge_nm=680.0, edge_width_nm=40.0)
    run = Run()
    with Rig(structs.replace(sensor, led=green, dye=brown), 0, 100_000, 1) as rig:
        _position(rig, np.random.default_rng(1), run, np.linspace(0.1, 0.9, 5))
        _force(rig, run)
    assert run.summary["position"]["crb_ratio"] < 1.15
    assert run.summary["position"]["untrusted_percent"] == 0
    assert run.summary["force"]["accuracy_N"] < 0.1


def test_a_brown_dye_under_a_violet_led_is_calibrated_on_a_long_strip(sensor):
    violet = structs.replace(
        sensor.led,
        blue_nm=397.0,
        blue_fwhm_nm=13.0,
        blue_share=0.37,
        phosphor_nm=542.0,
        phosphor_fwhm_nm=139.0,
        irradiance_uW_cm2_per_mA=100.0,
    )
    brown = structs.replace(sensor.dye, strength_per_mm=0.019, edge_nm=686.0, edge_width_nm=55.0)
    with Rig(structs.replace(sensor, length_mm=140.0, led=violet, dye=brown), 0, 100_000, 1) as rig:
        (firm,) = errors(rig, (6.0,), readings=12, places=(0.1, 0.3, 0.5, 0.7, 0.9))
    assert 0.8 < firm.scatter_to_bound < 1.3
    assert firm.bias_mm < 0.05
    assert firm.untrusted_percent == 0


def test_channels_that_decay_alike_are_refused_in_one_sentence():
    alike = np.stack([np.ones(6), np.full(6, 0.5)], axis=1)
    with refusal(CalibrationError):
        estimators(alike, np.ones(6))


def test_a_strip_whose_touches_begin_above_the_force_of_a_measurement_is_refused(sensor):
    green = structs.replace(
        sensor.led,
        phosphor_nm=540.0,
        phosphor_fwhm_nm=60.0,
        blue_share=0.3,
        irradiance_uW_cm2_per_mA=6.0,
    )
    brown = structs.replace(sensor.dye, strength_per_mm=0.022, edge_nm=640.0, edge_width_nm=60.0)
    with refusal(SettingError):
        characterize(structs.replace(sensor, led=green, dye=brown), 1, 100_000)


def test_the_straightness_of_the_response_does_not_depend_on_the_pair(sensor, monkeypatch):
    class Another(OnePair):
        def __init__(self, along, noise):
            super().__init__(along, noise)
            self.channels = 0, 3

    found = []
    with Rig(sensor, 0, 10_000, 1) as rig:
        for pair in (OnePair, Another):
            monkeypatch.setattr(measurements, "OnePair", pair)
            run = Run()
            _position(rig, np.random.default_rng(1), run, np.array([0.3, 0.6]))
            found.append(run.summary["position"])
    assert found[0]["one_pair"]["channels"] != found[1]["one_pair"]["channels"]
    assert found[0]["r2"] == found[1]["r2"] > 0.999


def test_a_light_tap_is_a_touch_on_a_long_strip():
    made = Calibration(calibrate(load(SensorFile, "long_200mm")))
    # The keys of a long strip are wide, so touches with less accurate positions are sufficient.
    assert made.touch_on_mN < 1500
