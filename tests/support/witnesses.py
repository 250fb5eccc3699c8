"""Runs two drivers on one simulated sensor: the firmware's, and Adafruit's unmodified driver."""

from __future__ import annotations

import numpy as np
from bench.adafruit import driver_on
from msgspec import structs

from spots.link.board import Board
from spots.link.frames import Spectrum
from spots_device.sensor import exposure
from spots_sim.board.lockstep import LockstepLink
from spots_sim.chip.as7341 import AS7341
from spots_sim.chip.bus import I2CBus, SimulatedClock
from spots_sim.chip.converter import DIODES, GAIN, ChipNoise
from spots_sim.chip.quirks import Quirks
from spots_sim.strip.scenario import Held
from spots_sim.strip.world import chip

LOW = ("F1", "F2", "F3", "F4", "CLEAR", "NIR")
HIGH = ("F5", "F6", "F7", "F8", "CLEAR", "NIR")
LED_OFF = 1 << 7
SILENT = ChipNoise(read_counts=0.0, electrons_per_count_1x=1e30, dark_counts_512x=0.0)
GAIN_1X_OF_64 = 7  # register code of 64x, the only gain that is exact in the datasheet's table
WRAP = 1 << 32
PATIENCE_S = 10.0  # timeout in simulated time; enough for a dark window and some tens of samples


def varied(sensor, led=(), **converter):
    """Return a copy of a sensor file with changed fields of its LED (dict) and its converter."""
    return structs.replace(
        sensor,
        led=structs.replace(sensor.led, **dict(led)),
        converter=structs.replace(sensor.converter, **converter),
    )


def steady(sensor):
    """Return a copy of a sensor file without warm-up of the LED, so that its light is constant."""
    return varied(sensor, led={"warm_up_percent": 0.0})


def noiseless(sensor):
    """Return a copy of a sensor file without noise, so that a press always has the same counts."""
    return varied(
        steady(sensor),
        led={"noise_ppm_10ms": 0.0},
        read_noise_counts=0.0,
        electrons_per_count_1x=1e30,
    )


def our_counts(sensor, plan, exposure_us, gains, presses, samples, led_mA=100):
    """Return the counts that the firmware reads, with each gain and press.

    Parameters
    ----------
    sensor : SensorFile
        The simulated sensor.
    plan : sequence of str
        Names of six diodes.
    exposure_us : int
        Exposure in us.
    gains : sequence of int
        Register codes of the gain.
    presses : sequence of Press
        Presses on the strip.
    samples : int
        Number of samples for each gain and press.
    led_mA : int
        LED current in mA.

    Returns
    -------
    dict
        (gain, press) to a dict: name of the diode to an array of `samples` counts.
    """
    held = Held()
    readings = {}
    with Board(LockstepLink(sensor, held)) as board:
        board.command(f"set channels={','.join(plan)} exposure_us={exposure_us} led_mA={led_mA}")
        board.command("stream spectrum")
        for gain in gains:
            board.command(f"set gain={gain}")
            for press in presses:
                held.press = press
                counts = np.array(since_now(board, samples, exposure_us), dtype=float)
                readings[gain, press] = dict(zip(plan, counts.T))
    return readings


def since_now(board, samples, exposure_us):
    """Return the counts of `samples` samples with the LED on that begin after this call."""
    now_us = board.command("sync")["t_us"]
    counts = []
    for frame in board.frames(PATIENCE_S):
        age_us = (frame.t_us - now_us) % WRAP
        whole = exposure_us <= age_us < WRAP // 2
        if isinstance(frame, Spectrum) and whole and not frame.flags & LED_OFF:
            counts.append(frame.counts)
            if len(counts) == samples:
                return counts
    raise AssertionError(f"only {len(counts)} samples of {samples}: {list(board.log)}")


def their_counts(sensor, exposure_us, gains, presses, samples, led_mA=100):
    """Return the counts that Adafruit's driver reads, for all diodes that it names.

    Parameters and result are those of `our_counts`, without the plan.
    """
    held = Held()
    bus = I2CBus(chip(sensor, held, seed=1), SimulatedClock())
    readings = {}
    with driver_on(bus) as driver:
        driver.atime, driver.astep = exposure.registers(exposure_us)
        driver.led_current = led_mA
        driver.led = True
        for gain in gains:
            driver.gain = gain
            for press in presses:
                held.press = press
                rows = [named_channels(driver) for _ in range(samples)]
                readings[gain, press] = {d: np.array([row[d] for row in rows]) for d in rows[0]}
    return readings


def named_channels(driver):
    """Return a reading of all named channels of Adafruit's driver, as a dict by name."""
    reading = {f"F{i}": count for i, count in enumerate(driver.all_channels, 1)}
    return reading | {"CLEAR": driver.channel_clear, "NIR": driver.channel_nir}


class Labelled:
    """Simulated light: each diode has its own count at gain 64x, independent of LED and exposure.

    Parameters
    ----------
    integration_us : float
        Exposure of the counts in us.
    """

    labels = {diode: 100 * (i + 1) for i, diode in enumerate(DIODES)}

    def __init__(self, integration_us):
        self._integration_us = integration_us

    def collect(self, start_us, end_us, led_mA):
        share = (end_us - start_us) / self._integration_us / GAIN[GAIN_1X_OF_64]
        return {diode: label * share for diode, label in self.labels.items()}

    def temperature_C(self, now_us):
        return 25.0


class Numbered:
    """Simulated light: sample n has n counts at gain 64x; the counts repeat after a while."""

    around = 900

    def __init__(self):
        self._samples = 0

    def collect(self, start_us, end_us, led_mA):
        number = self._samples % self.around + 1
        self._samples += 1
        return dict.fromkeys(DIODES, number / GAIN[GAIN_1X_OF_64])

    def temperature_C(self, now_us):
        return 25.0


def silent_chip(light, quirks=None):
    """Return a simulated chip without noise that measures `light`."""
    return AS7341(light, SILENT, np.random.default_rng(0), quirks or Quirks())


def board_with(sensor, a_chip):
    """Return (Board, LockstepLink) of a virtual board that has the chip `a_chip` on its bus."""
    link = LockstepLink(sensor, Held())
    link.bus.chip = link.chip = a_chip
    return Board(link), link
