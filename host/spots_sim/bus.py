"""An I2C bus with one chip on it: timing, acknowledgement, and what the transfers cost."""

from __future__ import annotations

import errno
import time
from dataclasses import dataclass, field
from typing import Protocol


class SimulationClock(Protocol):
    """What the simulation takes its time from."""

    def now_us(self) -> float:
        """Return the time since power-on."""

    def spend_us(self, duration_us: float) -> None:
        """Let a transfer or a sleep take its time."""

    def pause_us(self, duration_us: float) -> None:
        """Let time pass in which the board does nothing."""


@dataclass
class SimulatedClock:
    """A clock that moves only with transfers and sleeps."""

    time_us: float = 0.0

    def now_us(self) -> float:
        return self.time_us

    def spend_us(self, duration_us: float) -> None:
        self.time_us += duration_us

    pause_us = spend_us


class RealClock:
    """The host's monotonic clock; transfers take the time that they take."""

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
    """Transfers, bytes on the wire (addresses and registers included) and bus time."""

    transactions: int = 0
    wire_bytes: int = 0
    bus_us: float = 0.0


@dataclass
class I2CBus:
    """A controller's view of the wires: 9 clocks a byte, and START, STOP, repeated START."""

    chip: object
    clock: SimulationClock
    frequency_hz: int = 400_000
    ledger: BusCost = field(default_factory=BusCost)

    def write(self, address: int, data: bytes) -> None:
        """Send START, address, data, STOP.

        Parameters
        ----------
        address : int
            7 bits.
        data : bytes

        Raises
        ------
        OSError
            ENODEV, without an acknowledge.
        """
        self._address(address)
        self._spend(2, 1 + len(data))
        self.chip.advance(self.clock.now_us())
        self.chip.write(data)

    def write_read(self, address: int, data: bytes, size: int) -> bytes:
        """Send START, address, data, repeated START, address; read `size` bytes; STOP.

        Parameters
        ----------
        address : int
            Of the chip, 7 bits.
        data : bytes
            What is written.
        size : int
            Number of bytes to read.

        Returns
        -------
        bytes

        Raises
        ------
        OSError
            ENODEV, without an acknowledge.
        """
        self._address(address)
        bits, count = 3, 2 + len(data) + size
        # The chip is read as its first byte goes out, which is before the transfer ends.
        self.chip.advance(self.clock.now_us() + self._bits_us(bits + 9 * (2 + len(data))))
        self.chip.write(data)
        answer = self.chip.read(size)
        self._spend(bits, count)
        return answer

    def read(self, address: int, size: int) -> bytes:
        """Send START, address; read `size` bytes from the register pointer on; STOP.

        Parameters
        ----------
        address : int
            Of the chip, 7 bits.
        size : int
            Number of bytes to read.

        Returns
        -------
        bytes

        Raises
        ------
        OSError
            ENODEV, without an acknowledge.
        """
        self._address(address)
        self._spend(2, 1 + size)
        self.chip.advance(self.clock.now_us())
        return self.chip.read(size)

    def lines(self, scl: int, sda: int) -> int:
        """Release (1) or pull (0) the wires by hand, and return the level of SDA.

        The chip responds to transfers only and ignores it.

        Parameters
        ----------
        scl, sda : int
            Level that the controller sets: 1 to release, 0 to pull.

        Returns
        -------
        int
            Level of SDA, 0 or 1.
        """
        return sda

    def light(self, level: int) -> None:
        """Set the pin of the board that switches the strip's LED, where a pin does.

        Parameters
        ----------
        level : int
            1 for on, 0 for off.
        """
        self.chip.advance(self.clock.now_us())
        self.chip.switch_light(bool(level))

    def refuse(self) -> None:
        """Spend the bus time of an address without acknowledge, and raise OSError(ENODEV)."""
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
        self.clock.spend_us(duration_us)
