"""Turns the readings of a strip into key events, contacts and gamepad reports, if switched on.

A contact is a finger on the strip. A board without USB HID sends keys as frames only. Modules of
functions that are switched off are not imported, which saves memory.
"""

from .. import const
from ..fingers.state import STATE, STUCK_T, TWO, UP
from ..reading import decode
from ..runtime.modules import drop
from ..usb.usages import KEYBOARD
from .interfaces import INTERFACES, KeyEvents

_NONE = const(-1)
_NO_MEMORY = "no memory is left for keys and contacts: save and reboot"


def check_layout(lines):
    """Raise LayoutError, a ValueError, if lines (list of str) are not a valid layout."""
    _parse(lines)


def _parse(lines):
    from ..keys import layout

    try:
        return layout.parse(lines or layout.default_lines())
    finally:
        drop(layout)


class Outputs:
    """Passes the readings of a strip to those of keypad, contacts and gamepad that are on.

    The caller updates the board time before each event.
    """

    def __init__(self, sensor, settings, framer, time, interfaces, layout_lines):
        self._sensor = sensor
        self._values = settings.values
        self._framer = framer
        self._time = time
        self._interfaces = interfaces
        self.two = False  # whether two fingers may have caused the last reading
        self.streams_contacts = False
        # Called when a touch has not moved for ``stuck_ms``: it is an object, and no finger. The
        # strip sets it.
        self.stuck = None
        self.memory_fault = None
        self._keypad = self._layout = None
        self._contacts = None  # `contacts.Fingers` while contacts are streamed
        # Those in use. The tracker is that of the keypad, or without keys that of the contacts.
        self._fingers = self._tracker = None
        self._axes = None
        self._events = None  # those of the keypad
        self._until = _NONE  # time of the last reading, whose key events are not processed yet
        self._keys_on = self._gamepad_on = False
        self.active = False  # whether each reading must be passed to `take`
        self.pumps = False  # whether `pump` must be called
        self.layout_lines = layout_lines  # validated; empty for ten keys in a row
        if self._values["keys"] or self._values["gamepad"]:
            # The largest module first, while the memory is in one piece.
            from ..fingers import tracker  # noqa: F401

    def connect(self):
        """Use the USB interfaces, after they were opened."""
        if "gamepad" in self._interfaces.by_name:
            from ..keys.gamepad import GamepadAxes

            self._axes = GamepadAxes(self._interfaces.by_name["gamepad"])

    def use_layout(self, lines):
        """Store validated lines of a layout (list of str; empty: the default layout).

        The caller must call `apply` next.
        """
        self.layout_lines = lines
        self._layout = None

    def apply(self, calibration):
        """Release all keys, then use the present settings and a calibration.

        Without a calibration (None) there are no keys, no gamepad and no contacts.
        """
        self.release()
        known = calibration is not None
        self.memory_fault = None
        self._keys_on = bool(self._values["keys"]) and known
        self._gamepad_on = bool(self._values["gamepad"]) and known and self._axes is not None
        if self._keys_on:
            try:
                if self._keypad is None:
                    from ..keys.keypad import Keypad
                    from ..keys.merge import Merger

                    if self._interfaces.merger is None:
                        self._interfaces.merger = Merger()
                    self._events = KeyEvents(
                        self._sensor, self._framer, self._interfaces, self.stuck
                    )
                    self._keypad = Keypad(self._events, self._interfaces.merger)
                length_um, decay = calibration.length_um, calibration.decay
                self._keypad.set_layout(self._get_layout(), length_um, decay, calibration.cross)
            except MemoryError:
                self.memory_fault = _NO_MEMORY
                self._keys_on = False
        if self._gamepad_on:
            self._axes.set_range(calibration.length_um, calibration.forces_mN[-1])
        self._select_trackers(calibration)

    def stream_contacts(self, on, calibration):
        """Start or end the stream of CONTACT frames; a pressed key stays pressed.

        Returns why the stream remains empty (sentence), or None.
        """
        if on != self.streams_contacts:
            self.streams_contacts = on
            self.memory_fault = None
            self._select_trackers(calibration)
        if not on:
            return None
        return self.memory_fault if calibration else "without a calibration there are no contacts"

    def note(self, calibration):
        """Return why keys or gamepad do not work although they are switched on, and what helps.

        The first result is one or more sentences, or empty; the second one is True if everything
        works after ``save`` and ``reboot``.
        """
        wanted = self.wanted()
        missing, opens = self._interfaces.missing(wanted)
        reboots = bool(opens or self.memory_fault)
        notes = [self.memory_fault, missing]
        if wanted and calibration is None:
            notes.insert(0, "keys and gamepad need a calibration")
            reboots = False  # it is not all
        if self._keys_on and "keyboard" not in self._interfaces.by_name:
            notes.append("keys are sent as frames only")
        return "; ".join(filter(None, notes)), reboots

    def take(self, state):
        """Pass a reading to the keypad, the contacts and the gamepad. Allocates nothing.

        Marks the reading (`decode.Decode.state`) as untrusted while there may be two fingers.
        """
        self.two = False
        if self._tracker is not None:
            t = self._time.ticks()
            self._track(self._tracker, state, t)
            if self._keys_on:
                self._until = self._keypad.until(t)
            if self._fingers is not None:
                if self._keys_on:  # else this tracker has processed the reading already
                    self._track(self._fingers.tracker, state, t)
                self._fingers.send(self._sensor, state)
            flags = state[decode.FLAGS]
            # Not the property `two`: a call takes longer than a look-up.
            if flags & decode.TOUCHING and self._tracker.state[STATE] == TWO:
                self.two = True
                if not flags & decode.MISFIT:
                    state[decode.FLAGS] = flags | decode.FITS_WITH_DRIFT
        if self._gamepad_on and not self.two:
            self._axes.take(state[decode.FLAGS], state[decode.POSITION_UM], state[decode.FORCE_MN])

    def _track(self, tracker, state, t):
        tracker.take(
            state[decode.FLAGS],
            state[decode.POSITION_UM],
            state[decode.FORCE_MN],
            state[decode.BRIGHTNESS],
            t,
        )

    def pump(self):
        """Process the key events of the last reading, and send their frames.

        Call it from the loop: keys in `take`, below the calls that process a sample, would exceed
        the stack of an RP2040.
        """
        if self._until >= 0:
            until = self._until
            self._until = _NONE
            self._keypad.engine.tick(until)
        if self._events is not None and self._events.waiting:
            self._events.send()

    def release(self):
        """Release all keys and the gamepad, end all contacts; ignore the finger until it lifts.

        `pump` sends the frames, and `interfaces.Interfaces.pump` the reports.
        """
        if self._fingers is not None:
            self._fingers.release()
        self._until = _NONE
        if self._keypad is not None:
            self._events.releases = True
            self._keypad.engine.release()  # here, because its calls nest deeply
            self._events.releases = False
            self._keypad.release()
        if self._gamepad_on:
            self._axes.release()

    def _select_trackers(self, calibration):
        """Select the trackers in use: that of the keys, and that of the CONTACT frames."""
        self._tracker = self._keypad.contact if self._keys_on else None
        self._fingers = None
        if not self.streams_contacts:
            self._contacts = None
        elif calibration is not None:
            try:
                begins = self._contacts is None
                if begins:
                    from ..fingers.contacts import Fingers

                    self._contacts = Fingers(self._framer)
                tracker = self._contacts.tracker
                length_um, decay = calibration.length_um, calibration.decay
                tracker.set_layout(self._get_layout(), length_um, decay, calibration.cross)
                if begins:
                    tracker.state[STATE] = UP  # a finger may touch already
                tracker.state[STUCK_T] = 0  # an object is a contact, too
                self._fingers = self._contacts
                self._tracker = self._tracker or tracker
            except MemoryError:
                self.memory_fault = _NO_MEMORY
        self.active = self._tracker is not None or self._gamepad_on
        self.pumps = self._keys_on or bool(self._interfaces.opened)
        self.two = False

    def _get_layout(self):
        if self._layout is None:
            self._layout = _parse(self.layout_lines)
        return self._layout

    def wanted(self):
        """Return the names of the USB interfaces that settings and layout need."""
        kinds = (0, KEYBOARD)  # layout.py is imported only if a layout is used
        if self._values["keys"]:
            try:
                kinds = (0,) + self._get_layout().pages
            except MemoryError:
                self.memory_fault = _NO_MEMORY
        return [
            name for name, setting, kind in INTERFACES if self._values[setting] and kind in kinds
        ]
