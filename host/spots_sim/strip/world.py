"""The light that a simulated chip receives from a strip in a scenario."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache, partial

import numpy as np

from ..chip.as7341 import AS7341
from ..chip.converter import ChipNoise
from ..chip.quirks import Quirks
from .change import NONE, Change
from .contact import Sticking, coupling
from .files import SensorFile
from .optics import Optics
from .scenario import flicker, unshaded
from .silicone import Memory

CALIBRATED_C = 25.0  # temperature of a board whose sensor has not changed since the calibration
# Longest time step within one integration; a finger counts as still during a step.
_STEP_US = 2_500.0
# The LED's temperature is rounded to this digit, so that optics can be cached: error below 1 um.
_LED_K_DIGITS = 2
_KEPT = 512  # number of cached `Optics` of a sensor
_SENSORS = 4  # number of sensors whose optics are cached


@lru_cache(_SENSORS)
def _optics(sensor: SensorFile) -> Callable[[Change, float], Optics]:
    """Return a function that computes and caches `Optics`.

    Its arguments are the `Change` of the sensor since the calibration, and the LED's temperature
    rise in K.
    """
    return lru_cache(_KEPT)(partial(Optics, sensor))


class World:
    """The light that a simulated chip receives: from the LED through the strip, and ambient light.

    With `warm`, the LED has its final temperature from the start; otherwise it warms up first.
    """

    def __init__(self, sensor: SensorFile, scenario, rng, warm: bool = False):
        self._sensor = sensor
        self._scenario = scenario
        self._rng = rng
        self._optics_at = _optics(sensor)
        self._state = NONE, 0.0  # change and temperature of the LED that `_optics` is for
        self._optics = self._optics_at(*self._state)
        self._seen: tuple = ()  # what `_parts` is for
        self._parts: list[np.ndarray] = []
        self._shares: list[float] = []
        self._led_K = 0.0  # at the time `_led_us`
        self._led_us = 0.0
        self._warm_start = warm
        self._pin_on = False
        self._memory = None if sensor.silicone.ideal else Memory(sensor.silicone)
        self._sticking = (
            Sticking(sensor.contact, sensor.length_mm) if sensor.contact.sticking_percent else None
        )
        self._cells: tuple = None, None, None  # optics and pose, and the light of each cell

    def collect(self, start_us: float, end_us: float, led_mA: float) -> dict[str, float]:
        """Return the counts of each diode for an ideal converter at gain 1x.

        `led_mA` is the current of the chip's LED driver; it has no effect if the LED is not wired
        to this driver.
        """
        duration_us = end_us - start_us
        led_mA = self._strip_mA(led_mA)
        steps = 1 if self._scenario.still else math.ceil(duration_us / _STEP_US)
        step_us = duration_us / steps
        self._warm(end_us, led_mA)
        change = self._sensor.change + self._scenario.change((start_us + end_us) * 0.5e-6)
        state = change, round(self._led_K, _LED_K_DIGITS)
        if state != self._state:
            self._state, self._optics = state, self._optics_at(*state)
        rates = np.zeros(len(self._optics.names))
        if led_mA > 0:
            level = self._led_level(start_us, duration_us)
            # Most samples of a scenario are without a finger.
            if not (self._at_rest() and self._scenario.is_dark(start_us * 1e-6, end_us * 1e-6)):
                for i in range(steps):
                    for part in self._light((start_us + (i + 0.5) * step_us) * 1e-6):
                        rates += part
                rates /= steps
                rates *= self._optics.source_uW_cm2(led_mA) * level
        ambient_uW_cm2 = self._ambient_uW_cm2(start_us * 1e-6, end_us * 1e-6)
        if ambient_uW_cm2:
            rates += self._optics.ambient(ambient_uW_cm2)
        return dict(zip(self._optics.names, (rates * duration_us / 1000).tolist()))

    def switch(self, on: bool) -> None:
        """Set the level of the board's LED pin; switches the LED if ``led.wired`` is ``gpio``."""
        self._pin_on = on

    def _strip_mA(self, driver_mA: float) -> float:
        led = self._sensor.led
        if led.wired == "ldr":
            dark = False
        else:
            dark = self._scenario.unplugged if led.wired == "always" else not self._pin_on
        return 0.0 if dark else led.current_mA(driver_mA)

    def outside(self, start_us: float, end_us: float) -> float:
        """Return the mean irradiance of the ambient light in an interval, in uW/cm2."""
        return self._ambient_uW_cm2(start_us * 1e-6, end_us * 1e-6)

    def temperature_C(self, now_us: float) -> float:
        """Return the temperature of strip, LED and board, without self-heating."""
        change = self._sensor.change + self._scenario.change(now_us * 1e-6)
        return CALIBRATED_C + change.temperature_K

    def _ambient_uW_cm2(self, start_s: float, end_s: float) -> float:
        around = self._sensor.surroundings
        steady = around.irradiance_uW_cm2
        if steady:
            steady *= flicker(around, start_s, end_s) * unshaded(around, self._scenario, start_s)
        return steady + self._scenario.ambient_uW_cm2(start_s, end_s)

    def _at_rest(self) -> bool:
        # Whether no light couples without a finger.
        return (
            (self._memory is None or self._memory.unloaded)
            and (self._sticking is None or self._sticking.free)
            and not self._sensor.contact.dust
        )

    def _light(self, time_s: float) -> list[np.ndarray]:
        # Return the count rates by each press and by the leak, at one moment.
        pose = self._scenario.pose(time_s)
        presses = self._scenario.presses(time_s)
        forces_mN = [press.force_mN for press in presses]
        if self._memory:
            forces_mN = self._memory.effective_mN(presses, time_s)
        contact = self._sensor.contact
        seen = self._optics, pose, presses, forces_mN
        # Successive samples of a constant press have the same light.
        if seen != self._seen:
            self._seen = seen
            self._shares = [coupling(contact, force_mN) for force_mN in forces_mN]
            self._parts = [
                self._rates_of(
                    pose, share, press.position_mm, press.width_mm, press.tilt_percent, press.skin
                )
                for press, share in zip(presses, self._shares)
                if share > 0
            ]
            if pose.leak_share > 0:
                self._parts.append(self._rates_of(pose, pose.leak_share, pose.leak_mm))
            for place_mm, percent in contact.dust:
                place_mm *= 1 + pose.strain
                self._parts.append(self._rates_of(pose, percent / 100, place_mm))
        if self._sticking is None:
            return self._parts
        left = self._sticking.remaining(presses, self._shares, time_s)
        if left is None:
            return self._parts
        optics, before, rates = self._cells
        if optics is not self._optics or before != pose:
            places_mm = self._sticking.places_mm
            rates = self._optics.narrow(places_mm, pose.strain, pose.bend_deg)
            self._cells = self._optics, pose, rates
        return [*self._parts, left @ rates]

    def _rates_of(self, pose, share, place_mm, width_mm=0.0, tilt_percent=0.0, skin=False):
        # The count rates by a contact share at a place.
        optics = self._optics
        rates = optics.press(
            place_mm,
            width_mm,
            pose.strain,
            pose.bend_deg,
            tilt_percent,
            share if optics.coloured else 1.0,
            skin,
        )
        return share * rates

    def _warm(self, end_us: float, led_mA: float) -> None:
        # The LED approaches its final temperature at the present current, also between two calls.
        warmth = self._sensor.temperature
        in_the_end_K = warmth.led_K_per_mA * led_mA
        if self._warm_start and in_the_end_K:
            self._led_K, self._warm_start = in_the_end_K, False
        share = math.exp(-max(end_us - self._led_us, 0.0) * 1e-6 / warmth.led_warm_up_s)
        self._led_K = in_the_end_K + share * (self._led_K - in_the_end_K)
        self._led_us = end_us

    def _led_level(self, start_us: float, duration_us: float) -> float:
        led = self._sensor.led
        warm = led.warm_up_percent / 100 * math.exp(-start_us * 1e-6 / led.warm_up_s)
        white = led.noise_ppm_10ms * 1e-6 * math.sqrt(10_000 / duration_us)
        return 1 + warm + white * self._rng.standard_normal()


def chip(sensor: SensorFile, scenario, seed: int, warm: bool = False) -> AS7341:
    """Return a simulated AS7341 that receives the light of a strip; `warm` as in `World`."""
    rng = np.random.default_rng(seed)
    c = sensor.converter
    return AS7341(
        World(sensor, scenario, rng, warm),
        ChipNoise(
            c.read_noise_counts, c.electrons_per_count_1x, c.dark_counts_512x, c.ratio_noise_ppm
        ),
        rng,
        Quirks(
            c.auto_zero_at_every_start,
            c.avalid_clears_on_read,
            c.aint_needs_sp_ien,
            c.smux_us,
            c.clock_error_percent,
        ),
    )
