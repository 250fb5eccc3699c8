"""A simulated I2C bus: acknowledgement, timing and number of its transfers."""

from __future__ import annotations

import errno
import time
from dataclasses import dataclass, field
from typing import Protocol


class SimulationClock(Protocol):
    """Interface of a simulation's clock, which counts simulated time or real time."""

    def now_us(self) -> float:
        """Return the time since power-on, in us."""

    def spend_us(self, duration_us: float) -> None:
        """Advance a simulated clock while the board is busy; a real clock ignores this."""

    def pause_us(self, duration_us: float) -> None:
        """Let `duration_us` microseconds pass, in which the board does nothing."""


@dataclass
class SimulatedClock:
    """A clock that advances only by transfers, sleeps and processor time.

    Attributes
    ----------
    time_us : float
        Present time in us.
    idle_us : float
        Part of the time in which the board slept, in us.
    """

    time_us: float = 0.0
    idle_us: float = 0.0

    def now_us(self) -> float:
        return self.time_us

    def spend_us(self, duration_us: float) -> None:
        self.time_us += duration_us

    def pause_us(self, duration_us: float) -> None:
        self.time_us += duration_us
        self.idle_us += duration_us


class RealClock:
    """The host's monotonic clock; the calculated duration of a transfer is ignored."""

    def __init__(self):
        self.started_s = time.monotonic()

    def now_us(self) -> float:
        return (time.monotonic() - self.started_s) * 1e6

    def spend_us(self, duration_us: float) -> None:
        pass

    def pause_us(self, duration_us: float) -> None:
        time.sleep(duration_us * 1e-6)


@dataclass
class BusCost:
    """Cost of the transfers on a bus.

    Attributes
    ----------
    transactions : int
        Number of transfers.
    wire_bytes : int
        Bytes on the wire, including addresses of chip and register.
    bus_us : float
        Duration of all transfers in us.
    """

    transactions: int = 0
    wire_bytes: int = 0
    bus_us: float = 0.0


MULTIPLEXER = 0x70  # address of a TCA9548A whose address pins are low


@dataclass
class I2CBus:
    """A simulated I2C controller. A byte takes 9 clocks; START, STOP and repeated START take 1.

    Attributes
    ----------
    chip : chip.AS7341
        The chip on the bus.
    clock : SimulationClock
        Clock that each transfer advances.
    frequency_hz : int
        Frequency of the bus in Hz.
    ledger : BusCost
        Cost of all transfers since the start.
    call_us : float
        Processor time of each transfer in us, in addition to the time of its bits on the wire.
    """

    chip: object
    clock: SimulationClock
    frequency_hz: int = 400_000
    ledger: BusCost = field(default_factory=BusCost)
    call_us: float = 0.0

    def write(self, address: int, data: bytes) -> None:
        """Write bytes to a chip: START, address, data, STOP.

        Parameters
        ----------
        address : int
            Address of the chip, 7 bits.
        data : bytes
            Bytes to write.

        Raises
        ------
        OSError
            ENODEV if no chip acknowledges the address.
        """
        self._address(address)
        self._spend(2, 1 + len(data))
        self.chip.advance(self.clock.now_us())
        self.chip.write(data)

    def write_read(self, address: int, data: bytes, size: int) -> bytes:
        """Write bytes to a chip, then read `size` bytes after a repeated START.

        Parameters
        ----------
        address : int
            Address of the chip, 7 bits.
        data : bytes
            Bytes to write.
        size : int
            Number of bytes to read.

        Returns
        -------
        bytes
            The bytes that were read.

        Raises
        ------
        OSError
            ENODEV if no chip acknowledges the address.
        """
        self._address(address)
        bits, count = 3, 2 + len(data) + size
        # The chip is read when its first byte is sent, before the transfer ends.
        self.chip.advance(self.clock.now_us() + self._bits_us(bits + 9 * (2 + len(data))))
        self.chip.write(data)
        answer = self.chip.read(size, self._bits_us(9))
        self._spend(bits, count)
        return answer

    def read(self, address: int, size: int) -> bytes:
        """Read `size` bytes from a chip, from its present register pointer on.

        Parameters
        ----------
        address : int
            Address of the chip, 7 bits.
        size : int
            Number of bytes to read.

        Returns
        -------
        bytes
            The bytes that were read.

        Raises
        ------
        OSError
            ENODEV if no chip acknowledges the address.
        """
        self._address(address)
        self._spend(2, 1 + size)
        self.chip.advance(self.clock.now_us())
        return self.chip.read(size)

    def lines(self, scl: int, sda: int) -> int:
        """Set the levels of SCL and SDA outside a transfer; return the level of SDA.

        The firmware does this to free a bus whose SDA is held low. This chip never holds SDA low,
        so it ignores the levels.

        Parameters
        ----------
        scl, sda : int
            1 releases the wire, 0 pulls it low.

        Returns
        -------
        int
            Level of SDA, 0 or 1.
        """
        return sda

    def light(self, level: int) -> None:
        """Set the board's pin that switches the strip's LED, if the LED is wired to a pin.

        Parameters
        ----------
        level : int
            1 for on, 0 for off.
        """
        self.chip.advance(self.clock.now_us())
        self.chip.switch_light(bool(level))

    def refuse(self) -> None:
        """Simulate a transfer to an address that no chip acknowledges: raise OSError(ENODEV)."""
        self._spend(2, 1)
        raise OSError(errno.ENODEV, "no acknowledge")

    def _address(self, address: int) -> None:
        self.ledger.transactions += 1
        self.chip.advance(self.clock.now_us())
        if address != self.chip.address or not self.chip.answers():
            self.refuse()

    def _bits_us(self, bits: int) -> float:
        return bits * 1e6 / self.frequency_hz

    def _spend(self, bits: int, count: int) -> None:
        duration_us = self._bits_us(bits + 9 * count)
        self.ledger.wire_bytes += count
        self.ledger.bus_us += duration_us
        self.clock.spend_us(duration_us + self.call_us)


class MultiplexedBus(I2CBus):
    """An `I2CBus` with a multiplexer TCA9548A, which connects the chip of one channel at a time.

    The multiplexer's only register has one bit for each channel. All bits are 0 after power-on.

    Parameters
    ----------
    chips : sequence of chip.AS7341
        Chip of each channel, from channel 0 on.
    clock : SimulationClock
        Clock that each transfer advances.
    """

    def __init__(self, chips, clock: SimulationClock):
        super().__init__(chips[0], clock)
        self._chips = tuple(chips)
        self._connected = 0

    def write(self, address: int, data: bytes) -> None:
        if address == MULTIPLEXER:
            self._spend(2, 1 + len(data))
            self._connected = data[-1]
            if self._connected & self._connected - 1 == 0 < self._connected:
                self.chip = self._chips[self._connected.bit_length() - 1]
        else:
            super().write(address, data)

    def _address(self, address: int) -> None:
        if self._connected & self._connected - 1 or not self._connected:
            self.refuse()  # no chip is connected, or several chips with the same address
        super()._address(address)
