"""Keys and gamepad: what readings become besides frames.

The settings choose; a board without USB HID sends keys as frames alone. What is switched off is not
loaded, which saves memory.
"""

from .decode import MISFIT, TOO_DARK, TOUCHING

# USB interface, and the setting that wants it.
INTERFACES = (("keyboard", "keys"), ("consumer", "keys"), ("gamepad", "gamepad"))
# HID usage pages as in layout.py, which is loaded only where it is used.
_KEYBOARD_PAGE = 7
_CONSUMER_PAGE = 12
_NO_MEMORY = "no memory is left for keys: save and reboot"


def check_layout(lines):
    """Raise LayoutError, a ValueError, if lines are no layout."""
    from .layout import Layout  # only where it is used

    Layout(lines)


class Uses:
    """Passes readings to keypad and gamepad, and their reports to the host.

    Parameters
    ----------
    settings : settings.BoardSettings
        ``keys`` and ``gamepad``; read at `apply`.
    framer : frame.Framer
    time : frame.Time32
        Set to the time of an event before the event is passed on.
    usb : object or None
        ``open(names) -> dict``: for each interface of `INTERFACES` that there is now, what sends
        its reports. Raises OSError with a sentence if it cannot. None on a board without.
    layout_lines : list of str
        Lines of a `layout.Layout` that were checked, or none for ten keys in a row.

    Attributes
    ----------
    two : bool
        Whether the last reading may be of two fingers.
    fault : str or None
        Why the USB interfaces that were wanted at start are not there.
    """

    def __init__(self, settings, framer, time, usb, layout_lines):
        self._values = settings.values
        self._framer = framer
        self._time = time
        self._usb = usb
        self._sensor = 0
        self._rests = self.two = False
        self.fault = None
        self._memory_fault = None
        self._keypad = self._layout = None
        self._keyboard = self._consumer = self._axes = None
        self._there = {}  # interfaces by name
        self._outputs = ()  # the same: the loop allocates nothing over a tuple
        self._keys_on = self._gamepad_on = False
        self.layout_lines = layout_lines
        self._open()

    def use_layout(self, lines):
        """Take lines of a layout that were checked, or none; `apply` has to follow."""
        self.layout_lines = lines
        self._layout = None

    def apply(self, calibration):
        """Release all keys, then follow the settings and this calibration, or None."""
        self.release()
        known = calibration is not None
        self._memory_fault = None
        self._keys_on = bool(self._values["keys"]) and known
        self._gamepad_on = bool(self._values["gamepad"]) and known and self._axes is not None
        if self._keys_on:
            self._keys_on = self._prepare_keypad(calibration.length_um)
        if self._gamepad_on:
            self._axes.set_range(calibration.length_um, calibration.forces_mN[-1])

    def note(self, calibration):
        """Return what keeps keys or gamepad from working although they are on, or None."""
        wanted = self._wanted()
        if not wanted:
            return None
        notes = []
        if calibration is None:
            notes.append("without a calibration no touch is a key or moves an axis")
        missing = [name for name in wanted if name not in self._there]
        if self._memory_fault:
            notes.append(self._memory_fault)
        if missing and self.fault:
            notes.append(self.fault)
        elif missing and self._usb is None:
            notes.append("this board has no USB %s" % " and ".join(missing))
        elif missing:
            notes.append("save and reboot, and the board is a USB %s too" % " and ".join(missing))
        if "keyboard" in missing and self._keys_on:
            notes.append("keys go out as frames")
        return "; ".join(notes) or None

    def take(self, sensor, decode):
        """Take a reading; return whether what lies there has rested too long to be a finger.

        Marks it as untrusted while there may be two fingers. Allocates nothing.
        """
        self._sensor = sensor
        self._rests = self.two = False
        if self._keys_on:
            t = self._time.high << 6 | self._time.low >> 10
            self._keypad.take(
                decode.flags, decode.position_um, decode.force_mN, decode.brightness, t
            )
            self._keypad.tick(t)
            if decode.flags & TOUCHING and self._keypad.contact.two:
                self.two = True
                # Both bits where this spectrum alone would fit one press, see contact.py.
                decode.flags |= MISFIT if decode.flags & MISFIT else MISFIT | TOO_DARK
        if self._gamepad_on:
            self._axes.take(decode.flags, decode.position_um, decode.force_mN)
        return self._rests

    def key(self, page, usage, modifiers, pressed):
        """Send a key event, as a frame and to the host's driver."""
        self._framer.key(self._sensor, page, usage, modifiers, pressed)
        if page == _KEYBOARD_PAGE:
            if self._keyboard is not None:
                self._keyboard.key(usage, modifiers, pressed)
        elif self._consumer is not None:
            self._consumer.key(usage, pressed)

    def stuck(self):
        """Record that what lies on the strip is not a finger."""
        self._rests = True

    def pump(self):
        """Offer queued reports to the host, once; return whether all queues are empty."""
        idle = True
        for output in self._outputs:
            idle = output.outbox.pump() and idle
        return idle

    def release(self):
        """Release all; a touch that lasts counts again only after it was lifted."""
        if self._keypad is not None:
            self._keypad.release()
        for output in self._outputs:
            output.release()

    def finish(self, clock, until):
        """Release all and send it to the host; give up at these ticks."""
        self.release()
        while not self.pump() and clock.ticks_diff(until, clock.ticks_us()) > 0:
            clock.sleep_us(1_000)  # there is nothing else to do

    def dropped(self):
        """Return how many reports were never sent."""
        dropped = 0
        for output in self._outputs:
            dropped += output.outbox.dropped
        return dropped

    def _prepare_keypad(self, length_um):
        """Load the keypad and its layout; return whether memory sufficed."""
        try:
            if self._keypad is None:
                from .keypad import Keypad

                self._keypad = Keypad(self)
            self._keypad.set_layout(self._get_layout(), length_um)
        except MemoryError:
            self._memory_fault = _NO_MEMORY
            return False
        return True

    def _get_layout(self):
        if self._layout is None:
            from .layout import Layout, default_lines

            self._layout = Layout(self.layout_lines or default_lines())
        return self._layout

    def _wanted(self):
        names = [name for name, setting in INTERFACES if self._values[setting]]
        if "consumer" in names and not self._has_consumer_keys():
            names.remove("consumer")
        return names

    def _has_consumer_keys(self):
        try:
            return _CONSUMER_PAGE in self._get_layout().pages
        except MemoryError:
            self._memory_fault = _NO_MEMORY
            return False

    def _open(self):
        names = self._wanted()
        if self._usb is None or not names:
            return
        try:
            sends = self._usb.open(names)
        except OSError as error:
            self.fault = str(error)
            return
        from .gamepad import GamepadAxes
        from .hid import ConsumerReports, GamepadReports, KeyboardReports

        kinds = {
            "keyboard": KeyboardReports,
            "consumer": ConsumerReports,
            "gamepad": GamepadReports,
        }
        self._there = {name: kinds[name](send) for name, send in sends.items()}
        self._outputs = tuple(self._there.values())
        self._keyboard = self._there.get("keyboard")
        self._consumer = self._there.get("consumer")
        if "gamepad" in self._there:
            self._axes = GamepadAxes(self._there["gamepad"])
