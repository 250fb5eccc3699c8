"""The board as a Bluetooth LE peripheral: one host, bonded, gets keys and frames.

What a strip says is what somebody types. So nothing is sent to a connection before it is encrypted
by the keys of a bond, and a bond is made only in the minute after `Radio.pair`.

The stack calls the event handler from a task of its own, between any two bytecodes: it stores
numbers in an array, and secrets in `bonds.Bonds`. The loop does the rest in `Radio.work`.
"""

import os
from array import array

from .. import const
from . import services
from .bonds import HOSTS_MAX, Bonds

_CONNECTED, _DISCONNECTED, _WRITTEN = const(1), const(2), const(3)
_MTU_CHANGED, _ENCRYPTED, _GET_SECRET, _SET_SECRET = const(21), const(28), const(29), const(30)
_PASSKEY = const(31)
_SHOW = const(3)  # action of a passkey: this device shows it

# Numbers in the handler's array.
_CONN = const(0)  # handle of the connection, or -1
_COUNT = const(1)  # connections since the start
_SAFE = const(2)  # whether it is encrypted: 1, or `_PROTECTED`
_MTU = const(3)  # bytes of a notification and three
_ASKED = const(4)  # whether the stack wants the passkey
_LEDS = const(5)  # whether the host wrote for the keyboard, mouse, or serial port
_MULTIPLIERS = const(6)
_DATA = const(7)

_PROTECTED = const(2)  # encrypted by keys that a passkey protected

_LEAST_MTU = const(23)
_MTU_WANTED = const(247)
_HEADER = const(3)  # bytes of a notification before its data
_WAITING_MAX = const(2048)  # bytes of frames that wait for the stack; more than the longest frame
_GROUPED_US, _FULL_US = const(10_000), const(50_000)
_ADVERTISED_US = const(30_000)  # between two advertisements
_WINDOW_US = const(60_000_000)  # in which a new bond can be made
_SETTLES_US = const(2_000_000)  # after the first secret of a new bond
_TRUST_US = const(20_000_000)  # after which a connection without a bond ends
_FAILED = const(5)  # reason of a disconnection: authentication
_DIGITS = const(1_000_000)
_DISPLAY_ONLY, _NO_DISPLAY = const(0), const(3)


