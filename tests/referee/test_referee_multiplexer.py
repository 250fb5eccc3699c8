"""A channel of the multiplexer TCA9548A: the same bytes on the bus as with Adafruit's library."""

from __future__ import annotations

import importlib
import sys
import types

import pytest
from adafruit_bus_device.i2c_device import I2CDevice
from adafruit_tca9548a import TCA9548A
from support.refusals import refusal

SENSOR = 0x39


class Recorder:
    """Substitute for ``busio.I2C`` that records all transfers."""

    def __init__(self, *pins, frequency=None):
        self.transfers = []
        self.locked = self.refuses = False

    def try_lock(self):
        self.locked = not self.locked
        return self.locked

    def unlock(self):
        self.locked = False

    def deinit(self):
        self.transfers.append("deinit")

    def writeto(self, address, data, *, start=0, end=None):
        assert self.locked
        if self.refuses:
            raise OSError("no acknowledge")
        self.transfers.append((address, bytes(data[start:end])))

    def readfrom_into(self, address, buffer, *, start=0, end=None):
        assert self.locked
        self.transfers.append((address, len(buffer[start:end])))

    def writeto_then_readfrom(self, address, out, into, *, out_start=0, out_end=None, **_):
        assert self.locked
        self.transfers.append((address, bytes(out[out_start:out_end]), len(into)))


@pytest.fixture
def ours(monkeypatch):
    """The firmware's module `multiplexer_circuitpython`, with the substitute for busio."""
    busio = types.ModuleType("busio")
    busio.I2C = Recorder
    monkeypatch.setitem(sys.modules, "busio", busio)
    name = "spots_device.runtime.multiplexer_circuitpython"
    monkeypatch.delitem(sys.modules, name, raising=False)
    yield importlib.import_module(name)
    sys.modules.pop(name, None)


def use(channels):
    for channel in channels:
        device = I2CDevice(channel, SENSOR)
        with device:
            device.write(b"\x80\x01")
        with device:
            device.write_then_readinto(b"\xfd", bytearray(1))
        with device:
            device.readinto(bytearray(12))


@pytest.mark.parametrize("numbers", [(0, 1), (7, 3)])
def test_the_channels_send_the_bytes_of_adafruits_library(ours, numbers):
    theirs = Recorder()
    multiplexer = TCA9548A(theirs)
    use([multiplexer[number] for number in numbers])
    channels = [ours.I2CChannel(number).open("SCL", "SDA", 400_000) for number in numbers]
    use(channels)
    (bus,) = ours._buses
    # Adafruit's library also switches all channels off after each transfer, which takes 50 us.
    expected = [one for one in theirs.transfers if one != (0x70, b"\x00")]
    assert bus.i2c.transfers == expected
    assert (0x70, bytes((1 << numbers[0],))) in expected
    assert not bus.i2c.locked


def test_a_multiplexer_that_does_not_answer_leaves_the_bus_unlocked(ours):
    channel = ours.I2CChannel(2).open("SCL", "SDA", 400_000)
    (bus,) = ours._buses
    bus.i2c.refuses = True
    with refusal(OSError):
        channel.try_lock()
    assert not bus.i2c.locked


def test_a_bus_that_one_strip_closed_and_opened_is_the_bus_of_all(ours):
    first, second = [ours.I2CChannel(number).open("SCL", "SDA", 400_000) for number in (0, 1)]
    (bus,) = ours._buses
    before = bus.i2c
    first.deinit()
    with pytest.raises(OSError, match="closed"):
        second.try_lock()
    second.deinit()
    first.open("SCL", "SDA", 400_000)
    assert bus.i2c is not before
    assert before.transfers == ["deinit"]
    assert second.try_lock()
    assert bus.i2c.transfers == [(0x70, b"\x02")]
