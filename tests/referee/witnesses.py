"""Two drivers on one simulated sensor: this firmware's, and Adafruit's unmodified driver."""

from __future__ import annotations

import numpy as np
from bench.adafruit import driver_on
from msgspec import structs

from spots.link.board import Board
from spots.link.frames import Spectrum
from spots_device import exposure
from spots_sim.bus import I2CBus, SimulatedClock
from spots_sim.chip import AS7341, DIODES, GAIN, ChipNoise, Quirks
from spots_sim.lockstep import LockstepLink
from spots_sim.scenario import Held
from spots_sim.world import chip

LOW = ("F1", "F2", "F3", "F4", "CLEAR", "NIR")
HIGH = ("F5", "F6", "F7", "F8", "CLEAR", "NIR")
LED_OFF = 1 << 7
SILENT = ChipNoise(read_counts=0.0, electrons_per_count_1x=1e30, dark_counts_512x=0.0)
GAIN_1X_OF_64 = 7  # the one gain that the datasheet's table gives as a round number
WRAP = 1 << 32
PATIENCE_S = 10.0  # of simulated time: for a dark window and some tens of samples


def varied(sensor, led=(), **converter):
    """Return a sensor file with some fields of its LED and its converter changed."""
    return structs.replace(
        sensor,
        led=structs.replace(sensor.led, **dict(led)),
        converter=structs.replace(sensor.converter, **converter),
    )


def steady(sensor):
    """Return a sensor whose LED has warmed up, so that it is the same at any two moments."""
    return varied(sensor, led={"warm_up_percent": 0.0})


def noiseless(sensor):
    """Return a sensor that gives the same counts every time."""
    return varied(
        steady(sensor),
        led={"noise_ppm_10ms": 0.0},
        read_noise_counts=0.0,
        electrons_per_count_1x=1e30,
    )


def our_counts(sensor, plan, exposure_us, gains, presses, samples, led_mA=100):
    """Return the counts that this firmware reads: {(gain, press): {diode: array of counts}}."""
    held = Held()
    readings = {}
    with Board(LockstepLink(sensor, held)) as board:
        board.command(f"set plan={','.join(plan)} exposure_us={exposure_us} led_mA={led_mA}")
        board.command("stream spectrum")
        for gain in gains:
            board.command(f"set gain={gain}")
            for press in presses:
                held.press = press
                counts = np.array(since_now(board, samples, exposure_us), dtype=float)
                readings[gain, press] = dict(zip(plan, counts.T))
    return readings


def since_now(board, samples, exposure_us):
    """Return the counts of the next lit samples whose integration has not begun yet."""
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
    """Return the counts that Adafruit's driver reads, as `our_counts`, for every named diode."""
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
    """Return a reading of all channels that have a name in Adafruit's driver."""
    reading = {f"F{i}": count for i, count in enumerate(driver.all_channels, 1)}
    return reading | {"CLEAR": driver.channel_clear, "NIR": driver.channel_nir}


class Labelled:
    """A light that gives each diode its own count at gain 64x, independent of LED and exposure.

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


class Numbered:
    """A light that gives every sample its own count at gain 64x: 1, 2, ... and around."""

    around = 900

    def __init__(self):
        self._samples = 0

    def collect(self, start_us, end_us, led_mA):
        number = self._samples % self.around + 1
        self._samples += 1
        return dict.fromkeys(DIODES, number / GAIN[GAIN_1X_OF_64])


def silent_chip(light, quirks=None):
    """Return a chip without noise in front of a light."""
    return AS7341(light, SILENT, np.random.default_rng(0), quirks or Quirks())


def board_with(sensor, a_chip):
    """Return (Board, LockstepLink) whose firmware finds `a_chip` on its bus from power-on."""
    link = LockstepLink(sensor, Held())
    link.bus.chip = link.chip = a_chip
    return Board(link), link