class Radio:
    """A host by radio, in place of USB: keys by `open`, a serial port by `write` and `read`.

    Parameters
    ----------
    ble : bluetooth.BLE
        The stack of the runtime, not active yet.
    uuid : callable
        ``bluetooth.UUID``.
    uid : str
        Unique id of the board; its end is the end of the board's name.
    use : str
        ``"hid"``, ``"data"`` or ``"both"``.
    clock : object
        ``ticks_us``, ``ticks_add`` and ``ticks_diff`` as in MicroPython's ``time``.
    lines : list of str
        Stored bonds.
    show_leds, set_multipliers : callable
        Take what the host writes for the keyboard and for the mouse.

    Attributes
    ----------
    trusted : bool
        Whether a bonded host is connected, and the connection is encrypted.
    listens : bool
        Whether this host has sent bytes to the serial port, so that it gets frames.
    opened : bool
        Whether `open` was called.
    fault : str or None
        Why the radio is off although it was opened.
    """

    def __init__(self, ble, uuid, uid, use, clock, lines, show_leds, set_multipliers):
        self.name = "SPOTS " + uid[-4:]
        self.bonds = Bonds(lines)
        self.trusted = self.listens = False
        self.opened = False
        self.fault = None
        self._ble, self._uuid, self._clock = ble, uuid, clock
        self._use = use
        self._show_leds, self._set_multipliers = show_leds, set_multipliers
        self._state = array("i", bytes(4 * (_DATA + 1)))
        self._state[_CONN] = -1
        self._number = 0  # of the connection that `work` knows
        self._since = self._until = None  # ticks: start of the connection, end of the window
        self._passkey = -1
        self._received = b""
        self._at = 0
        self._waiting = memoryview(bytearray(_WAITING_MAX))
        self._first = self._end = 0  # of the bytes that wait
        self._next = clock.ticks_us()  # when to send what waits
        self._handles = None

    def open(self, names):
        """Start the radio; as ``open`` of a USB stack, see `interfaces.Interfaces`.

        Without HID in the setting, no interface is opened.
        """
        if self._use == "data":
            names = []
        ble = self._ble
        ble.irq(self._handle)
        self.opened = True
        try:
            ble.active(True)
        except OSError as error:
            self.fault = "the radio cannot be switched on: %s" % error
            return {}
        ble.config(gap_name=self.name, mtu=_MTU_WANTED, bond=True, le_secure=True)
        self._protect(True)
        data = self._use != "hid"
        self._handles = services.register(ble, self._uuid, names, data)
        self._payload, self._answer = services.advertisement(self.name, bool(names), data)
        self._advertise()
        return {name: _Report(self, self._handles.reports[name]).send for name in names}

    def _handle(self, event, data):
        # In the stack's task. The buffers in `data` are valid only during the call.
        s = self._state
        if event == _GET_SECRET:
            return self.bonds.get(data[0], data[1], data[2])
        if event == _SET_SECRET:
            if data[2] is None:
                return self.bonds.drop(data[0], data[1])
            return self.bonds.put(data[0], data[1], data[2])
        if event == _CONNECTED:
            s[_CONN] = data[0]
            s[_COUNT] += 1
            s[_SAFE] = s[_ASKED] = s[_LEDS] = s[_MULTIPLIERS] = s[_DATA] = 0
            s[_MTU] = _LEAST_MTU
            self.bonds.begin()
        elif data[0] != s[_CONN]:
            return None
        elif event == _WRITTEN:
            if data[1] == self._handles.to_board:
                s[_DATA] = 1
            elif data[1] == self._handles.leds:
                s[_LEDS] = 1
            elif data[1] == self._handles.multipliers:
                s[_MULTIPLIERS] = 1
        elif event == _DISCONNECTED:
            self.trusted = self.listens = False
            s[_CONN] = -1
        elif event == _MTU_CHANGED:
            s[_MTU] = data[1]
        elif event == _ENCRYPTED:
            s[_SAFE] = (_PROTECTED if data[2] else 1) if data[1] else 0
        elif event == _PASSKEY and data[1] == _SHOW:
            s[_ASKED] = 1
        return None

    def work(self):
        """Do what the events of the stack ask for; call it in each pass of the loop.

        Returns
        -------
        str or None
            ``"changed"`` if a host has come or gone, so that all keys must be released; ``"bonds"``
            if the bonds must also be stored.
        """
        if self.fault:
            return None
        s = self._state
        now = self._clock.ticks_us()
        if self._until is not None and self._clock.ticks_diff(self._until, now) <= 0:
            self._until = None
            self._protect(True)
        if s[_COUNT] != self._number or (self._since is not None and s[_CONN] < 0):
            return self._renew(now)
        if s[_CONN] < 0:
            return None
        if s[_ASKED]:
            s[_ASKED] = 0
            if self._until is not None:
                self._ble.gap_passkey(s[_CONN], _SHOW, self._passkey)
        if not self.trusted or self.bonds.paired:
            return self._judge(now)
        if s[_LEDS]:
            s[_LEDS] = 0
            self._take(self._show_leds, self._handles.leds)
        if s[_MULTIPLIERS]:
            s[_MULTIPLIERS] = 0
            self._take(self._set_multipliers, self._handles.multipliers)
        return None

    def _take(self, show, handle):
        # A host can write nothing, or too much.
        for byte in self._ble.gatts_read(handle)[:1]:
            show(byte)

    def _renew(self, now):
        # A connection has begun, or ended, or both.
        s = self._state
        self._number = s[_COUNT]
        self.trusted = self.listens = False
        self._received, self._at = b"", 0
        self._first = self._end = 0
        self.bonds.restore()
        if self._handles.to_board >= 0:
            self._ble.gatts_read(self._handles.to_board)  # bytes of a host that was not trusted
        if s[_CONN] < 0:
            self._since = None
            self._advertise()
        else:
            self._since = now
        return "changed"

    def _judge(self, now):
        # Whether this connection is that of a host that may have keys and frames.
        s = self._state
        bonds = self.bonds
        if bonds.paired and s[_SAFE]:
            if self._until is None or s[_SAFE] < self._least:
                self._refuse()
                return None
            # The stack stores the secrets of a bond one by one, so the window stays open for more.
            if not self.trusted:
                self._until = self._clock.ticks_add(now, _SETTLES_US)
            bonds.paired = False
            bonds.keep()
            self.trusted = True
            return "bonds"
        if bonds.served and s[_SAFE]:
            self.trusted = True
            return "changed"
        if self._clock.ticks_diff(now, self._since) > _TRUST_US and self._until is None:
            self._refuse()
        return None

    def _refuse(self):
        self.trusted = self.listens = False
        self.bonds.restore()
        self._since = self._clock.ticks_us()  # the next try, if the stack does not hear this one
        self._ble.gap_disconnect(self._state[_CONN])

    def _advertise(self):
        self._ble.gap_advertise(_ADVERTISED_US, self._payload, resp_data=self._answer)

    @property
    def pairs(self):
        """Whether a host can bond now."""
        return self._until is not None

    def pair(self, protected=True):
        """Let one host bond within 60 s; return the passkey that it must show (int).

        If not `protected`, it needs no passkey: a man in the middle could be the host.

        Raises
        ------
        ValueError
            If no more hosts can be bonded.
        """
        if len(self.bonds.hosts()) >= HOSTS_MAX:
            raise ValueError(
                "%d hosts are bonded, and the radio keeps no more: 'radio forget' one" % HOSTS_MAX
            )
        self._protect(protected)
        self._passkey = int.from_bytes(os.urandom(3), "little") % _DIGITS
        self._until = self._clock.ticks_add(self._clock.ticks_us(), _WINDOW_US)
        return self._passkey

    def _protect(self, on):
        # `on`: only with a passkey.
        self._least = _PROTECTED if on else 1
        self._ble.config(mitm=on, io=_DISPLAY_ONLY if on else _NO_DISPLAY)

    def forget(self, address):
        """Delete the bond with a host, and end its connection; return whether there was one."""
        if not self.bonds.forget(address):
            return False
        if self._state[_CONN] >= 0:
            self._ble.gap_disconnect(self._state[_CONN])
        return True

    def write(self, buffer, size):
        """Let a frame of `size` bytes wait for `flush`; return whether there was room."""
        if not self._is_same():
            return False
        left = self._end - self._first
        if self._end + size > _WAITING_MAX:
            if left + size > _WAITING_MAX:
                return False
            self._waiting[:left] = bytes(self._waiting[self._first : self._end])
            self._first, self._end = 0, left
        self._waiting[self._end : self._end + size] = buffer[:size]
        self._end += size
        self.flush()
        return True

    @property
    def waits(self):
        """Whether frames wait for `flush`."""
        return self._first < self._end

    def flush(self):
        """Send frames that wait, as far as the stack takes them.

        A notification that is not full waits for 10 ms, and all wait for 50 ms after the stack had
        no memory left: without memory, it also refuses what the host writes.
        """
        room = self._state[_MTU] - _HEADER
        now = self._clock.ticks_us()
        left_us = self._clock.ticks_diff(self._next, now)
        if left_us < 0:
            left_us = 0
            self._next = now  # before the ticks wrap
        while self._first < self._end and left_us <= _GROUPED_US:
            end = min(self._end, self._first + room)
            if left_us and end - self._first < room:
                return
            left_us = _GROUPED_US
            if self.notify(self._handles.to_host, self._waiting[self._first : end]):
                self._first = end
            else:
                left_us = _FULL_US
            self._next = self._clock.ticks_add(now, left_us)
        if self._first == self._end:
            self._first = self._end = 0

    def read(self):
        """Return the next byte that a trusted host has written, or -1."""
        if self._at == len(self._received):
            if not self._state[_DATA] or not self.trusted:
                return -1
            self._state[_DATA] = 0
            self.listens = True
            self._at = 0
            self._received = self._ble.gatts_read(self._handles.to_board)
            if not self._received:
                return -1
        self._at += 1
        return self._received[self._at - 1]

    def notify(self, handle, report):
        """Send a report to a trusted host; return whether the stack took it."""
        if not self._is_same():
            return False
        try:
            self._ble.gatts_notify(self._state[_CONN], handle, report)
            return True
        except OSError:
            return False

    def _is_same(self):
        # Whether the connection is still that of the trusted host: an event can come at any time.
        s = self._state
        return self.trusted and s[_SAFE] and s[_COUNT] == self._number

    def close(self):
        """Switch the radio off."""
        self.trusted = self.listens = False
        self._ble.active(False)


class _Report:
    def __init__(self, radio, handle):
        self._radio, self._handle = radio, handle

    def send(self, report):
        return self._radio.notify(self._handle, report)
