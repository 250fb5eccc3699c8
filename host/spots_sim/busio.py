"""CircuitPython's ``busio.I2C`` over a simulated bus, so that published drivers run unmodified.

Names, keywords and errors are those of CircuitPython's documentation. A transfer without the lock
is refused here as it is there, since a driver that forgets it would fail on a board only.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from types import ModuleType

from .bus import I2CBus, SimulationClock

# The seven-bit addresses that the I2C specification does not reserve.
_ADDRESSES = range(0x08, 0x78)


class I2C:
    """An I2C controller as CircuitPython's drivers know it.

    Parameters
    ----------
    bus : bus.I2CBus
        Whose clock and ledger every transfer is entered in.
    """

    def __init__(self, bus: I2CBus):
        self._bus = bus
        self._locked = False

    def try_lock(self) -> bool:
        """Take the bus; False if it is taken."""
        if self._locked:
            return False
        self._locked = True
        return True

    def unlock(self) -> None:
        """Let the bus go."""
        self._locked = False

    def scan(self) -> list[int]:
        """Return the addresses that acknowledge."""
        return [address for address in _ADDRESSES if self._acknowledges(address)]

    def writeto(self, address: int, buffer, *, start: int = 0, end: int | None = None) -> None:
        """Write ``buffer[start:end]``.

        Parameters
        ----------
        address : int
            Of the chip, 7 bits.
        buffer : bytes-like
            What is written.
        start, end : int, optional
            Range of the buffer; all of it, if not given.

        Raises
        ------
        OSError
            ENODEV, without an acknowledge.
        RuntimeError
            Without the lock, see `try_lock`.
        """
        self._need_lock()
        self._bus.write(address, bytes(buffer[start:end]))

    def readfrom_into(
        self, address: int, buffer, *, start: int = 0, end: int | None = None
    ) -> None:
        """Fill ``buffer[start:end]``.

        Parameters
        ----------
        address : int
            Of the chip, 7 bits.
        buffer : bytearray or memoryview
            What is filled.
        start, end : int, optional
            Range of the buffer; all of it, if not given.

        Raises
        ------
        OSError
            ENODEV, without an acknowledge.
        RuntimeError
            Without the lock, see `try_lock`.
        """
        self._need_lock()
        target = memoryview(buffer)[start:end]
        target[:] = self._bus.read(address, len(target))

    def writeto_then_readfrom(
        self,
        address: int,
        out_buffer,
        in_buffer,
        *,
        out_start: int = 0,
        out_end: int | None = None,
        in_start: int = 0,
        in_end: int | None = None,
    ) -> None:
        """Write, then read after a repeated START.

        Parameters
        ----------
        address : int
            Of the chip, 7 bits.
        out_buffer : bytes-like
            What is written.
        in_buffer : bytearray or memoryview
            What is filled.
        out_start, out_end : int, optional
            Range of `out_buffer`; all of it, if not given.
        in_start, in_end : int, optional
            Range of `in_buffer`; all of it, if not given.

        Raises
        ------
        OSError
            ENODEV, without an acknowledge.
        RuntimeError
            Without the lock, see `try_lock`.
        """
        self._need_lock()
        target = memoryview(in_buffer)[in_start:in_end]
        sent = bytes(out_buffer[out_start:out_end])
        target[:] = self._bus.write_read(address, sent, len(target))

    def _acknowledges(self, address: int) -> bool:
        try:
            self.writeto(address, b"")
        except OSError:
            return False
        return True

    def _need_lock(self) -> None:
        if not self._locked:
            raise RuntimeError("Function requires lock")


@contextlib.contextmanager
def simulated_time(driver: ModuleType, clock: SimulationClock) -> Iterator[None]:
    """Let a driver that did ``from time import monotonic, sleep`` live by a simulated clock.

    Its own names are replaced, not those of ``time``, and put back at the end.

    Parameters
    ----------
    driver : module
        Where the names were imported to.
    clock : bus.SimulationClock
        Spent by ``sleep(seconds)``, read by ``monotonic()``.

    Yields
    ------
    None
    """
    replaced = {
        "sleep": lambda seconds: clock.spend_us(seconds * 1e6),
        "monotonic": lambda: clock.now_us() * 1e-6,
    }
    own = {name: getattr(driver, name) for name in replaced}
    try:
        for name, function in replaced.items():
            setattr(driver, name, function)
        yield
    finally:
        for name, function in own.items():
            setattr(driver, name, function)
