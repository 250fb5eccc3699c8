"""Exposure, gain and LED current: ranges and register values.

Source: DS000504, sections 10.2.2 (ATIME, ASTEP), 10.2.6 (gain) and 10.2.4 (LED). Below 182 ms,
counts and full scale are both proportional to the exposure. So a shorter exposure does not prevent
saturation below 182 ms; a lower gain or a lower LED current does.
"""

from .. import const

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
_HALF_PERIOD = const(500_000)  # half a mains period in us, times the frequency in Hz
_ASTEP_MAX = 65_534  # 65535 is reserved


def registers(exposure_us):
    """Return (ATIME, ASTEP), with the smallest ATIME, for the exposure nearest to `exposure_us`."""
    hundredths = exposure_us * 100
    longest = _STEP_CENTI_US * (_ASTEP_MAX + 1)
    # -50: an exposure that was rounded up keeps its ATIME.
    cycles = (hundredths - 50 + longest - 1) // longest
    step = _STEP_CENTI_US * cycles
    return cycles - 1, (hundredths + step // 2) // step - 1


def actual_us(atime, astep):
    """Return the integration time in us, rounded, for values of the registers ATIME and ASTEP."""
    return ((atime + 1) * (astep + 1) * _STEP_CENTI_US + 50) // 100


def choose(exposure_us, mains_hz):
    """Return the possible exposure nearest to a wanted one, in us.

    With `mains_hz`, a multiple of half a mains period, so that flickering lamps add the same light
    to each sample.
    """
    if not mains_hz:
        return actual_us(*registers(exposure_us))
    halves = max(1, (exposure_us * mains_hz + _HALF_PERIOD // 2) // _HALF_PERIOD)
    return (halves * _HALF_PERIOD + mains_hz // 2) // mains_hz


def full_scale(atime, astep):
    """Return the largest possible count for values of the registers ATIME and ASTEP."""
    return min(65_535, (atime + 1) * (astep + 1))


def led_code(led_mA):
    """Return the field n of register LED for a current of 4 + 2 n mA; n = 0 means 4 mA, not off."""
    return max(0, led_mA - LED_MIN_MA) >> 1


def actual_mA(led_mA):
    """Return the current in mA that the chip sets for a wanted current `led_mA`; 0 means off."""
    return LED_MIN_MA + 2 * led_code(led_mA) if led_mA else 0
