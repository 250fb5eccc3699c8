"""A channel of an I2C multiplexer TCA9548A in place of ``busio.I2C``, for Adafruit's driver."""

import busio

from .common import MULTIPLEXER

_buses = []  # a `_Bus` for each pair of pins


class _Bus:
    def __init__(self, scl, sda):
        self.scl = scl
        self.sda = sda
        self.i2c = None  # None until it is opened, and after `deinit`


class I2CChannel:
    """An I2C bus behind the multiplexer; `try_lock` selects its channel (0 to 7).

    All channels of a multiplexer share one ``busio.I2C``, because its pins can be opened only once.
    After a fault of one strip's sensor, its driver closes and opens the bus again; the drivers of
    the other strips then use the new ``busio.I2C``.
    """

    def __init__(self, channel):
        self._select = bytes((1 << channel,))
        self._bus = None

    def open(self, scl, sda, frequency):
        """Open the bus if no other channel has opened it, and return this channel.

        RuntimeError if the wires have no pull-ups, or a chip holds a wire low.
        """
        for bus in _buses:
            if bus.scl is scl and bus.sda is sda:
                break
        else:
            bus = _Bus(scl, sda)
            _buses.append(bus)
        if bus.i2c is None:
            bus.i2c = busio.I2C(scl, sda, frequency=frequency)
        self._bus = bus
        return self

    def deinit(self):
        """Close the bus for all channels, so that its pins can be used."""
        i2c, self._bus.i2c = self._bus.i2c, None
        if i2c is not None:
            i2c.deinit()

    def try_lock(self):
        """Lock the bus and select the channel; return False if the bus is locked.

        OSError if the multiplexer does not answer, or the bus is closed.
        """
        i2c = self._opened()
        if not i2c.try_lock():
            return False
        try:
            i2c.writeto(MULTIPLEXER, self._select)
        except OSError:
            i2c.unlock()
            raise
        return True

    def unlock(self):
        self._opened().unlock()

    def writeto(self, *arguments, **bounds):
        self._opened().writeto(*arguments, **bounds)

    def readfrom_into(self, *arguments, **bounds):
        self._opened().readfrom_into(*arguments, **bounds)

    def writeto_then_readfrom(self, *arguments, **bounds):
        self._opened().writeto_then_readfrom(*arguments, **bounds)

    def _opened(self):
        i2c = self._bus.i2c
        if i2c is None:
            raise OSError("the I2C bus is closed")
        return i2c
