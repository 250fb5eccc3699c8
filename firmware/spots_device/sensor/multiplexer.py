"""A sensor behind an I2C multiplexer TCA9548A.

Only boards with ``MUX_CHANNEL`` in their configuration get this module.
"""

from errno import EIO

from ..runtime.common import MULTIPLEXER


def connect(sensor, channel):
    """Connect a sensor, which is not started yet, through a channel (0 to 7) of the multiplexer."""
    if sensor.bus is None:  # CircuitPython: the sensor opens its bus later, at its start
        from ..runtime.multiplexer_circuitpython import I2CChannel

        sensor.open_i2c = I2CChannel(channel).open
    else:
        sensor.bus = ChannelBus(sensor.bus, channel)


class ChannelBus:
    """A sensor's I2C bus behind the multiplexer; selects the channel before each transfer.

    The board's ``write_to(address, buffer) -> int`` writes to any chip, and returns the number of
    acknowledged bytes.
    """

    def __init__(self, bus, channel):
        self.recover = bus.recover
        self._bus = bus
        self._channel = bytes((1 << channel,))

    def read_into(self, address, register, buffer):
        if self._bus.write_to(MULTIPLEXER, self._channel) != 1:
            raise OSError(EIO)
        self._bus.read_into(address, register, buffer)

    def write(self, buffer):
        if self._bus.write_to(MULTIPLEXER, self._channel) != 1:
            raise OSError(EIO)
        self._bus.write(buffer)
