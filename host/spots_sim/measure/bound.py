"""The Cramer-Rao bound: the smallest standard deviation that an unbiased estimate can have.

The bound is computed from the simulated optics and noise. It does not depend on the calibration.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..chip.converter import GAIN
from ..strip.change import NONE, Change
from ..strip.contact import coupling
from ..strip.files import SensorFile
from ..strip.optics import Optics
from ..strip.scenario import Press
from ..strip.silicone import Memory

_ROUNDING_VARIANCE = 1 / 12  # of a count, by rounding to whole counts
_STEP_MM = 1e-3
_STEP_MN = 1.0
_STEP = 1e-4  # relative, of the contact share


class Bound:
    """The Cramer-Rao bound of a simulated sensor, for readings of six counts.

    `plan` names the six diodes in the order of the counts; `gain` is a register code, 0 to 10;
    `average` is the number of samples in a reading. `sigma` returns the bounds for the position of
    a press, and for the light that the press couples into the dyed light guide. `force_sigma_mN`
    returns the bound for its force.
    """

    def __init__(
        self,
        sensor: SensorFile,
        plan: Sequence[str],
        gain: int,
        exposure_us: float,
        led_mA: float,
        average: int = 1,
        change: Change = NONE,
    ):
        led_mA = sensor.led.current_mA(led_mA)
        optics = Optics(sensor, change, sensor.temperature.led_K_per_mA * led_mA)  # warm LED
        self._sensor = sensor
        self._optics = optics
        self._columns = [optics.names.index(diode) for diode in plan]
        self._average = average
        self._led = sensor.led.noise_ppm_10ms * 1e-6 * (10_000 / exposure_us / average) ** 0.5
        converter = sensor.converter
        scale = GAIN[gain] * exposure_us / 1000
        self._scale = scale * optics.source_uW_cm2(led_mA)
        self._electrons = converter.electrons_per_count_1x / GAIN[gain]
        dark = converter.dark_counts_512x * GAIN[gain] / GAIN[10] * exposure_us / 98_000
        around = sensor.surroundings
        outside = scale * optics.ambient(
            around.irradiance_uW_cm2 * (1 - around.shaded_percent / 100)
        )
        self._pedestal = dark + outside[self._columns]

    def counts(
        self,
        position_um: float,
        force_mN: float,
        width_mm: float = 4.0,
        strain: float = 0.0,
        bend_deg: float = 0.0,
    ):
        """Return the six expected counts of one sample, without dark counts and ambient light.

        `position_um` is counted from the sensor's end; `strain` is elongation by length at rest.
        """
        share = self._coupling(force_mN)
        return self._of_share(share, position_um, width_mm, strain, bend_deg)

    def _of_share(self, share, position_um, width_mm=4.0, strain=0.0, bend_deg=0.0):
        rates = self._optics.press(position_um / 1000, width_mm, strain, bend_deg, share=share)
        return rates[self._columns] * self._scale * share

    def _dust(self, strain: float, bend_deg: float) -> np.ndarray:
        # The light of the dust is known, but has noise.
        counts = np.zeros(len(self._columns))
        for place_mm, percent in self._sensor.contact.dust:
            place_um = 1000 * place_mm * (1 + strain)
            counts += self._of_share(percent / 100, place_um, 0.0, strain, bend_deg)
        return counts

    def _by_light(self, force_mN: float, counts: np.ndarray, *press, **more) -> np.ndarray:
        # Derivative of the counts by the logarithm of the contact share.
        if not self._optics.coloured:
            return counts
        share = self._coupling(force_mN)
        ahead, back = (
            self._of_share(share * (1 + step), *press, **more) for step in (_STEP, -_STEP)
        )
        return (ahead - back) / (2 * _STEP)

    def _coupling(self, force_mN: float) -> float:
        # The first press of a strip has no creep and no hysteresis. The largest earlier force,
        # `Silicone.preload_mN`, has softened the strip.
        effective = Memory(self._sensor.silicone).effective_mN([Press(0.0, force_mN, 0.0)], 0.0)
        return coupling(self._sensor.contact, effective[0])

    def force_sigma_mN(self, position_um: float, force_mN: float) -> float:
        """Return the Cramer-Rao bound of a force that is estimated from one reading, in mN.

        The bound includes the noise of the LED, which is the same in all channels.
        """
        _, light = self.sigma(position_um, force_mN)
        ahead, back = (self._coupling(force_mN + step) for step in (_STEP_MN, -_STEP_MN))
        return math.hypot(light, self._led) / (math.log(ahead / back) / (2 * _STEP_MN))

    def sigma(self, position_um: float, force_mN: float, **press) -> tuple[float, float]:
        """Return the least standard deviations of position in um and of ln(coupled light).

        `press` has further parameters of `counts`.
        """
        counts = self.counts(position_um, force_mN, **press)
        step_um = 1000 * _STEP_MM
        ahead = self.counts(position_um + step_um, force_mN, **press)
        back = self.counts(position_um - step_um, force_mN, **press)
        dust = self._dust(press.get("strain", 0.0), press.get("bend_deg", 0.0))
        variance = (
            self._sensor.converter.read_noise_counts**2
            + _ROUNDING_VARIANCE
            + (counts + dust + self._pedestal) / self._electrons
            + (1e-6 * self._sensor.converter.ratio_noise_ppm * (counts + dust)) ** 2
        ) / self._average
        # Fisher information of the position and of the logarithm of the light. The noise of the LED
        # changes only the light, because it is the same in all channels.
        by_light = self._by_light(force_mN, counts, position_um, **press)
        jacobian = np.stack([(ahead - back) / (2 * step_um), by_light], axis=1)
        covariance = np.linalg.inv(jacobian.T @ (jacobian / variance[:, None]))
        return float(np.sqrt(covariance[0, 0])), float(np.sqrt(covariance[1, 1]))
