"""The USB interfaces of a board, which all of its strips share; sends their reports to the host."""

from ..usb.usages import CONSUMER, KEYBOARD, MOUSE, SYSTEM

# Name of each USB interface, the setting that enables it, and the kind of actions that need it.
INTERFACES = (
    ("keyboard", "keys", KEYBOARD),
    ("consumer", "keys", CONSUMER),
    ("system", "keys", SYSTEM),
    ("mouse", "keys", MOUSE),
    ("gamepad", "gamepad", 0),
)


class Interfaces:
    """Opens the interfaces that the strips need, and offers their reports to the host.

    Parameters
    ----------
    usb : object or None
        USB stack. Its method ``open(names) -> dict`` opens interfaces of `INTERFACES` and returns
        a function ``send(report) -> bool`` for each opened interface; on failure it raises OSError
        with a sentence. `usb` is None on a board without USB HID.
    time : frame.Time32
        Board time.

    Attributes
    ----------
    fault : str or None
        Sentence that says why the interfaces could not be opened at start, or None.
    merger : merge.Merger or None
        State of the keyboard; None until a strip has keys.
    by_name, by_kind : dict
        Opened interfaces by name, and by the kind of actions that they press.
    opened, pressing : tuple
        Values of these dicts: iterating over a tuple allocates nothing.
    """

    def __init__(self, usb, time):
        self._usb = usb
        self._time = time
        self.fault = self.merger = None
        self.by_name = {}
        self.by_kind = {}
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
        """Find what is not open of the names in `wanted`.

        Returns
        -------
        str or None
            Sentence that says why; None if all are open.
        bool
            Whether a restart opens them.
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
