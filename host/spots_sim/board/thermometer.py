"""The thermometer of a virtual board's processor: that of an RP2040, behind a 12-bit ADC."""

from __future__ import annotations

# RP2040 datasheet, section 4.9.5.
_VOLTS_AT_27_C = 0.706
_VOLTS_PER_K = -0.001721
_VOLTS_MAX, _COUNT_MAX = 3.3, 4095


def read_u16(bus) -> int:
    """Return what MicroPython's ``ADC.read_u16`` returns for the temperature sensor.

    The 12 bits of the ADC's count are the upper ones; the chip's strip has the temperature of the
    board.
    """
    celsius = bus.chip.temperature_C(bus.clock.now_us())
    volts = _VOLTS_AT_27_C + (celsius - 27) * _VOLTS_PER_K
    count = min(max(round(volts / _VOLTS_MAX * _COUNT_MAX), 0), _COUNT_MAX)
    return count << 4 | count >> 8
