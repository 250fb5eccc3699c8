"""Searches for gain, LED current and exposure: the command ``autoexpose``.

Imported only when this command is used.
"""

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

# Target band of the brightest channel, in 1/1024 of full scale: 60 % to 90 %. The first step of the
# LED current, from 4 to 6 mA, is a factor of 1.5, so the band must not be narrower than this.
_FULL = 1024
_LOW = 615
_AIM = 768
_HIGH = 921
# Below this level, a step of the gain to the next code (a factor of at most 2.05) does not exceed
# the band.
_STEP_FROM = 440


class Search:
    """Finds settings for which the brightest channel is at 60-90 % of full scale.

    In weak light the search increases the gain (factors of 2), then the LED current. If both are
    at their maximum, it sets a longer exposure of at least 182 ms. A shorter one would not help:
    below 182 ms, full scale grows with the exposure as the counts do. In strong light the search
    reduces the gain while the sensor is saturated, else the LED current, then the gain.

    If `led_max_mA` is 0, the current cannot be set. The steps of the gain are coarse, so the search
    then ends at 43-90 % of full scale.
    """

    def __init__(self, gain, led_mA, exposure_us, led_max_mA):
        self.gain = gain
        self._led_max_mA = actual_mA(led_max_mA)
        self._low, self._led_min_mA = (_LOW, LED_MIN_MA) if led_max_mA else (_STEP_FROM, 0)
        self.led_mA = actual_mA(max(self._led_min_mA, led_mA))
        self.exposure_us = exposure_us
        self._tries = 24

    def step(self, peak, full_scale, saturated):
        """Evaluate a sample and choose the next settings.

        `peak` is the dark-subtracted count of the brightest channel. Returns `DONE`, `TOO_DARK` or
        `TOO_BRIGHT` at the end of the search, else `AGAIN`: take another sample with the attributes
        `gain`, `led_mA` and `exposure_us`.
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
            self.gain += 1  # this is too bright, so the LED current is reduced
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
