"""Two ways to a host, as one: keys and serial port by USB, and by radio."""

from array import array

from .. import const

_BUFFER = const(256)  # of a line by radio, as `command.LINE_MAX`
_NEWLINE = const(10)
_RETURN = const(13)
_IDLE_US = const(1_000_000)  # after which the rest of a line by USB is not expected


class Keys:
    """HID interfaces of the host that is connected: USB before radio, and never both.

    Parameters
    ----------
    usb : object or None
        As `interfaces.Interfaces` takes it. Its attribute ``connected`` is whether a host uses the
        interfaces.
    radio : peripheral.Radio
        Not open yet.

    Attributes
    ----------
    by_radio : bool
        Whether reports go by radio.
    fault : str or None
        Why reports go only by radio although there is USB.
    """

    def __init__(self, usb, radio):
        self._usb, self._radio = usb, radio
        self.by_radio = self._turning = False
        self.fault = None

    def open(self, names):
        """Open the interfaces of both; as ``open`` of a USB stack.

        Raises
        ------
        OSError
            If neither of them has these interfaces.
        """
        by_radio = self._radio.open(names)
        by_usb = {}
        if self._usb is not None:
            try:
                by_usb = self._usb.open(names)
            except OSError as error:
                if not by_radio:
                    raise
                self.fault = "keys go by radio only: %s" % error
        return {
            name: _Way(self, by_usb.get(name), by_radio.get(name)).send
            for name in names
            if name in by_usb or name in by_radio
        }

    def is_heard(self):
        """Return whether a host gets the keys."""
        return self._radio.trusted or (self._usb is not None and self._usb.connected)

    def follow(self, board):
        """Send reports the other way if another host is connected now.

        Before, the keys of the `app.Board` are released, and a host that is still there gets this.
        If the last host is gone and saw no key down, what waits is for the other.
        """
        usb = self._usb is not None and self._usb.connected
        if (self._radio.trusted and not usb) == self.by_radio:
            self._turning = False
            return
        is_there = self._radio.trusted if self.by_radio else usb
        if not self._turning:
            self._turning = True
            if is_there or board.interfaces.is_down():
                board.release_keys()
        if not is_there or board.interfaces.pump():
            self.by_radio = not self.by_radio
            self._turning = False


class _Way:
    def __init__(self, keys, by_usb, by_radio):
        self._keys, self._by_usb, self._by_radio = keys, by_usb, by_radio

    def send(self, report):
        send = self._by_radio if self._keys.by_radio else self._by_usb
        return send is not None and send(report)


class Ports:
    """Serial port of USB and of the radio; frames go to both.

    A line of text comes from one of them as a whole.

    Attributes
    ----------
    by_radio : bool
        Whether the last byte that `read` returned came by radio.
    """

    def __init__(self, serial, radio, clock):
        self._write, self._read, self._radio = serial.write, serial.read, radio
        self._clock = clock
        self._heard = clock.ticks_us()  # time of the last byte by USB
        self._in_line = False  # whether a line by USB has begun
        self._line = bytearray(_BUFFER)
        self._sizes = array("h", (0, 0))  # bytes in `_line`, and of these already returned
        self._returns = False  # whether a line by radio is being returned
        self.by_radio = False

    def write(self, buffer, size):
        """Send a frame; return whether the host that listens got it: the one by radio, if any."""
        sent = self._write(buffer, size)
        return self._radio.write(buffer, size) if self._radio.listens else sent

    def read(self):
        """Return the next byte, or -1."""
        sizes = self._sizes
        if self._returns:
            byte = self._line[sizes[1]]
            sizes[1] += 1
            self.by_radio = True
            if sizes[1] == sizes[0]:
                self._returns = False
                sizes[0] = sizes[1] = 0
            return byte
        byte = self._read()
        if byte >= 0:
            self._in_line = byte != _NEWLINE and byte != _RETURN
            self._heard = self._clock.ticks_us()
            self.by_radio = False
            return byte
        if not self._radio.trusted:
            sizes[0] = 0
            return -1
        if self._in_line:
            now = self._clock.ticks_us()
            self._in_line = self._clock.ticks_diff(now, self._heard) < _IDLE_US
        return self._next_by_radio()

    def _next_by_radio(self):
        sizes = self._sizes
        while not self._is_whole():
            byte = self._radio.read()
            if byte < 0:
                return -1
            self._line[sizes[0]] = byte
            sizes[0] += 1
        if self._in_line:
            return -1
        self._returns = True
        return self.read()

    def _is_whole(self):
        # A line that is too long is passed on in parts, and refused as one by USB is.
        size = self._sizes[0]
        return size == _BUFFER or (size > 0 and self._line[size - 1] in (_NEWLINE, _RETURN))
