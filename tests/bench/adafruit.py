"""Runs Adafruit's published driver, unmodified, on a simulated chip in simulated time."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from types import ModuleType

from spots.errors import RequirementError
from spots_sim.chip.bus import I2CBus
from spots_sim.chip.busio import I2C, simulated_time

# Simulated time before the first transfer. A board needs longer to start Python than the chip needs
# to wake up.
_BOOT_US = 10_000.0


def published() -> ModuleType:
    """Return the module ``adafruit_as7341``.

    Raises
    ------
    RequirementError
        If the module is not installed.
    """
    try:
        import adafruit_as7341
    except ImportError:
        raise RequirementError(
            "the benchmark needs Adafruit's driver: pip install adafruit-circuitpython-as7341"
        ) from None
    return adafruit_as7341


@contextlib.contextmanager
def driver_on(bus: I2CBus, driver: type | None = None) -> Iterator:
    """Yield an ``adafruit_as7341.AS7341`` on a simulated bus; the driver waits in simulated time.

    Parameters
    ----------
    bus : spots_sim.chip.bus.I2CBus
        Bus with the simulated chip.
    driver : type, optional
        Class derived from the published one, to use instead of the published one.
    """
    module = published()
    bus.clock.spend_us(_BOOT_US)
    with simulated_time(module, bus.clock):
        yield (driver or module.AS7341)(I2C(bus))
