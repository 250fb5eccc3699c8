"""CircuitPython's ``busio.I2C`` on a simulated bus, so that published drivers run unmodified.

Names, keywords and errors are those of CircuitPython's documentation. As in CircuitPython, a
transfer without the lock raises RuntimeError.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from types import ModuleType

from .bus import I2CBus, SimulationClock

# The 7-bit addresses that the I2C specification does not reserve.
_ADDRESSES = range(0x08, 0x78)


class I2C:
    """An I2C controller with the API of CircuitPython's ``busio.I2C``, on a simulated bus.

    OSError ENODEV if no chip acknowledges the address; RuntimeError if the bus is not locked.
    """

    def __init__(self, bus: I2CBus):
        self._bus = bus
        self._locked = False

    def try_lock(self) -> bool:
        """Lock the bus; return False if it is already locked."""
        if self._locked:
            return False
        self._locked = True
        return True

    def unlock(self) -> None:
        """Unlock the bus."""
        self._locked = False

    def scan(self) -> list[int]:
        """Return the 7-bit addresses at which a chip acknowledges."""
        return [address for address in _ADDRESSES if self._acknowledges(address)]

    def writeto(self, address: int, buffer, *, start: int = 0, end: int | None = None) -> None:
        self._need_lock()
        self._bus.write(address, bytes(buffer[start:end]))

    def readfrom_into(
        self, address: int, buffer, *, start: int = 0, end: int | None = None
    ) -> None:
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
        """Write bytes to a chip, then read bytes after a repeated START."""
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
    """Replace ``sleep`` and ``monotonic`` in a driver module with those of a simulated clock.

    Use this for drivers with ``from time import monotonic, sleep``; the module ``time`` is not
    changed. The original functions are restored at the end of the ``with`` block.
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
