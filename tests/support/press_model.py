"""Presses of a simulated strip, without a board."""

import numpy as np

from evidence.effects import with_keys
from spots.calibrate.fit.decoded import Decoded
from spots.calibrate.fit.fit import fit
from spots.calibrate.fit.presses import FIRM_MN, FORCE_PLACES, FULL_MN, Noise, Presses
from spots_device.reading.calibration import Calibration, Conditions
from spots_device.reading.decode import TOUCHING
from spots_sim.measure.bound import Bound
from spots_sim.strip.files import SensorFile, load

PLAN = "F3", "F4", "F5", "F6", "F7", "F8"


ALONG, PRESSED = 24, 8  # samples in a reading of a stage


OFF_CENTRE = np.linspace(0.06, 0.94, 12)  # places that no press of the calibration had


class Strip:
    """Presses of a simulated strip with the noise of its sensor, without a board."""

    def __init__(self, name="default", exposure_us=100_000, seed=0, **contact):
        keys = {f"contact.{key}": value for key, value in contact.items()}
        self.sensor = with_keys(load(SensorFile, name), keys)
        self.conditions = Conditions("ab", PLAN, 9, exposure_us, 20)
        self.bound = Bound(self.sensor, PLAN, 9, exposure_us, 20)
        self.length_um = 1000 * self.sensor.length_mm
        self.rng = np.random.default_rng(seed)

    def variance(self, counts):
        converter = self.sensor.converter
        shot = (counts + self.bound._pedestal) / self.bound._electrons
        return converter.read_noise_counts**2 + 1 / 12 + shot

    def counts(self, place_um, force_mN, samples):
        """Return the mean of dark-subtracted samples, which are rounded as a sensor rounds them."""
        lit = self.bound.counts(place_um, force_mN)
        noise = np.sqrt(self.variance(lit) - 1 / 12) * self.rng.standard_normal((samples, 6))
        raw = np.round(lit + self.bound._pedestal + noise)
        return np.maximum(raw - self.bound._pedestal, 0.1).mean(axis=0)

    def presses(self, places_um, forces_mN, samples, slip_um=0.0):
        at = [(x, f) for f in forces_mN for x in places_um]
        slips = slip_um * self.rng.standard_normal(len(at))
        counts = np.array([self.counts(x + s, f, samples) for (x, f), s in zip(at, slips)])
        x_um, force_mN = np.array(at).T
        return Presses(x_um, force_mN, counts, self.variance(counts), np.zeros(len(at), bool))

    def lines(self, slip_um=0.0):
        """Return the calibration from a stage whose positions have an error of `slip_um`."""
        along = self.presses(np.linspace(0, self.length_um, 33), [FIRM_MN], ALONG)
        forces_mN = np.geomspace(self.least_mN(), FULL_MN, 30)
        places_um = np.array(FORCE_PLACES) * self.length_um
        pressed = self.presses(places_um, forces_mN, PRESSED, slip_um)
        return fit({0: along}, pressed, Noise.of(along, pressed), self.conditions)

    def least_mN(self):
        far_um = max(FORCE_PLACES) * self.length_um
        forces_mN = np.geomspace(100, 1000, 60)
        return next(f for f in forces_mN if self.bound.counts(far_um, f).min() > 1.5)

    def errors_mm(self, lines, force_mN, readings=6):
        """Return the mean absolute error in mm, and the largest mean error at a place."""
        decode = Decoded()
        decode.calibration = Calibration(lines)
        off = []
        for share in OFF_CENTRE:
            for _ in range(readings):
                x_um = share * self.length_um
                decode.update_mean(self.counts(x_um, force_mN, 1))
                assert decode.flags & TOUCHING
                off.append((decode.position_um - x_um) / 1000)
        off = np.array(off).reshape(len(OFF_CENTRE), readings)
        return np.abs(off).mean(), np.abs(off.mean(axis=1)).max()


def has_cross(lines):
    return {len(line.split()) - 1 for line in lines if line.startswith("x ")} == {6}
