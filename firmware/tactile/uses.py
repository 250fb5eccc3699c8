"""What readings become besides frames: keys, and a gamepad.

Settings say which; a board without USB for them sends keys as frames alone.
"""

from .keypad import Keypad

INTERFACES = (("keys", "keyboard"), ("gamepad", "gamepad"))  # setting, USB interface
_WAIT_US = 1_000  # between two offers, when there is nothing else to do


class Uses:
    """Hands readings to what the settings switch on, and reports to the host.

    Parameters
    ----------
    settings : settings.Settings
        ``keys`` and ``gamepad``; read at `apply`.
    framer : frame.Framer
    usb : object or None
        ``open(names) -> dict``: for each interface of `INTERFACES` that there is now, what sends
        its reports. Raises OSError with a sentence if it cannot. None on a board without.

    Attributes
    ----------
    fault : str or None
        Why the USB interfaces that were wanted at start are not there.
    """

    def __init__(self, settings, framer, usb):
        self._values = settings.values
        self._framer = framer
        self._usb = usb
        self._sensor = 0
        self.fault = None
        self._keyboard = self._gamepad = self._axes = None
        self._open()
        self._keypad = Keypad(self)
        self._keys_on = self._gamepad_on = False

    def apply(self, calibration):
        """Let go of all, and go on as the settings and the calibration, or None, say."""
        self.release()
        known = calibration is not None
        self._keys_on = bool(self._values["keys"]) and known
        self._gamepad_on = bool(self._values["gamepad"]) and known and self._axes is not None
        if self._keys_on:
            self._keypad.set_length(calibration.length_um)
        if self._gamepad_on:
            self._axes.set_range(calibration.length_um, calibration.forces_mN[-1])

    def note(self, calibration):
        """Return what keeps the uses that are switched on from working, or None."""
        wanted = [pair for pair in INTERFACES if self._values[pair[0]]]
        notes = []
        if wanted and calibration is None:
            notes.append("without a calibration no touch is a key or moves an axis")
        there = {"keyboard": self._keyboard, "gamepad": self._gamepad}
        for setting, name in wanted:
            if there[name] is None:
                notes.append(self._why_not(setting, name))
        return "; ".join(notes) or None

    def take(self, sensor, decode):
        """Take a reading."""
        self._sensor = sensor
        if self._keys_on:
            self._keypad.take(decode.flags, decode.position_um, decode.force_mN)
        if self._gamepad_on:
            self._axes.take(decode.flags, decode.position_um, decode.force_mN)

    def key(self, usage, modifiers, pressed):
        """Send a key event, as a frame and to the host's keyboard driver."""
        self._framer.key(self._sensor, usage, modifiers, pressed)
        if self._keyboard is not None:
            self._keyboard.key(usage, modifiers, pressed)

    def pump(self):
        """Offer what waits to the host, once; return whether nothing waits any more."""
        idle = True
        if self._keyboard is not None:
            idle = self._keyboard.outbox.pump()
        if self._gamepad is not None:
            idle = self._gamepad.outbox.pump() and idle
        return idle

    def release(self):
        """Let go of all; a touch that lasts is none until it was lifted."""
        self._keypad.release()
        if self._keyboard is not None:
            self._keyboard.release()
        if self._axes is not None:
            self._axes.release()

    def finish(self, clock, within_us):
        """Let go of all and see that the host gets it, but wait no longer than this."""
        self.release()
        end = clock.ticks_add(clock.ticks_us(), within_us)
        while not self.pump() and clock.ticks_diff(end, clock.ticks_us()) > 0:
            clock.sleep_us(_WAIT_US)

    def dropped(self):
        """Return how many reports the host never got."""
        return sum(one.outbox.dropped for one in (self._keyboard, self._gamepad) if one)

    def _open(self):
        wanted = [name for setting, name in INTERFACES if self._values[setting]]
        if self._usb is None or not wanted:
            return
        try:
            sends = self._usb.open(wanted)
        except OSError as error:
            self.fault = str(error)
            return
        # Here, so that other boards have the memory for something else.
        from .gamepad import GamepadAxes
        from .hid import Gamepad, Keyboard

        if "keyboard" in sends:
            self._keyboard = Keyboard(sends["keyboard"])
        if "gamepad" in sends:
            self._gamepad = Gamepad(sends["gamepad"])
            self._axes = GamepadAxes(self._gamepad)

    def _why_not(self, setting, name):
        if self._usb is None:
            instead = ": keys go out as frames" if name == "keyboard" else ""
            return "this board has no USB %s%s" % (name, instead)
        return self.fault or "save and reboot, and the board is a USB %s too" % name
