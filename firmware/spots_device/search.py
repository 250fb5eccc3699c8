"""The search for a good gain, LED current and exposure; loaded only for the command ``auto``."""

from .exposure import (
    AGAIN,
    DONE,
    GAIN_MAX,
    LED_MIN_MA,
    MAX_US,
    TOO_BRIGHT,
    TOO_DARK,
    actual_mA,
)

# The search aims between these, in 1/1024 of full scale: 60 % to 90 %. The least LED current
# grows by half in its first step, so the band must not be narrower than a factor of 1.5.
_FULL = 1024
_LOW = 615
_AIM = 768
_HIGH = 921
# From below this a step of the gain does not overshoot: it is 2.05 at most, not 2.
_STEP_FROM = 440


class Search:
    """Find the setting that puts the brightest channel at 60-90 % of full scale.

    Gain first (factors of 2), then LED current for the rest; a longer exposure only when both
    are spent, where full scale no longer grows with it.

    Parameters
    ----------
    gain, led_mA, exposure_us : int
        The setting to begin with.
    led_max_mA : int
        Largest current of the LED; 0 if its light cannot be set. The gain alone, in its steps,
        reaches 43-90 % of full scale.
    """

    def __init__(self, gain, led_mA, exposure_us, led_max_mA):
        self.gain = gain
        self._led_max_mA = actual_mA(led_max_mA)
        self._low, self._led_min_mA = (_LOW, LED_MIN_MA) if led_max_mA else (_STEP_FROM, 0)
        self.led_mA = actual_mA(max(self._led_min_mA, led_mA))
        self.exposure_us = exposure_us
        self._tries = 24

    def step(self, peak, full_scale, saturated):
        """Judge a sample taken at the present setting and choose the next one.

        Parameters
        ----------
        peak : int
            Dark-subtracted count of the brightest channel.
        full_scale : int
            Largest count at this exposure.
        saturated : bool
            Whether the sensor reported saturation.

        Returns
        -------
        int
            `DONE`, `AGAIN` with the new setting in the attributes, `TOO_DARK` or `TOO_BRIGHT`.
        """
        level = _FULL if saturated else max(peak * _FULL // full_scale, 0)
        if self._low <= level < _HIGH:
            return DONE
        self._tries -= 1
        if level < self._low:
            return self._brighter(max(level, 1)) if self._tries else TOO_DARK
        return self._darker(saturated) if self._tries else TOO_BRIGHT

    def _brighter(self, level):
        if self.gain < GAIN_MAX and level < _STEP_FROM:
            while self.gain < GAIN_MAX and level < _STEP_FROM:
                self.gain += 1
                level *= 2
        elif self.led_mA < self._led_max_mA:
            wanted_mA = actual_mA(self.led_mA * _AIM // level)
            self.led_mA = min(self._led_max_mA, max(self.led_mA + 2, wanted_mA))
        elif self.gain < GAIN_MAX:
            self.gain += 1  # a step too much, taken back by the LED
            self.led_mA = actual_mA(self.led_mA * _AIM // (2 * level))
        elif self.exposure_us < MAX_US:
            self.exposure_us = min(MAX_US, max(self.exposure_us, 182_000) * _AIM // level)
        else:
            return TOO_DARK
        return AGAIN

    def _darker(self, saturated):
        if saturated and self.gain > 0:
            self.gain -= 1
        elif self.led_mA > self._led_min_mA:
            factor = _FULL // 2 if saturated else _AIM
            wanted_mA = actual_mA(self.led_mA * factor // _FULL)
            self.led_mA = max(LED_MIN_MA, min(self.led_mA - 2, wanted_mA))
        elif self.gain > 0:
            self.gain -= 1
        else:
            return TOO_BRIGHT
        return AGAIN
