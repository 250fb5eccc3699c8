"""HID reports of keyboard, media keys, system keys and gamepad, and a queue of reports to the host.

The queue works with any USB stack that has a function ``send(report) -> bool``. The function must
not wait; it returns True if the stack has accepted the report. Integers only; allocates nothing
after construction.

A host that sleeps takes no reports. A key that is typed meanwhile must not be delivered when the
host wakes, for example into the password field of a lock screen. So a press that waits for more
than 0.5 s is dropped. A release never becomes stale.
"""

from array import array
from struct import pack_into

from .. import const
from .merge import KEYS_MAX

REPORT_SIZE = 8
CAPS_LOCK = 2  # bit of caps lock in a keyboard's output report; HID usage tables, LED page
_MODIFIERS_FROM = 0xE0  # usages from here on are bits of the first byte
ONE_KEY_SIZE = 2
WAITING_MAX = 16  # eight quick presses with their releases
_ROOM = const(10)  # most reports in a queue that has room for those of one event, at most six
_STALE = 488  # age in ticks of 1024 us: 0.5 s
_TICKS_MASK = 0x3FFFFF  # ticks have 22 bits, see `frame.Time32.ticks`

# Boot keyboard, USB HID 1.11, appendices B.1 and E.6: modifiers, a byte that is 0, six usages.
KEYBOARD_DESCRIPTOR = (
    b"\x05\x01\x09\x06\xa1\x01"  # generic desktop, keyboard, application
    b"\x05\x07\x19\xe0\x29\xe7\x15\x00\x25\x01\x75\x01\x95\x08\x81\x02"  # eight modifiers
    b"\x75\x08\x95\x01\x81\x01"  # a byte that is 0
    b"\x05\x08\x19\x01\x29\x05\x75\x01\x95\x05\x91\x02\x75\x03\x95\x01\x91\x01"  # LEDs, from host
    b"\x05\x07\x19\x00\x29\xdd\x15\x00\x26\xdd\x00\x75\x08\x95\x06\x81\x00"  # six usages
    b"\xc0"
)
# One key at a time, such as volume or play, by its usage; 0 means no key.
CONSUMER_DESCRIPTOR = (
    b"\x05\x0c\x09\x01\xa1\x01"  # consumer, consumer control, application
    b"\x15\x00\x26\xff\x03\x19\x00\x2a\xff\x03\x75\x10\x95\x01\x81\x00"  # 16 bits
    b"\xc0"
)
# Power down, sleep and wake up, one at a time; a value below the range means no key.
SYSTEM_DESCRIPTOR = (
    b"\x05\x01\x09\x80\xa1\x01"  # generic desktop, system control, application
    b"\x16\x81\x00\x26\x83\x00\x19\x81\x29\x83\x75\x10\x95\x01\x81\x40"  # 16 bits
    b"\xc0"
)
# X and Y, -32767 to 32767; Z, 0 to 32767; 16 buttons.
GAMEPAD_DESCRIPTOR = (
    b"\x05\x01\x09\x05\xa1\x01"  # generic desktop, gamepad, application
    b"\x09\x30\x09\x31\x16\x01\x80\x26\xff\x7f\x75\x10\x95\x02\x81\x02"  # X, Y
    b"\x09\x32\x15\x00\x26\xff\x7f\x75\x10\x95\x01\x81\x02"  # Z
    b"\x05\x09\x19\x01\x29\x10\x15\x00\x25\x01\x75\x01\x95\x10\x81\x02"  # buttons 1 to 16
    b"\xc0"
)
# For each name of an interface, its report descriptor and the size of a report; those of the mouse
# are in mouse.py.
REPORTS = {
    "keyboard": (KEYBOARD_DESCRIPTOR, REPORT_SIZE),
    "consumer": (CONSUMER_DESCRIPTOR, ONE_KEY_SIZE),
    "system": (SYSTEM_DESCRIPTOR, ONE_KEY_SIZE),
    "gamepad": (GAMEPAD_DESCRIPTOR, REPORT_SIZE),
}
_GAMEPAD = "<hhhH"
_BUTTONS = 6  # offset of the buttons in a report


def with_report_id(descriptor, report_id):
    """Return a report descriptor with a report id (1 to 255), for a shared endpoint."""
    return descriptor[:6] + bytes((0x85, report_id)) + descriptor[6:]


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
        if usage >= _MODIFIERS_FROM:
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


class GamepadReports:
    """Turns axes and buttons of a gamepad into reports.

    Each change of a button gets its own report. Changes of axes that still wait in the queue are
    merged into one report.
    """

    unsent = False  # `update` sends each change itself

    def __init__(self, send, ticks):
        self.outbox = Outbox(send, ticks)
        self._report = bytearray(REPORT_SIZE)
        self._last = bytearray(REPORT_SIZE)

    def update(self, x, y, z, buttons):
        """Set the axes x and y (-32767 to 32767) and z (0 to 32767), and 16 bits of buttons."""
        report, last = self._report, self._last
        pack_into(_GAMEPAD, report, 0, x, y, z, buttons)
        if _same(report, last, 0):
            return
        newest = self.outbox.newest()
        if newest is not None and _same(report, newest, _BUTTONS):
            _copy(report, newest)
        elif not self.outbox.put(report):
            return  # the next reading tries again
        _copy(report, last)

    def release(self):
        """Release all buttons and centre all axes."""
        for i in range(REPORT_SIZE):
            self._last[i] = 0
        self.outbox.release()


def _same(one, other, start):
    bits = 0
    for i in range(start, REPORT_SIZE):
        bits |= one[i] ^ other[i]
    return bits == 0


def _copy(source, target):
    for i in range(REPORT_SIZE):
        target[i] = source[i]
