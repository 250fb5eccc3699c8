"""The newest reading of each strip, and the rate of the readings."""

from collections import deque

from .frames import Touch

_RATE_READINGS = 64  # number of readings from which the rate is computed


class Newest:
    """Stores the newest reading since the last restart of the board, for each sensor."""

    def __init__(self):
        self.touches: dict[int, Touch] = {}
        self._times_us: deque[int] = deque(maxlen=_RATE_READINGS)

    def take(self, touch: Touch) -> None:
        """Store a reading that has just arrived."""
        self.touches[touch.sensor] = touch
        if touch.sensor == 0:
            self._times_us.append(touch.t_us)

    def forget(self) -> None:
        """Drop the readings, because the board was unplugged."""
        self.touches.clear()

    def restart(self) -> None:
        """Drop the readings and their times, because the board's clock starts again."""
        self.touches.clear()
        self._times_us.clear()

    @property
    def rate_hz(self) -> float:
        """Mean rate of the last 64 readings of sensor 0 in Hz; NaN before two readings."""
        times_us = self._times_us
        if len(times_us) < 2:
            return float("nan")
        return (len(times_us) - 1) * 1e6 / max(1, (times_us[-1] - times_us[0]) % (1 << 32))

    @property
    def rate_text(self) -> str:
        """The rate in words."""
        texts = "no readings yet", "one reading", f"{self.rate_hz:.1f} Hz"
        return texts[min(len(self._times_us), 2)]
