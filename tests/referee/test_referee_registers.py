"""The firmware's driver and Adafruit's driver: each reads the register values of the other."""

from __future__ import annotations

import adafruit_as7341
import pytest
from bench.adafruit import driver_on
from support.witnesses import HIGH, LOW, silent_chip

from spots.link.board import Board
from spots_device.sensor.smux import smux_map
from spots_sim.board.lockstep import LockstepLink
from spots_sim.chip.bus import I2CBus, SimulatedClock
from spots_sim.chip.converter import DIODES, GAIN
from spots_sim.strip.scenario import Held
from spots_sim.strip.world import chip

ADDRESS = 0x39


class Onlooker(adafruit_as7341.AS7341):
    """Adafruit's driver without its set-up, on a chip that the firmware's driver has set up."""

    def initialize(self):
        pass


class Ammeter:
    """Simulated light: at gain 128x, the counts with the LED on equal the LED current in mA.

    Adafruit's driver starts with this gain.
    """

    def collect(self, start_us, end_us, led_mA):
        return dict.fromkeys(DIODES, led_mA / GAIN[8])


@pytest.fixture
def bus(sensor):
    return I2CBus(chip(sensor, Held(), seed=0), SimulatedClock())


def registers(bus, first, size=1):
    return bus.write_read(ADDRESS, bytes([first]), size)


def low_bank_register(bus, register):
    bus.write(ADDRESS, b"\xa9\x10")
    value = registers(bus, register)[0]
    bus.write(ADDRESS, b"\xa9\x00")
    return value


@pytest.mark.parametrize(("led_mA", "code"), [(4, 0), (20, 8), (100, 48), (258, 127)])
def test_the_chip_holds_the_led_current_that_the_referee_set(bus, led_mA, code):
    with driver_on(bus) as driver:
        driver.led_current = led_mA
        driver.led = True
        assert (driver.led_current, driver.led) == (led_mA, True)
        assert low_bank_register(bus, 0x74) == 0x80 | code
        driver.led = False
        assert low_bank_register(bus, 0x74) == code
        assert low_bank_register(bus, 0x70) & 0x08


@pytest.mark.parametrize("led_mA", [4, 20, 258])
def test_the_led_shines_with_the_current_that_the_referee_set(led_mA):
    bus = I2CBus(silent_chip(Ammeter()), SimulatedClock())
    with driver_on(bus) as driver:
        driver.atime, driver.astep, driver.led_current = 0, 3596, led_mA
        seen = []
        for driver.led in (True, False):
            seen += driver.all_channels
    assert seen == [led_mA] * 8 + [0] * 8


@pytest.mark.parametrize(("atime", "astep"), [(0, 999), (100, 999), (29, 0xABCD)])
@pytest.mark.parametrize("gain", range(11))
def test_the_chip_holds_the_exposure_that_the_referee_set(bus, atime, astep, gain):
    with driver_on(bus) as driver:
        driver.atime, driver.astep, driver.gain = atime, astep, gain
        assert (driver.atime, driver.astep, driver.gain) == (atime, astep, gain)
    assert registers(bus, 0x81) == bytes([atime])
    assert registers(bus, 0xCA, 2) == bytes([astep & 0xFF, astep >> 8])
    assert registers(bus, 0xAA) == bytes([gain])


@pytest.mark.parametrize(
    ("exposure_us", "atime", "astep"), [(2_780, 0, 999), (10_000, 0, 3596), (281_000, 1, 50_539)]
)
@pytest.mark.parametrize(("gain", "led_mA"), [(0, 4), (7, 20), (10, 100)])
def test_the_referee_reads_what_our_driver_wrote(sensor, exposure_us, atime, astep, gain, led_mA):
    link = LockstepLink(sensor, Held())
    with Board(link) as board:
        board.command(f"set exposure_us={exposure_us} gain={gain} led_mA={led_mA}")
        _let_the_dark_window_pass(board, exposure_us)
        with driver_on(link.bus, Onlooker) as onlooker:
            assert (onlooker.atime, onlooker.astep) == (atime, astep)
            assert onlooker.gain == gain
            assert onlooker.led_current == led_mA
            assert onlooker.led is True


def test_the_referee_sees_our_led_go_out(sensor):
    link = LockstepLink(sensor, Held())
    with Board(link) as board:
        board.command("set led_mA=0")
        with driver_on(link.bus, Onlooker) as onlooker:
            assert onlooker.led is False


@pytest.mark.parametrize(
    ("plan", "published"),
    [(LOW, Onlooker._f1f4_clear_nir), (HIGH, Onlooker._f5f8_clear_nir)],
    ids=["F1-F4", "F5-F8"],
)
def test_our_map_is_the_published_one_byte_for_byte(bus, sensor, plan, published):
    with driver_on(bus) as driver:
        published(driver)
    theirs = registers(bus, 0x00, 20)
    assert any(theirs)
    assert smux_map(plan) == theirs

    link = LockstepLink(sensor, Held())
    with Board(link) as board:
        board.command("set channels=" + ",".join(plan))
        assert registers(link.bus, 0x00, 20) == theirs


def _let_the_dark_window_pass(board, exposure_us):
    for _ in board.frames(0.1 + 12 * exposure_us * 1e-6):
        pass
