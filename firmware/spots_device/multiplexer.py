"""A sensor behind an I2C multiplexer TCA9548A. Only boards with ``MUX_CHANNEL`` get this module."""

from micropython import const

_ADDRESS = const(0x70)  # I2C address; each bit of the chip's register switches a channel on


class ChannelBus:
    """A sensor's I2C bus behind the multiplexer; selects the channel before each transfer.

    Parameters
    ----------
    bus : object
        The bus of the board, see `as7341`; its ``write_to(address, buffer)`` writes to any chip.
    channel : int
        Channel of the sensor, 0 to 7.
    """

    def __init__(self, bus, channel):
        self.recover = bus.recover
        self._bus = bus
        self._channel = bytes((1 << channel,))

    def read_into(self, address, register, buffer):
        self._bus.write_to(_ADDRESS, self._channel)
        self._bus.read_into(address, register, buffer)

    def write(self, buffer):
        self._bus.write_to(_ADDRESS, self._channel)
        self._bus.write(buffer)
