"""Measures the time of a reading on a 400 kHz I2C bus: this firmware, and Adafruit's driver.

Time is simulated: transfers, sleeps and the chip take time, the processor does not. A reading of
this firmware has six channels, measured at the same time. A reading of Adafruit's ``all_channels``
has eight channels, measured in two passes.

Adafruit's driver restarts the chip for each pass. The chip's documents do not define whether it
then repeats its auto-zero of 15 ms. In the sensor file, the chip repeats it. The ratio of rates is
also measured without a repeated auto-zero.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice

from msgspec import structs

from spots.errors import SpotsError
from spots.link.board import Board
from spots_device.sensor import exposure
from spots_sim.board.lockstep import LockstepLink
from spots_sim.chip.as7341 import AS7341
from spots_sim.chip.bus import BusCost, I2CBus, SimulatedClock
from spots_sim.strip.files import SensorFile
from spots_sim.strip.scenario import Held, Press
from spots_sim.strip.world import chip

from .adafruit import driver_on

EXPOSURES_US = (10_000, 2_780)
_PRESS = Press(position_mm=42.5, force_mN=3000.0, width_mm=4.0)
_GAIN_CODE = 9
_LED_MA = 20
# Enough readings for the poll schedule to settle, and for its rare early polls to average out, but
# less than the 10 s after which the firmware takes a dark frame.
_OUR_SETTLING = 300
_OUR_READINGS = 512
_LIMIT_S = 60.0  # timeout in simulated time
_THEIR_SETTLING = 3
_THEIR_READINGS = 50


@dataclass(frozen=True)
class _Moment:
    time_us: float
    integrating_us: float
    ledger: BusCost

    @classmethod
    def now(cls, bus: I2CBus) -> _Moment:
        return cls(bus.clock.now_us(), bus.chip.integrating_us, replace(bus.ledger))


def measure(sensor: SensorFile) -> dict:
    """Compare both drivers at each integration time in `EXPOSURES_US`.

    Returns
    -------
    dict
        ``integrations``: a dict for each integration time. It has ``integration_ms``; ``spots`` and
        ``adafruit``, the costs and the rate of readings with each driver; and the ratios of these
        rates, with the auto-zero of the chip repeated at each start and not repeated.
    """
    return {"integrations": [_compare(sensor, exposure_us) for exposure_us in EXPOSURES_US]}


def _compare(sensor: SensorFile, exposure_us: int) -> dict:
    converter = structs.replace(sensor.converter, auto_zero_at_every_start=False)
    zeroed_once = structs.replace(sensor, converter=converter)
    ours = _ours(sensor, exposure_us)
    theirs = _theirs(sensor, exposure_us)
    rates_once = [of(zeroed_once, exposure_us)["rate_Hz"] for of in (_ours, _theirs)]
    return {
        "integration_ms": exposure_us / 1000,
        "spots": ours,
        "adafruit": theirs,
        "rate_ratio": round(ours["rate_Hz"] / theirs["rate_Hz"], 2),
        "rate_ratio_if_auto_zero_once": round(rates_once[0] / rates_once[1], 2),
    }


def _ours(sensor: SensorFile, exposure_us: int) -> dict:
    link = LockstepLink(sensor, _held())
    with Board(link) as board:
        board.command(f"set exposure_us={exposure_us} gain={_GAIN_CODE} led_mA={_LED_MA}")
        touches = board.touches(_LIMIT_S)
        before = _after(touches, _OUR_SETTLING, link.bus)
        figures = _figures(
            link.bus, before, _after(touches, _OUR_READINGS, link.bus), _OUR_READINGS
        )
        figures["channels"] = len(board.info["channels"])
        figures["missed_samples"] = board.command("get")["missed"]
    return figures


def _theirs(sensor: SensorFile, exposure_us: int) -> dict:
    bus = I2CBus(_chip(sensor), SimulatedClock())
    with driver_on(bus) as driver:
        driver.atime, driver.astep = exposure.registers(exposure_us)
        driver.gain = _GAIN_CODE
        driver.led_current = _LED_MA
        driver.led = True
        readings = iter(lambda: driver.all_channels, None)
        before = _after(readings, _THEIR_SETTLING, bus)
        figures = _figures(bus, before, _after(readings, _THEIR_READINGS, bus), _THEIR_READINGS)
        figures["channels"] = len(driver.all_channels)
    return figures


def _held() -> Held:
    held = Held()
    held.press = _PRESS
    return held


def _chip(sensor: SensorFile) -> AS7341:
    return chip(sensor, _held(), seed=0)


def _after(readings: Iterator, count: int, bus: I2CBus) -> _Moment:
    if sum(1 for _ in islice(readings, count)) < count:
        raise SpotsError("the virtual board sends no more readings: check its firmware")
    return _Moment.now(bus)


def _figures(bus: I2CBus, before: _Moment, after: _Moment, readings: int) -> dict:
    elapsed_us = after.time_us - before.time_us
    spent, earlier = after.ledger, before.ledger
    figures = {
        "bus_kHz": bus.frequency_hz / 1000,
        "transactions_per_reading": (spent.transactions - earlier.transactions) / readings,
        "wire_bytes_per_reading": (spent.wire_bytes - earlier.wire_bytes) / readings,
        "bus_ms_per_reading": (spent.bus_us - earlier.bus_us) / 1000 / readings,
        "rate_Hz": readings / elapsed_us * 1e6,
        "integrating_fraction": (after.integrating_us - before.integrating_us) / elapsed_us,
    }
    # Both times are a few microseconds after the end of an integration, by different amounts. So
    # the fifth digit of a rate or a fraction is not significant.
    return {name: round(figure, 4) for name, figure in figures.items()}
