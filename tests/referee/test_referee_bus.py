"""The simulated `busio.I2C` raises the same errors as that of the real CircuitPython."""

from __future__ import annotations

import errno
import types

import pytest
from support.refusals import refusal

from spots_sim.chip.bus import I2CBus, SimulatedClock
from spots_sim.chip.busio import I2C, simulated_time
from spots_sim.strip.scenario import Held
from spots_sim.strip.world import chip


@pytest.fixture
def bus(sensor):
    return I2CBus(chip(sensor, Held(), seed=0), SimulatedClock(time_us=1000.0))


@pytest.fixture
def locked(bus):
    i2c = I2C(bus)
    assert i2c.try_lock()
    return i2c


def test_the_lock_has_one_holder(bus):
    i2c = I2C(bus)
    assert i2c.try_lock()
    assert not i2c.try_lock()
    i2c.unlock()
    assert i2c.try_lock()


@pytest.mark.parametrize(
    "transfer",
    [
        lambda i2c: i2c.scan(),
        lambda i2c: i2c.writeto(0x39, b"\x92"),
        lambda i2c: i2c.readfrom_into(0x39, bytearray(1)),
        lambda i2c: i2c.writeto_then_readfrom(0x39, b"\x92", bytearray(1)),
    ],
    ids=["scan", "write", "read", "write then read"],
)
def test_no_transfer_without_the_lock(bus, transfer):
    with refusal(RuntimeError):
        transfer(I2C(bus))
    assert bus.ledger.transactions == 0


def test_only_the_chip_answers(locked):
    assert locked.scan() == [0x39]


def test_no_acknowledge_is_an_os_error(locked):
    with refusal(OSError, errno=errno.ENODEV):
        locked.writeto(0x40, b"")


def test_bounds_choose_the_part_of_a_buffer_that_is_used(locked):
    answer = bytearray(b"....")
    locked.writeto_then_readfrom(
        0x39, b"..\x92.", answer, out_start=2, out_end=3, in_start=1, in_end=2
    )
    assert answer == b".\x24.."
    locked.writeto(0x39, b"..\xca..", start=2, end=3)
    locked.readfrom_into(0x39, answer, start=2, end=4)
    assert answer == b".\x24\xe7\x03"


def test_a_register_read_is_one_transaction_of_its_length(bus, locked):
    locked.writeto_then_readfrom(0x39, b"\x92", bytearray(1))
    assert (bus.ledger.transactions, bus.ledger.wire_bytes) == (1, 4)
    assert bus.ledger.bus_us == pytest.approx((3 + 9 * 4) / 0.4)
    assert bus.clock.now_us() == pytest.approx(1000 + bus.ledger.bus_us)


def test_a_driver_sleeps_on_the_simulated_clock_and_gets_its_own_names_back():
    driver = types.ModuleType("driver")
    driver.sleep, driver.monotonic = own = object(), object()
    clock = SimulatedClock()

    def sleep_and_fail():
        with simulated_time(driver, clock):
            driver.sleep(0.25)
            assert driver.monotonic() == pytest.approx(0.25)
            raise LookupError

    with pytest.raises(LookupError):
        sleep_and_fail()
    assert clock.now_us() == pytest.approx(250_000)
    assert (driver.sleep, driver.monotonic) == own
