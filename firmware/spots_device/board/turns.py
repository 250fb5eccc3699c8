"""Several strips on a board: their objects, and which one is next.

Only a board with several strips gets this module.
"""

import gc

from .. import const
from .strip_app import StripApp

# The loop polls the strip with the earliest deadline next. To give a strip priority, the following
# times are subtracted from its deadline.
# For a poll that is not certain to find a sample: it limits the time of the sample, so it must not
# be late. Times the number of other strips: it is the time to process a sample.
_AHEAD_US = const(2_500)
# In addition, for the strip of the loop's last poll while its sample times are unknown. Without it,
# two such strips would be polled in turn, and the polls of each strip would be too far apart.
_STAYS_US = const(4_000)
_UNKNOWN_US = const(1 << 24)  # a sample's end is known at least this well, or not at all
_FAR_US = const(1 << 29)


def open_strips(board, configs, open_sensor):
    """Return the strips of a board as a tuple; the arguments are those of `app.Board`."""
    strips = []
    for own in configs:
        gc.collect()  # so that the objects of each strip do not lie between garbage
        config = type("Config", (), own)
        sensor = open_sensor(config, board.clock)
        if hasattr(config, "MUX_CHANNEL"):
            from ..sensor.multiplexer import connect

            connect(sensor, config.MUX_CHANNEL)
        strips.append(StripApp(board, len(strips), config, sensor))
    return tuple(strips)


class Turns:
    """Chooses the strip of a board with several strips whose sample the loop waits for.

    Parameters
    ----------
    strips : tuple of strip_app.StripApp
        The strips; see `strip_app.StripApp`.
    clock : object
        ``ticks_diff`` as in MicroPython's ``time``.
    """

    def __init__(self, strips, clock):
        self._strips = strips
        self._last = strips[0]
        self._diff = clock.ticks_diff
        self._ahead_us = _AHEAD_US * (len(strips) - 1)

    def next(self, now):
        """Return the strip to poll next: the same again if all are lost. Allocates nothing."""
        chosen = self._last
        least_us = _FAR_US
        i = 0
        while i < len(self._strips):  # an iterator would need a larger call frame, see strip.py
            left_us = self._left_us(self._strips[i], now)
            if left_us < least_us:
                chosen = self._strips[i]
                least_us = left_us
            i += 1
        self._last = chosen
        return chosen

    def _left_us(self, strip, now):
        if strip.reconnect.lost:
            return _FAR_US
        pacing = strip.pacing
        left_us = self._diff(pacing.due, now)
        unsure_us = self._diff(pacing.sure, pacing.due)
        if unsure_us:
            left_us -= self._ahead_us
            if unsure_us > _UNKNOWN_US and strip is self._last:
                left_us -= _STAYS_US
        return left_us
