"""A sensor that does not answer: searched again and again, reported once."""

import gc

from micropython import const

from .as7341 import SensorError

_RETRY_US = const(100_000)


class Reconnect:
    """Whether the sensor answers, and the search for it.

    Parameters
    ----------
    strip : strip.Strip
    clock : object
        ``sleep_us``.
    replies : command.Replies
    on_found, on_lost : callable
        Called without arguments once the sensor samples, and whenever it does not answer.

    Attributes
    ----------
    lost : bool
        Whether the sensor has to be searched.
    fault : str or None
        Why it was lost, until it has sampled again.
    faults : int
        How often it was lost.
    """

    def __init__(self, strip, clock, replies, on_found, on_lost):
        self._strip = strip
        self._clock = clock
        self._replies = replies
        self._on_found = on_found
        self._on_lost = on_lost
        self.lost = True
        self.fault = None
        self.faults = 0

    def search(self):
        """Try to start the sensor, once; takes 0.1 s if it does not answer."""
        # Nothing is sampled now, so a pause costs nothing. A heap full of what earlier searches
        # left would slow the loop down as long as nobody sends a command.
        gc.collect()
        try:
            self._strip.start()
        except (OSError, SensorError) as error:
            self.lose(error)
            self._clock.sleep_us(_RETRY_US)
            return
        self.lost = False
        self._on_found()
        gc.collect()  # what was loaded and parsed just now left garbage

    def restart(self):
        """Restart the sensor with the present settings; does nothing while it is lost."""
        if not self.lost:
            try:
                self._strip.start()
            except (OSError, SensorError) as error:
                self.lose(error)

    def lose(self, error):
        """Record that the sensor does not answer; `search` has to follow."""
        self.lost = True
        self._on_lost()
        known, self.fault = self.fault, str(error)
        if isinstance(error, OSError):
            self.fault = "the I2C bus failed (%s)" % error
        if not known:  # once, not a flood
            self.faults += 1
            self._replies.log("error", self.fault)

    def sampled(self):
        """Record that a sample came after a fault."""
        self.fault = None
        self._replies.log("info", "the sensor is back")

    def report(self, reply):
        """Put what ``get`` returns of faults into a reply."""
        reply["faults"] = self.faults
        reply["fault"] = self.fault
