"""Computes key events on the host: from readings and a key layout, with the firmware's code."""

from collections.abc import Sequence

from spots_device.keys.keypad import Keypad
from spots_device.keys.layout import parse
from spots_device.keys.merge import Merger
from spots_device.reading.decode import LED_OFF

from ..advice.contact_finder import TYPICAL_DECAY, tracker_arguments
from ..link.frames import Touch
from ..link.timeouts import RELEASE_S
from ..outputs.devices import Keyboard, KeySink
from .key_layout import KeyLayout


class KeyEngine:
    """Computes key events from readings as a board does, see `spots_device.keys.keypad`.

    Parameters
    ----------
    layout : KeyLayout
        Keys of the strip.
    length_um : int
        Length of the strip in um, from the board's reply to ``hello``.
    sink : KeySink or Keyboard
        Receiver of the key events, or a keyboard of this computer, which gets their usages.
    decay : int, optional
        Attenuation of the light by the dye in log2 units per um, times 2**24: the value of
        ``decay`` in the board's reply to ``hello``. If not given, or 0, a typical value is used.
    merger : spots_device.keys.merge.Merger, optional
        State of the keyboard, if several strips are one keyboard.
    cross : sequence of int, optional
        Cross-sensitivity of the strip: the value of ``cross`` in the board's reply to ``hello``.

    Attributes
    ----------
    length_um : int
        Length of the strip, in um.
    firm_mN : int
        Least force of a firm press, in mN.
    objects : int
        Number of times that an object instead of a finger was detected on the strip; the caller may
        set it to 0.
    """

    def __init__(
        self,
        layout: KeyLayout,
        length_um: int,
        sink: KeySink | Keyboard,
        decay: int | None = None,
        merger: Merger | None = None,
        cross: Sequence[int] | None = None,
    ):
        # A keyboard of this computer takes single usages, other receivers take key events.
        if isinstance(sink, Keyboard):
            self.usage, self.key = sink.usage, _ignore
        else:
            self.usage, self.key = _ignore, sink.key
        self.length_um = length_um
        self.objects = 0
        self._names = list(layout.layers)
        self._pad = Keypad(self, merger or Merger())
        limits = parse(layout.lines)
        self.firm_mN = limits.firm_mN
        self._pad.set_layout(limits, length_um, decay or TYPICAL_DECAY, cross)
        self._heard_s: float | None = None

    @property
    def layer(self) -> str:
        """Name of the layer that the next touch will use."""
        return self._names[self._pad.layer]

    def take(self, touch: Touch, now_s: float) -> None:
        """Add a reading, and send the key events that this reading causes.

        Parameters
        ----------
        touch : Touch
            The next reading of the strip.
        now_s : float
            Time at which the reading arrived, in seconds, by the same clock as in `tick`.
        """
        self.tick(now_s)
        arguments = tracker_arguments(touch)
        self._pad.take(*arguments)
        self._pad.tick(arguments[-1])
        if not touch.flags & LED_OFF:  # a reading with the LED off does not show a finger
            self._heard_s = now_s

    def tick(self, now_s: float) -> None:
        """Release all keys and drop pending actions if no reading arrives for `RELEASE_S` seconds.

        Readings with the LED off do not count. Call `tick` regularly.

        Parameters
        ----------
        now_s : float
            Present time in seconds, by the same clock as in `take`.
        """
        if self._heard_s is not None and now_s - self._heard_s > RELEASE_S:
            self._heard_s = None
            if self._pad.contact.touched:
                self.release()
            else:
                self._pad.forget()  # the next finger is a new touch

    def release(self) -> None:
        """Release all keys. A finger that still touches presses no key until it is lifted."""
        self._pad.release()

    def has_room(self) -> bool:
        return True

    def scroll(self, number: int, parts: int) -> None:
        """Ignore a wheel: only a board is a mouse.

        Parameters
        ----------
        number : int
            Direction, see `spots_device.usb.usages.WHEEL`.
        parts : int
            How far to scroll, in 120ths of a notch.
        """

    def stuck(self) -> None:
        self.objects += 1


def _ignore(page: int, usage: int, modifiers: int, pressed: bool) -> None:
    pass
