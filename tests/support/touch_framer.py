"""Sends readings as TOUCH frames without a strip."""

from spots_device.reading.decode import KIND, TOUCH_SIZE
from spots_device.reading.frame import TOUCH, Framer
from spots_device.reading.kernel import frame, put_touch


class TouchFramer(Framer):
    """A framer that sends readings as TOUCH frames, without a `strip.Strip`."""

    def touch(self, sensor, state):
        """Send the reading in `state` as a TOUCH frame; return whether it was sent."""
        self._head[KIND] = TOUCH | sensor << 4
        put_touch(state, self._head, self.payload)
        return self.send(frame(self._head, self.payload, TOUCH_SIZE, self.encoded))
