"""The board's key engine on the host: the same code and layout, fed with readings."""

from __future__ import annotations

from spots_device.contact import TICK_US, TICKS
from spots_device.decode import DROPPED, LED_OFF
from spots_device.keypad import Keypad
from spots_device.layout import Layout

from ..link.frames import Touch
from ..link.timeouts import RELEASE_S
from ..outputs.devices import KeySink
from .layout import KeyLayout


class KeyEngine:
    """Turns readings into key events as a board does, see `spots_device.keypad`.

    Parameters
    ----------
    layout : KeyLayout
    length_um : int
        Length of the strip, from the board's ``hello``.
    sink : KeySink

    Attributes
    ----------
    length_um, firm_mN : int
        Length of the strip, and the least force of a firm press.
    rests : int
        How often an object that is not a finger was found on the strip.
    """

    def __init__(self, layout: KeyLayout, length_um: int, sink: KeySink):
        self.key = sink.key
        self.length_um = length_um
        self.rests = 0
        self._names = list(layout.layers)
        self._pad = Keypad(self)
        limits = Layout(layout.lines)
        self.firm_mN = limits.firm_mN
        self._pad.set_layout(limits, length_um)
        self._heard_s: float | None = None

    @property
    def layer(self) -> str:
        """Name of the layer that the next touch uses."""
        return self._names[self._pad.layer]

    def take(self, touch: Touch, now_s: float) -> None:
        """Take a reading and send the key events that follow from it.

        Parameters
        ----------
        touch : Touch
            The readings of one strip, in order.
        now_s : float
            When it arrived, in seconds by the clock of `tick`.
        """
        self.tick(now_s)
        t = touch.t_us // TICK_US % TICKS
        flags = touch.flags & ~DROPPED  # the board's own engine has seen every sample
        self._pad.take(flags, touch.position_um, touch.force_mN, touch.brightness_q20, t)
        self._pad.tick(t)
        if not flags & LED_OFF:  # a reading with the LED off sees no finger
            self._heard_s = now_s

    def tick(self, now_s: float) -> None:
        """Release all keys and drop what is pending if no reading has come for `RELEASE_S`."""
        if self._heard_s is not None and now_s - self._heard_s > RELEASE_S:
            self._heard_s = None
            if self._pad.contact.touched:
                self.release()
            else:
                self._pad.forget()  # a finger that comes down meanwhile is a new touch

    def release(self) -> None:
        """Release all keys; a finger that is still there presses nothing until it has lifted."""
        self._pad.release()

    def stuck(self) -> None:
        self.rests += 1
