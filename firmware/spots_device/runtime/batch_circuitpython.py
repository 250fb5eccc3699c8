"""Main loop of CircuitPython boards with one strip."""

from ..app import BoardApp


class BatchApp(BoardApp):
    """A `BoardApp` that reads neither the clock nor a command between two samples of a FIFO read.

    On CircuitPython, both together take 0.1 ms for each sample, and the clock allocates memory. A
    FIFO read gets 20 samples at most, so a command waits up to 60 ms longer.
    """

    def _pass(self):
        BoardApp._pass(self)
        if self.reconnect.lost:
            return
        sensor = self._sensor
        # `poll` does not use the bus while samples wait. `_take` can restart the sensor, which
        # drops the waiting samples.
        while sensor.waits:
            if self._outputs:
                self.uses.pump()
            self._poll()
            self._take()
