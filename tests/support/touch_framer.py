"""Sends readings as TOUCH frames without a strip."""

from spots_device.reading.decode import KIND
from spots_device.reading.frame import TOUCH, Framer
from spots_device.reading.kernel import touch


class TouchFramer(Framer):
    """A framer that sends readings as TOUCH frames, without a `strip.Strip`."""

    def touch(self, sensor, state):
        """Send the reading in `state` as a TOUCH frame; return whether it was sent."""
        self._head[KIND] = TOUCH | sensor << 4
        return self.send(touch(self._head, self.payload, state, self.encoded))
