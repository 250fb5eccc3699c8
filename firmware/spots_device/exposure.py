"""Exposure, gain and LED current: what the registers can do.

Source: DS000504, sections 10.2.2 (ATIME, ASTEP), 10.2.6 (gain) and 10.2.4 (LED). Below 182 ms
full scale grows with the exposure as the counts do, so the exposure does not change how full the
converter is: gain and LED current do.
"""

from micropython import const

MIN_US = 1_000
MAX_US = 1_000_000
DEFAULT_US = 10_000
GAIN_MAX = 10
DEFAULT_GAIN = 9
LED_MIN_MA = 4
LED_MAX_MA = 258
DEFAULT_LED_MA = 20

DONE, AGAIN, TOO_DARK, TOO_BRIGHT = range(4)  # outcomes of a search for a good setting

_STEP_CENTI_US = 278  # one step of integration is 2.78 us
_HALF_PERIOD = const(500_000)  # of the mains, in us times Hz
_ASTEP_MAX = 65_534  # 65535 is reserved


def registers(exposure_us):
    """Return (ATIME, ASTEP) of the nearest exposure with the shortest ATIME."""
    hundredths = exposure_us * 100
    longest = _STEP_CENTI_US * (_ASTEP_MAX + 1)
    cycles = (hundredths - 50 + longest - 1) // longest  # what was rounded up is what it was
    step = _STEP_CENTI_US * cycles
    return cycles - 1, (hundredths + step // 2) // step - 1


def actual_us(atime, astep):
    """Return the integration time in us, rounded."""
    return ((atime + 1) * (astep + 1) * _STEP_CENTI_US + 50) // 100


def choose(exposure_us, mains_hz):
    """Return the nearest exposure that can be set.

    Parameters
    ----------
    exposure_us : int
    mains_hz : int
        50 or 60: the exposure becomes a whole number of half mains periods, in which lamps give
        the same light each time. 0: what the chip has.
    """
    if not mains_hz:
        return actual_us(*registers(exposure_us))
    halves = max(1, (exposure_us * mains_hz + _HALF_PERIOD // 2) // _HALF_PERIOD)
    return (halves * _HALF_PERIOD + mains_hz // 2) // mains_hz


def full_scale(atime, astep):
    """Return the largest count."""
    return min(65_535, (atime + 1) * (astep + 1))


def led_code(led_mA):
    """Return the current field of register LED: 4 + 2 n mA. The field has no zero."""
    return max(0, led_mA - LED_MIN_MA) >> 1


def actual_mA(led_mA):
    """Return the current that the driver makes of `led_mA`; 0 is off."""
    return LED_MIN_MA + 2 * led_code(led_mA) if led_mA else 0
