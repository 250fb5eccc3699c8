"""Turns the readings of a strip into key events, contacts and gamepad reports, if switched on.

A contact is a finger on the strip. A board without USB HID sends keys as frames only. Modules of
functions that are switched off are not imported, which saves memory.
"""

from array import array

from .. import const
from ..fingers.state import STATE, STUCK_T, TWO, UP
from ..reading import decode
from ..runtime.modules import drop
from ..usb.usages import KEYBOARD, MOUSE
from .interfaces import INTERFACES

_NONE = const(-1)
_EVENTS = const(16)  # key events that wait; `engine.Engine.release` causes 15 at most
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
    """Passes the readings of a strip to keypad, contacts and gamepad; sends their events.

    Parameters
    ----------
    sensor : int
        Number of the strip's sensor, from 0.
    settings : settings.BoardSettings
        Settings of the strip; `apply` reads ``keys`` and ``gamepad``.
    framer : frame.Framer
        Sends key events as KEY frames, and fingers as CONTACT frames.
    time : frame.Time32
        Board time; the caller updates it before each event.
    interfaces : interfaces.Interfaces
        USB interfaces, which get the reports.
    layout_lines : list of str
        Validated lines of a `keymap.KeyMap`; an empty list selects ten keys in a row.

    Attributes
    ----------
    active : bool
        Whether the caller must pass each reading to `take`.
    pumps : bool
        Whether the caller must call `pump`.
    streams_contacts : bool
        Whether CONTACT frames are streamed.
    two : bool
        Whether two fingers may have caused the last reading.
    needs_reboot : bool
        Whether `note` has found that a reboot, after ``save``, makes everything work.
    is_object : bool
        Whether the touch has not moved for the layout's ``stuck_ms``: it is then treated as an
        object, not as a finger.
    """

    def __init__(self, sensor, settings, framer, time, interfaces, layout_lines):
        self._sensor = sensor
        self._values = settings.values
        self._framer = framer
        self._time = time
        self._interfaces = interfaces
        self.is_object = self.two = self.streams_contacts = False
        self.memory_fault = None
        self.needs_reboot = False
        self._keypad = self._layout = None
        self._contacts = None  # `contacts.Fingers` while contacts are streamed
        # Those in use. The tracker is that of the keypad, or without keys that of the contacts.
        self._fingers = self._tracker = None
        self._axes = None
        self._events = array("i", bytes(4 * 3 * _EVENTS))
        self._waiting = 0  # key events in `_events`
        self._releases = False  # whether `release` is running
        self._until = _NONE  # time of the last reading, whose key events are not processed yet
        self._keys_on = self._gamepad_on = self.active = self.pumps = False
        self.layout_lines = layout_lines
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

        Parameters
        ----------
        calibration : calibration.Calibration or None
            None switches keys, gamepad and contacts off.
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
                    self._keypad = Keypad(self, self._interfaces.merger)
                length_um, decay = calibration.length_um, calibration.decay
                self._keypad.set_layout(self._get_layout(), length_um, decay, calibration.cross)
            except MemoryError:
                self.memory_fault = _NO_MEMORY
                self._keys_on = False
        if self._gamepad_on:
            self._axes.set_range(calibration.length_um, calibration.forces_mN[-1])
        self._follow(calibration)

    def stream_contacts(self, on, calibration):
        """Start or end the stream of CONTACT frames; a pressed key stays pressed.

        Parameters
        ----------
        on : bool
            Whether to send a frame for each finger and reading.
        calibration : calibration.Calibration or None
            Calibration in use; without a calibration there are no contacts.

        Returns
        -------
        str or None
            Sentence that says why the stream remains empty. None if the stream works or was ended.
        """
        if on != self.streams_contacts:
            self.streams_contacts = on
            self.memory_fault = None
            self._follow(calibration)
        if not on:
            return None
        return self.memory_fault if calibration else "without a calibration there are no contacts"

    def note(self, calibration):
        """Return why keys or gamepad do not work although they are switched on, or None.

        Parameters
        ----------
        calibration : calibration.Calibration or None
            Calibration in use; None without a calibration.

        Returns
        -------
        str or None
            One or more sentences for the user; None if everything works.
        """
        wanted = self.wanted()
        missing, opens = self._interfaces.missing(wanted)
        self.needs_reboot = bool(opens or self.memory_fault)
        notes = [self.memory_fault, missing]
        if wanted and calibration is None:
            notes.insert(0, "keys and gamepad need a calibration")
            self.needs_reboot = False  # it is not all
        if self._keys_on and "keyboard" not in self._interfaces.by_name:
            notes.append("keys are sent as frames only")
        return "; ".join(filter(None, notes)) or None

    def take(self, state):
        """Pass a reading to the keypad, the contacts and the gamepad. Allocates nothing.

        Marks the reading as untrusted while there may be two fingers.

        Parameters
        ----------
        state : array of int
            The reading, as in `decode.Decode.state`.
        """
        self.is_object = self.two = False
        if self._tracker is not None:
            self._track(state)
            if self._fingers is not None:
                self._follow_fingers(state)
                self._fingers.send(self._sensor, state)
            flags = state[decode.FLAGS]
            # Not the property `two`: a call takes longer than a look-up.
            if flags & decode.TOUCHING and self._tracker.state[STATE] == TWO:
                self.two = True
                # A spectrum that fits one press gets both bits, see decode.FITS_WITH_DRIFT.
                state[decode.FLAGS] = flags | (
                    decode.MISFIT if flags & decode.MISFIT else decode.MISFIT | decode.TOO_DARK
                )
        if self._gamepad_on and not self.two:
            self._axes.take(state[decode.FLAGS], state[decode.POSITION_UM], state[decode.FORCE_MN])

    def _track(self, state):
        t = self._time.ticks()
        self._tracker.take(
            state[decode.FLAGS],
            state[decode.POSITION_UM],
            state[decode.FORCE_MN],
            state[decode.BRIGHTNESS],
            t,
        )
        if self._keys_on:
            self._until = self._keypad.until(t)

    def _follow_fingers(self, state):
        # Without keys, `_track` has processed the reading already.
        if self._keys_on:
            self._fingers.tracker.take(
                state[decode.FLAGS],
                state[decode.POSITION_UM],
                state[decode.FORCE_MN],
                state[decode.BRIGHTNESS],
                self._time.ticks(),
            )

    def usage(self, page, usage, modifiers, pressed):
        """Pass the press or release of a single usage to its open interface, see `merge.Merger`."""
        output = self._interfaces.by_kind.get(page)
        if output is not None:
            output.key(usage, modifiers, pressed)

    def scroll(self, number, parts):
        """Turn the wheel `number`, see `usages.WHEEL`, by 120ths of a notch."""
        mouse = self._interfaces.by_kind.get(MOUSE)
        if mouse is not None:
            mouse.scroll(number, parts)
            mouse.flush()

    def key(self, page, usage, modifiers, pressed):
        """Queue the report of a key event; its frame follows, see `has_room`.

        Parameters
        ----------
        page, usage : int
            Kind of the action, see `usages.KEYBOARD`, and usage or number.
        modifiers : int
            Bits of all modifier keys that are down after the event.
        pressed : bool
            True for a press, False for a release.
        """
        # A command, whose calls nest deeply, may cause a release: then no more calls are possible.
        if not self._releases:
            self._flush()
        at = 3 * self._waiting
        if at == len(self._events):
            return
        self._events[at] = page << 16 | usage
        self._events[at + 1] = modifiers
        self._events[at + 2] = int(pressed)
        self._waiting += 1

    def has_room(self):
        """Send the frames of the last event; return whether there is room for another event."""
        self._send_keys()
        # Not `all` with a generator, which allocates.
        for output in self._interfaces.opened:  # noqa: SIM110
            if not output.outbox.has_room():
                return False
        return True

    def _flush(self):
        for output in self._interfaces.pressing:
            if output.unsent:
                output.flush()

    def _send_keys(self):
        i = 0
        while i < self._waiting:
            self._send_key(3 * i)
            i += 1
        self._waiting = 0

    def _send_key(self, at):
        self._framer.key(
            self._sensor,
            self._events[at] >> 16,
            self._events[at] & 0xFFFF,
            self._events[at + 1],
            self._events[at + 2],
        )

    def stuck(self):
        """Record that the present touch is no finger, because it has not moved for long."""
        self.is_object = True

    def pump(self):
        """Process the key events of the last reading, and send their frames.

        Call it from the loop: keys in `take`, below the calls that process a sample, would exceed
        the stack of an RP2040.
        """
        if self._until >= 0:
            until = self._until
            self._until = _NONE
            self._keypad.engine.tick(until)
        if self._waiting:
            self._send_keys()

    def release(self):
        """Release all keys and the gamepad, end all contacts; ignore the finger until it lifts.

        `pump` sends the frames, and `interfaces.Interfaces.pump` the reports.
        """
        if self._fingers is not None:
            self._fingers.release()
        self._until = _NONE
        if self._keypad is not None:
            self._releases = True
            self._keypad.engine.release()  # here, because its calls nest deeply
            self._releases = False
            self._keypad.release()
        if self._gamepad_on:
            self._axes.release()

    def _follow(self, calibration):
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
        self._activate()

    def _activate(self):
        self.active = self._tracker is not None or self._gamepad_on
        self.pumps = self._keys_on or bool(self._interfaces.opened)
        self.is_object = self.two = False

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
