"""A stage that presses the simulated strip: real firmware, simulated time, known presses."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from spots.calibrate.fit import fit
from spots.calibrate.presses import FIRM_MN, FORCE_PLACES, FULL_MN, Noise, Presses
from spots.calibrate.spectra import SpectrumReader
from spots.link.board import Board

from .files import SensorFile
from .lockstep import LockstepLink
from .scenario import Held, Press

PLACES = 33
FORCES = 30
NEAR_UM = 2000.0  # where the light is brightest, with the whole finger on the strip
_WIDTH_MM = 4.0
_WARM_S = 120.0  # a person would let the LED warm up, too
_OSCILLATOR_S = 5.0  # in which a board measures the oscillator of its sensor
_SEARCH_TIMEOUT_S = 600.0


class Stage:
    """A simulated strip under an indenter, read through the firmware.

    Parameters
    ----------
    sensor : SensorFile
        As it was calibrated; `held.changed` is what changes it.
    seed : int
        Of the noise.
    settings : str
        What to `set` first, such as ``exposure_us=100000``. Under flickering lamps `mains_hz` is
        set before.
    """

    def __init__(self, sensor: SensorFile, seed: int = 0, settings: str = ""):
        self.sensor = sensor
        self.held = Held()
        self.board = Board(LockstepLink(sensor.unchanged(), self.held, seed, started_s=_WARM_S))
        if sensor.mains_hz:
            self.board.command(f"set mains_hz={sensor.mains_hz}")
            for _ in self.board.frames(_OSCILLATOR_S):
                pass
        if settings:
            self.board.command("set " + settings)
        self.reader = SpectrumReader(self.board)

    def __enter__(self) -> Stage:
        return self

    def __exit__(self, *exception) -> None:
        self.board.close()

    @property
    def length_um(self) -> float:
        """Length of the strip as it is stretched now."""
        return 1000 * self.sensor.length_mm * (1 + self.held.strain)

    def expose(self, exposure_us: int | None = None) -> None:
        """Let the board find gain and LED current under a full press near the sensor.

        Parameters
        ----------
        exposure_us : int, optional
            What the exposure is to be, even if the search lengthened it for a dim strip.

        Raises
        ------
        SpotsError
            If no setting fits this strip.
        """
        self.press(NEAR_UM, FULL_MN)
        self.board.command("auto", timeout_s=_SEARCH_TIMEOUT_S)
        self.release()
        if exposure_us is not None:
            self.board.command(f"set exposure_us={exposure_us}")
        self.reader.set_up()

    def press(self, position_um: float, force_mN: float) -> None:
        """Hold a press there from now on.

        Parameters
        ----------
        position_um : float
            Distance of the press from the sensor's end, in um.
        force_mN : float
            In mN.
        """
        self.held.press = Press(position_um / 1000, force_mN, _WIDTH_MM)

    def release(self) -> None:
        """Touch nothing from now on."""
        self.held.press = None

    def read(self, places_um, forces_mN, samples: int) -> Presses:
        """Press at each place with each force and return the readings.

        Parameters
        ----------
        places_um, forces_mN : sequence of float
        samples : int
            For each press; their mean is its reading.

        Returns
        -------
        Presses
            One row for each force and place, places fastest.
        """
        rows = []
        for force_mN in forces_mN:
            for place_um in places_um:
                self.press(place_um, force_mN)
                r = self.reader.read(samples)
                rows.append((place_um, force_mN, r.counts, r.variance, r.saturated))
        self.release()
        return Presses(*(np.array(column) for column in zip(*rows)))

    def along(self, places: int = PLACES, samples: int = 24) -> Presses:
        """Press firmly at places along the whole strip.

        Parameters
        ----------
        places : int
            Number of places, evenly spaced from end to end.
        samples : int
            Averaged at each place.

        Returns
        -------
        Presses
            At `FIRM_MN`.
        """
        return self.read(np.linspace(0, self.length_um, places), [FIRM_MN], samples)

    def pressed(self, samples: int = 8) -> Presses:
        """Press at a few places with forces from the least that gives light there up to full."""
        places_um = [share * self.length_um for share in FORCE_PLACES]
        forces_mN = np.geomspace(self._least_mN(max(places_um)), FULL_MN, FORCES)
        return self.read(places_um, forces_mN, samples)

    def _least_mN(self, place_um: float) -> float:
        # By halving: the least force under which every channel counts.
        low_mN, high_mN = 1.0, FULL_MN
        while high_mN > 1.02 * low_mN:
            middle_mN = (low_mN * high_mN) ** 0.5
            self.press(place_um, middle_mN)
            if self.reader.read(4).dark:
                low_mN = middle_mN
            else:
                high_mN = middle_mN
        return high_mN


@lru_cache(maxsize=8)
def calibrate(sensor: SensorFile) -> tuple[str, ...]:
    """Return the lines of a calibration of a simulated sensor, exposed as suits it.

    Raises
    ------
    SpotsError
        If the sensor's readings do not allow a calibration.
    """
    with Stage(sensor) as stage:
        stage.expose()
        along, pressed = stage.along(), stage.pressed()
        noise = Noise.of(along, pressed)
        return tuple(fit({0: along}, pressed, noise, stage.reader.conditions))
