"""The USB interfaces of a board, which all of its strips share; sends their reports to the host."""

from array import array

from .. import const
from ..usb.usages import CONSUMER, KEYBOARD, MOUSE, SYSTEM

# Name of each USB interface, the setting that enables it, and the kind of actions that need it.
INTERFACES = (
    ("keyboard", "keys", KEYBOARD),
    ("consumer", "keys", CONSUMER),
    ("system", "keys", SYSTEM),
    ("mouse", "keys", MOUSE),
    ("gamepad", "gamepad", 0),
)
_EVENTS = const(16)  # key events that wait; `engine.Engine.release` causes 15 at most


class Interfaces:
    """Opens the interfaces that the strips need, and offers their reports to the host.

    `usb` is None on a board without USB HID. Else ``usb.open(names)`` opens interfaces of
    `INTERFACES`, and returns a dict with a function ``send(report) -> bool`` for each opened one;
    it raises an OSError with a sentence.
    """

    def __init__(self, usb, time):
        self._usb = usb
        self._time = time
        self.fault = None  # why the interfaces could not be opened
        self.merger = None  # state of the keyboard, from the first keys of a strip on
        self.by_name = {}
        self.by_kind = {}  # by the kind of actions that they press
        # The values of these two: iterating over a tuple allocates nothing.
        self.opened = self.pressing = ()

    def open(self, wanted):
        """Open the interfaces whose names are in `wanted`; the host reads them once."""
        names = [name for name, _, _ in INTERFACES if name in wanted]
        if self._usb is None or not names:
            return
        try:
            sends = self._usb.open(names)
        except OSError as error:
            self.fault = str(error)
            return
        from ..usb.reports import KeyboardReports, OneKeyReports

        made = {"keyboard": KeyboardReports, "consumer": OneKeyReports, "system": OneKeyReports}
        if "mouse" in sends:
            from ..usb.mouse import MouseReports

            made["mouse"] = MouseReports
        if "gamepad" in sends:
            from ..usb.gamepad import GamepadReports

            made["gamepad"] = GamepadReports
        self.by_name = {name: made[name](send, self._time.ticks) for name, send in sends.items()}
        self.opened = tuple(self.by_name.values())
        self.by_kind = {
            kind: self.by_name[name] for name, _, kind in INTERFACES if kind and name in sends
        }
        self.pressing = tuple(self.by_kind.values())

    def missing(self, wanted):
        """Return why some of the names in `wanted` are not open, and whether a restart opens them.

        The first one is a sentence, or None if all are open.
        """
        missing = " and ".join([name for name in wanted if name not in self.by_name])
        if not missing:
            return None, False
        if self.fault:
            return self.fault, False
        if self._usb is None:
            return "this board has no USB " + missing, False
        return "save and reboot to make the board a USB " + missing, True

    def pump(self):
        """Offer the oldest report of each queue to the host; return True if no report waits.

        Presses that wait for too long are dropped first, see `reports.Outbox`.
        """
        idle = True
        for output in self.opened:
            idle = self._offer(output) and idle
        return idle

    def _offer(self, output):
        # Returns whether no report of the interface `output` waits.
        outbox = output.outbox
        idle = True
        if outbox.count:
            self._time.update()
            dropped = outbox.dropped
            if outbox.expire():
                output.release()
            if outbox.dropped != dropped and self.merger is not None:
                self.merger.drops += 1  # ends a text
            idle = outbox.pump()
        if output.unsent:  # the queue was full
            output.flush()
            idle = False
        return idle

    def release(self):
        """Drop all waiting reports; queue one without pressed keys where the host may see a key."""
        for output in self.opened:
            output.release()

    def is_down(self):
        """Return whether the last accepted report of an interface contains a pressed key."""
        for output in self.opened:  # noqa: SIM110
            if output.outbox.is_down:
                return True
        return False

    def dropped(self):
        """Return the number of reports that were never sent."""
        dropped = 0
        for output in self.opened:
            dropped += output.outbox.dropped
        return dropped


class KeyEvents:
    """The sink of a strip's `keypad.Keypad`: an event becomes a report at once, and a frame later.

    `stuck` is called when a touch has not moved for long. While `releases`, only `Interfaces.pump`
    puts reports into the queues: a command, whose calls nest deeply, may cause a release.
    """

    def __init__(self, sensor, framer, interfaces, stuck):
        self._sensor = sensor
        self._framer = framer
        self._interfaces = interfaces
        self.stuck = stuck
        # Page, 12 bits of usage, 8 of modifiers, and whether it is a press.
        self._events = array("i", bytes(4 * _EVENTS))
        self.waiting = 0
        self.releases = False

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
        """Queue the report of a key event of `merge.Merger`; its frame follows, see `has_room`."""
        if not self.releases:
            self._flush()
        if self.waiting < _EVENTS:
            self._events[self.waiting] = page << 21 | usage << 9 | modifiers << 1 | pressed
            self.waiting += 1

    def has_room(self):
        """Send the frames of the last event; return whether there is room for another event."""
        self.send()
        # Not `all` with a generator, which allocates.
        for output in self._interfaces.opened:  # noqa: SIM110
            if not output.outbox.has_room():
                return False
        return True

    def send(self):
        """Send the frames that wait."""
        i = 0
        while i < self.waiting:
            event = self._events[i]
            self._framer.key(
                self._sensor, event >> 21, event >> 9 & 0xFFF, event >> 1 & 0xFF, event & 1
            )
            i += 1
        self.waiting = 0

    def _flush(self):
        for output in self._interfaces.pressing:
            if output.unsent:
                output.flush()
