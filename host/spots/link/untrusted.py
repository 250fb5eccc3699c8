"""Readings that are all untrusted: the cause and the next step, in one sentence."""

from __future__ import annotations

import sys

from spots_device import decode

from .frames import Touch

# With the longest time between readings that an application takes, 0.3 s, within a second.
_UNTRUSTED_S = 0.7
# The first that holds is the cause.
_CAUSES = {
    decode.NOT_CALIBRATED: (
        "the board has no calibration that holds at its settings; next: spots calibrate position"
    ),
    decode.SATURATED: (
        "the sensor is saturated; next: shade the strip, or calibrate it with a smaller gain"
    ),
    decode.LED_OFF: (
        "the board takes its dark frame again and again; next: lift all fingers, keep light steady"
    ),
    decode.MISFIT: (
        "the spectrum does not fit one press; next: lift all fingers and wipe the strip, and if "
        "that changes nothing, re-zero is advised: spots rezero"
    ),
}


class Untrusted:
    """Notices that for most of a second every reading of a strip is untrusted.

    A trusted reading, or one of an untouched strip, ends it.

    Attributes
    ----------
    sentence : str
        The cause and the next step; empty while readings are good.
    """

    def __init__(self):
        self.sentence = ""
        self._since_s: float | None = None

    def take(self, touch: Touch, now_s: float) -> None:
        """Take a reading and update `sentence`.

        Parameters
        ----------
        touch : Touch
            The readings of one strip, in order.
        now_s : float
            When it arrived, in seconds by the link's clock.
        """
        cause = next((text for flag, text in _CAUSES.items() if touch.flags & flag), None)
        if cause is None:
            self.sentence, self._since_s = "", None
        elif self._since_s is None:
            self._since_s = now_s
        elif now_s - self._since_s >= _UNTRUSTED_S:
            self.sentence = f"every reading is untrusted, because {cause}"

    def warn(self, touch: Touch, now_s: float) -> None:
        """Take a reading; print `sentence` to stderr when it becomes non-empty.

        Parameters
        ----------
        touch : Touch
            The readings of one strip, in order.
        now_s : float
            When it arrived, in seconds by the link's clock.
        """
        before = self.sentence
        self.take(touch, now_s)
        if self.sentence and not before:
            print(f"spots: {self.sentence}", file=sys.stderr, flush=True)
