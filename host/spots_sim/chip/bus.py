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

    `idle_us` is the part of the time in which the board slept.
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
    """Cost of the transfers on a bus; `wire_bytes` includes the addresses of chip and register."""

    transactions: int = 0
    wire_bytes: int = 0
    bus_us: float = 0.0


MULTIPLEXER = 0x70  # address of a TCA9548A whose address pins are low


@dataclass
class I2CBus:
    """A simulated I2C controller. A byte takes 9 clocks; START, STOP and repeated START take 1.

    Each transfer advances the clock. `call_us` is the processor time of a transfer in addition to
    the time of its bits on the wire. An address has 7 bits; OSError ENODEV if no chip acknowledges
    it.
    """

    chip: object
    clock: SimulationClock
    frequency_hz: int = 400_000
    ledger: BusCost = field(default_factory=BusCost)
    call_us: float = 0.0

    def write(self, address: int, data: bytes) -> None:
        """START, address, data, STOP."""
        self._address(address)
        self._spend(2, 1 + len(data))
        self.chip.advance(self.clock.now_us())
        self.chip.write(data)

    def write_read(self, address: int, data: bytes, size: int) -> bytes:
        """Write bytes to a chip, then read `size` bytes after a repeated START."""
        self._address(address)
        bits, count = 3, 2 + len(data) + size
        # The chip is read when its first byte is sent, before the transfer ends.
        self.chip.advance(self.clock.now_us() + self._bits_us(bits + 9 * (2 + len(data))))
        self.chip.write(data)
        answer = self.chip.read(size, self._bits_us(9))
        self._spend(bits, count)
        return answer

    def read(self, address: int, size: int) -> bytes:
        """Read `size` bytes from a chip, from its present register pointer on."""
        self._address(address)
        self._spend(2, 1 + size)
        self.chip.advance(self.clock.now_us())
        return self.chip.read(size)

    def lines(self, scl: int, sda: int) -> int:
        """Set SCL and SDA outside a transfer (1 releases, 0 pulls low); return the level of SDA.

        The firmware does this to free a bus whose SDA is held low. This chip never holds SDA low,
        so it ignores the levels.
        """
        return sda

    def light(self, level: int) -> None:
        """Set the board's pin that switches the strip's LED, if the LED is wired to a pin."""
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
    `chips` begins with the chip of channel 0.
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
