"""HID reports of keyboard, media keys and system keys, and a queue of reports to the host.

The queue works with any USB stack that has a function ``send(report) -> bool``. The function must
not wait; it returns True if the stack has accepted the report. Integers only; allocates nothing
after construction.

A host that sleeps takes no reports. A key that is typed meanwhile must not be delivered when the
host wakes, for example into the password field of a lock screen. So a press that waits for more
than 0.5 s is dropped. A release never becomes stale.
"""

from array import array

from .. import const
from .descriptors import ONE_KEY_SIZE, REPORT_SIZE
from .usages import KEYS_MAX, MODIFIERS_FROM

WAITING_MAX = 16  # eight quick presses with their releases
_ROOM = const(10)  # most reports in a queue that has room for those of one event, at most six
_STALE = 488  # age in ticks of 1024 us: 0.5 s
_TICKS_MASK = 0x3FFFFF  # ticks have 22 bits, see `frame.Time32.ticks`


class Outbox:
    """First-in first-out queue of reports; no report that USB has accepted is sent again.

    A full queue refuses reports, and the engine of the keys waits. After `release`, one report
    without pressed keys is sent if the host may see a pressed key. ``send(report)`` offers `size`
    bytes to the USB stack without waiting, and returns whether the stack accepted them; ``ticks()``
    is that of `frame.Time32`. `dropped` counts reports that were never sent;
    `is_down` is whether the last report that USB has accepted contains a pressed key.
    """

    def __init__(self, send, ticks, size=REPORT_SIZE):
        self._send = send
        self._ticks = ticks
        self._size = size
        self._waiting = [bytearray(size) for _ in range(WAITING_MAX)]
        self._since = array("i", bytes(4 * WAITING_MAX))  # ticks of each report's `put`
        self._first = self.count = 0
        # Set before a report is sent, so that an exception during the call cannot hide a key press.
        self._maybe_down = self.is_down = False
        self.dropped = 0

    def newest(self):
        """Return the newest report in the queue, or None if the queue is empty.

        The caller may modify the report.
        """
        if self.count == 0:
            return None
        return self._waiting[(self._first + self.count - 1) % WAITING_MAX]

    def put(self, report):
        """Add a copy of a report to the queue; return False if the queue is full."""
        if self.count == WAITING_MAX:
            return False
        self._append(report)
        return True

    def has_room(self):
        """Return whether the queue has room for all reports of one key event."""
        return self.count <= _ROOM

    def release(self):
        """Drop all queued reports; if the host may see a pressed key, queue a release report."""
        self.dropped += self.count
        self.count = 0
        if self._maybe_down:
            self._append(None)

    def expire(self):
        """Drop presses that have waited for more than 0.5 s, with their releases.

        Return whether such a key is still pressed: the caller then calls `release` of the object
        that puts the reports.
        """
        now = self._ticks()
        i = 0
        while i < self.count:
            at = (self._first + i) % WAITING_MAX
            if is_pressed(self._waiting[at]):
                age = now - self._since[at] & _TICKS_MASK
                # A negative age is less than the rounding error of a sample's time.
                if age <= _STALE or age > _TICKS_MASK >> 1:
                    return False
                while is_pressed(self._waiting[(self._first + i) % WAITING_MAX]):
                    i += 1
                    if i == self.count:
                        return True
                self._first = (self._first + i) % WAITING_MAX
                self.count -= i
                self.dropped += i
                i = 0
            i += 1
        return False

    def pump(self):
        """Offer the oldest report to the USB stack once; return True if the queue is empty."""
        if self.count:
            report = self._waiting[self._first]
            down = is_pressed(report)
            if down:
                self._maybe_down = True
            if self._send(report):
                self._first = (self._first + 1) % WAITING_MAX
                self.count -= 1
                self._maybe_down = self.is_down = down
        return self.count == 0

    def _append(self, report):
        at = (self._first + self.count) % WAITING_MAX
        self._since[at] = self._ticks()
        waiting = self._waiting[at]
        for i in range(self._size):
            waiting[i] = report[i] if report is not None else 0
        self.count += 1


def is_pressed(report):
    """Return whether a report contains a pressed key or a moved axis; allocates nothing."""
    bits = 0
    for i in range(len(report)):
        bits |= report[i]
    return bits != 0


class KeyboardReports:
    """Turns presses and releases of single usages into reports.

    What changes before a key is pressed, such as a modifier or the release of another key, is a
    report before that of the key: a program that sees both at once may take the key first.
    `merge.Merger` makes the events. Call `flush` while `unsent`: the queue lacks the last change.
    """

    def __init__(self, send, ticks):
        self.outbox = Outbox(send, ticks)
        self.unsent = False
        self._report = bytearray(REPORT_SIZE)

    def key(self, usage, modifiers, pressed):
        """Process a key event; the caller then calls `flush`.

        `usage` is 1 to 0xDD for a key, 0xE0 to 0xE7 for a modifier key; `modifiers` are those that
        are down after the event.
        """
        report = self._report
        if report[0] != modifiers:
            report[0] = modifiers
            self.unsent = True
        if usage >= MODIFIERS_FROM:
            return
        at = self._find(usage)
        if pressed == (at >= 0):
            return
        if pressed:
            self.flush()
            at = self._find(0)
            if at < 0:
                return
        report[2 + at] = usage if pressed else 0
        self.unsent = True

    def flush(self):
        """Put the changes into the queue as a report. If the queue is full, they stay `unsent`."""
        if self.unsent and self.outbox.put(self._report):
            self.unsent = False

    def release(self):
        """Release all keys."""
        for i in range(REPORT_SIZE):
            self._report[i] = 0
        self.unsent = False
        self.outbox.release()

    def _find(self, usage):
        for i in range(KEYS_MAX):
            if self._report[2 + i] == usage:
                return i
        return -1


class OneKeyReports:
    """Turns each press and release of a media key or of a system key into a report.

    A report contains one usage: that of the last pressed key, or 0 after its release. Parameters
    and attributes are those of `KeyboardReports`.
    """

    def __init__(self, send, ticks):
        self.outbox = Outbox(send, ticks, ONE_KEY_SIZE)
        self.unsent = False
        self._report = bytearray(ONE_KEY_SIZE)

    def key(self, usage, modifiers, pressed):
        """Process the press (`pressed` is true) or release of a key; `modifiers` are ignored."""
        report = self._report
        if not pressed and report[0] | report[1] << 8 != usage:
            return
        if self.unsent:
            self.flush()
        report[0] = usage & 0xFF if pressed else 0
        report[1] = usage >> 8 if pressed else 0
        self.unsent = True

    def flush(self):
        """Put the change into the queue. If the queue is full, it stays `unsent`."""
        if self.unsent and self.outbox.put(self._report):
            self.unsent = False

    def release(self):
        """Release the pressed key."""
        self._report[0] = self._report[1] = 0
        self.unsent = False
        self.outbox.release()
