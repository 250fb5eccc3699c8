"""Reconnects a sensor that does not answer: repeats its start, and reports the fault one time."""

from .. import const
from ..sensor.as7341 import SensorError

_RETRY_US = const(100_000)


class Reconnect:
    """Records whether the sensor answers, and starts it again if it does not.

    Parameters
    ----------
    strip : strip.Strip
        Strip whose sensor is started.
    clock : object
        ``ticks_us``, ``ticks_add`` and ``ticks_diff`` as in MicroPython's ``time``.
    replies : command.Replies
        Sends the log lines.
    on_found : callable
        Called without arguments after each successful start in `search`.
    on_lost : callable
        Called without arguments each time the sensor does not answer.

    Attributes
    ----------
    lost : bool
        True while the sensor does not answer.
    fault : str or None
        Sentence about the last fault. None before the first fault, and after the sensor has given
        a sample again.
    faults : int
        Number of faults since the start of the firmware.
    """

    def __init__(self, strip, clock, replies, on_found, on_lost):
        self._strip = strip
        self._clock = clock
        self._replies = replies
        self._on_found = on_found
        self._on_lost = on_lost
        self._due = clock.ticks_us()
        self.lost = True
        self.fault = None
        self.faults = 0

    def search(self):
        """Try to start the sensor, which takes 25 ms; return False if it is too early for it."""
        clock = self._clock
        if clock.ticks_diff(clock.ticks_us(), self._due) < 0:
            return False
        try:
            self._strip.start()
        except (OSError, SensorError) as error:
            self.lose(error)
        else:
            self.lost = False
            self._on_found()
        return True

    def restart(self):
        """Restart the sensor with the present settings; does nothing while the sensor is lost."""
        if not self.lost:
            try:
                self._strip.start()
            except (OSError, SensorError) as error:
                self.lose(error)

    def lose(self, error):
        """Record that the sensor does not answer; the main loop then calls `search`.

        The first attempt follows immediately, each further one 0.1 s later.

        Parameters
        ----------
        error : OSError or as7341.SensorError
            Cause of the loss.
        """
        clock = self._clock
        known, was_lost = self.fault, self.lost
        self._due = clock.ticks_add(clock.ticks_us(), _RETRY_US if known or was_lost else 0)
        self.lost = True
        self._on_lost()
        self.fault = str(error)
        if isinstance(error, OSError):
            self.fault = "the I2C bus failed (%s): check the wiring" % error
        if not known:  # further failed attempts are the same fault, and are not reported
            self.faults += 1
            self._replies.log("error", self.fault)

    def sampled(self):
        """Record that the sensor works again, because a sample came after a fault."""
        self.fault = None
        self._replies.log("info", "the sensor answers")

    def report(self, reply):
        """Add the number of faults and the present fault to a reply to ``get`` (dict)."""
        reply["faults"] = self.faults
        reply["fault"] = self.fault
