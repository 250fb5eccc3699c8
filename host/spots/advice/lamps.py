"""Finds the mains frequency of lamps from the flicker of the light that a board measures."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from spots_device.reading.decode import LED_OFF

from ..link.board import Board

# Exposures so short that no flicker of lamps averages out. A flicker of another frequency may look
# like 100 or 120 Hz at one of these sample rates (aliasing), but not at both.
_EXPOSURES_US = 2_780, 3_200
_SECONDS = 0.5  # at each exposure
_MAINS_HZ = 50, 60  # a lamp flickers at twice the mains frequency
# Deviations in Hz from 100 or 120 Hz at which flicker is searched: mains are within 1 %.
_OFF_HZ = np.linspace(-1, 1, 5)
# Least power of a flicker, relative to the noise. Noise alone exceeds this limit in one of 10^7
# measurements.
_LEAST = 20.0
_SAMPLES_MIN = 30  # with fewer samples, nothing is measured
_ROUNDING = 1 / 12  # variance of the rounding of a count


def mains_hz(board: Board) -> int:
    """Measure the mains frequency of the lamps around a strip; this takes about a second.

    It is 50 or 60; 0 if no flicker at 100 or 120 Hz is found. If the board can set the LED's
    current, the LED is off during the measurement. The settings of the board are restored at the
    end.
    """
    state: Mapping[str, Any] = board.command("get")
    changed = {"average": 1, "mains_hz": 0} | ({"led_mA": 0} if state["led"] == "ldr" else {})
    before: dict[str, int] = {name: state[name] for name in ("exposure_us", *changed)}
    try:
        found = [_strongest(*_light(board, us, changed)) for us in _EXPOSURES_US]
    finally:
        board.set(**before)
    return found[0] if found[0] == found[1] else 0


def _light(
    board: Board, exposure_us: int, settings: Mapping[str, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Measure the light around the strip; return the times of n samples in s, and their n values.

    A value is the sum of the counts of all channels. Time 0 is the first sample. The exposure and
    the `settings` are sent to the board first. If the settings contain ``led_mA`` (0, to switch the
    LED off), samples with the LED on are left out; otherwise, samples with the LED off.
    """
    board.set(exposure_us=exposure_us, **settings)
    begun_s = board.now_s() + 1e-6 * exposure_us
    dark = "led_mA" in settings
    spectra = [
        spectrum
        for spectrum in board.spectra(_SECONDS)
        if (spectrum.time_s or 0.0) >= begun_s and bool(spectrum.flags & LED_OFF) == dark
    ]
    passed_us = [(spectrum.t_us - spectra[0].t_us) % (1 << 32) for spectrum in spectra]
    return 1e-6 * np.array(passed_us), np.array([sum(spectrum.counts) for spectrum in spectra])


def _strongest(time_s: np.ndarray, light: np.ndarray) -> int:
    """Return the mains frequency in Hz of the lamp that flickers most; 0 if no lamp flickers."""
    if len(light) < _SAMPLES_MIN:
        return 0
    powers = {hz: max(_power(time_s, light, 2 * hz + off) for off in _OFF_HZ) for hz in _MAINS_HZ}
    strongest = max(powers, key=powers.__getitem__)
    return strongest if powers[strongest] > _LEAST else 0


def _power(time_s: np.ndarray, light: np.ndarray, hz: float) -> float:
    """Return the power of a sine of the frequency `hz` in the light, relative to the noise."""
    phase = 2 * np.pi * hz * time_s
    waves = np.stack([np.ones_like(time_s), time_s, np.cos(phase), np.sin(phase)], axis=1)
    with_sine, without = (
        light - part @ np.linalg.lstsq(part, light, rcond=None)[0] for part in (waves, waves[:, :2])
    )
    noise = max(with_sine @ with_sine / (len(light) - 4), _ROUNDING)
    return float((without @ without - with_sine @ with_sine) / 2 / noise)
