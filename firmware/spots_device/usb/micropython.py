"""USB HID interfaces beside MicroPython's serial port, on `machine.USBDevice`.

Sources: USB 2.0 specification, chapter 9; Device Class Definition for HID 1.11 ("HID 1.11");
MicroPython's documentation of `machine.USBDevice`.

The USB stack stores an accepted report until the host fetches it, even while the host sleeps, and
MicroPython does not know whether the host sleeps. A key that is typed meanwhile must not be
delivered when the host wakes. So a report with a pressed key is only sent to a host that has just
fetched another report. If there is none, the last report is sent again first: it changes nothing,
so it may wait for the host. A press that finds no such host asks it to wake up.
"""

import struct
from time import sleep_us, ticks_add, ticks_diff, ticks_us

from machine import USBDevice

from .. import const
from ..runtime.modules import drop
from .descriptors import STATE_SIZE
from .reports import is_pressed

_NO_BOOT = const(0)  # boot protocols of an interface, HID 1.11, section 4.3
_BOOT_KEYBOARD = const(1)
_IN = const(0x80)  # direction of an endpoint, as a part of its address
_INTERVAL_MS = const(1)  # between two polls of an endpoint by the host
_PACKET = const(8)  # largest size of a report in bytes
_HID = const(0x21)  # types of descriptors, HID 1.11, section 7.1
_REPORT = const(0x22)
_REPORT_PROTOCOL = b"\x01"  # the host's choice after a connection, HID 1.11, section 7.2.6
_INPUT = const(1)  # types of reports, HID 1.11, section 7.2.1
_WAKE = "remote_wakeup"  # method of `USBDevice` since MicroPython 1.24
_CAN_WAKE = const(0x20)  # bit of a configuration's bmAttributes, USB 2.0, section 9.6.3

# Stages of a control transfer.
_SETUP = const(1)
_ACK = const(3)
# bmRequestType << 8 | bRequest, HID 1.11, sections 7.1 and 7.2.
_GET_DESCRIPTOR = const(0x8106)
_GET_REPORT = const(0xA101)
_GET_IDLE = const(0xA102)
_GET_PROTOCOL = const(0xA103)
_SET_REPORT = const(0x2109)
_SET_IDLE = const(0x210A)
_SET_PROTOCOL = const(0x210B)

# A host is awake for this time after the start of a report that it has fetched.
_AWAKE_US = const(20_000)
_FETCH_US = const(3_000)  # longest wait for the host to fetch the repeated report
_STEP_US = const(100)


class _Interface:
    """An interface of one endpoint, from which the host fetches reports.

    The device's callbacks set the attributes; they run between two bytecodes of the main program.
    """

    def __init__(self, device, number, endpoint, kind, receive):
        self._device = device
        self._receive = receive
        self._descriptor, size, boot = kind
        self.state_size = size  # other bytes of a report are movements
        self.number = number
        self.endpoint = endpoint
        self.is_open = self.is_busy = False
        # The USB stack reads this buffer until the host has the report.
        self._report = bytearray(size)
        self._received = bytearray(1)  # the host's last output or feature report
        self._idle = bytearray(1)  # stored for the host only: an unchanged report is not repeated
        self._protocol = bytearray(_REPORT_PROTOCOL)
        self._offered = ticks_add(ticks_us(), -_AWAKE_US)
        self._since = self._offered  # of the report that the stack has
        self._hid = struct.pack("<BBHBBBH", 9, _HID, 0x0111, 0, 1, _REPORT, len(self._descriptor))
        self.descriptors = (
            bytes((9, 4, number, 0, 1, 3, 1 if boot else 0, boot, 0))
            + self._hid
            + struct.pack("<BBBBHB", 7, 5, endpoint, 3, _PACKET, _INTERVAL_MS)
        )

    def close(self):
        """Forget the transfers, which a reset of the bus has ended."""
        self.is_open = self.is_busy = False

    def open(self):
        """Expect reports: the host has chosen the configuration."""
        self.is_open = True
        self.is_busy = False
        self._protocol[:] = _REPORT_PROTOCOL
        if self.state_size < len(self._report):
            self._received[0] = 0  # another host may not know the multipliers of a mouse
            self._receive(0)

    def answer(self, request, value):
        """Return the answer to a control request: a buffer to send or to fill, True or False."""
        if request == _GET_DESCRIPTOR:
            kind = value >> 8
            return self._descriptor if kind == _REPORT else self._hid if kind == _HID else False
        if request == _GET_REPORT:
            return self._report if value >> 8 == _INPUT else self._received
        if request == _SET_REPORT:  # hosts set LEDs, and some cannot handle a refusal
            return self._received
        if request == _GET_IDLE:
            return self._idle
        if request == _GET_PROTOCOL:
            return self._protocol
        return request in (_SET_IDLE, _SET_PROTOCOL)

    def complete(self, request, value):
        """Carry out a control request, whose data have arrived."""
        if request == _SET_REPORT:
            self._receive(self._received[0])
        elif request == _SET_IDLE:
            self._idle[0] = value >> 8
        elif request == _SET_PROTOCOL:  # the boot report of the keyboard is its report
            self._protocol[0] = value & 1

    def send(self, report):
        """Offer a report to the USB stack; return whether it was accepted.

        Waits for 3 ms at most, and only before the first press after a pause.
        """
        now = ticks_us()
        if not self.is_open:
            return False
        if is_pressed(report):
            if not self._is_host_awake(now):
                return False
        elif self.is_busy:
            return False
        for i in range(len(report)):
            self._report[i] = report[i]
        return self._offer()

    def fetched(self):
        """Forget the movements of the report, which the host has fetched."""
        self.is_busy = False
        for i in range(self.state_size, len(self._report)):
            self._report[i] = 0

    def is_there(self):
        """Return whether a host uses this interface: it has fetched the last report, or may yet."""
        return self.is_open and not (
            self.is_busy and ticks_diff(ticks_us(), self._since) > _AWAKE_US
        )

    def _is_host_awake(self, began):
        if 0 <= ticks_diff(began, self._offered) < _AWAKE_US:
            return not self.is_busy
        if self.is_busy:  # for long
            self._offered = began  # of this request
            self._wake()
            return False
        if not self._offer():
            return False
        while self.is_busy:
            if ticks_diff(ticks_us(), began) >= _FETCH_US:
                self._wake()
                return False
            sleep_us(_STEP_US)
        return self.is_open

    def _wake(self):
        # Has an effect only if the host sleeps and has allowed it.
        if hasattr(self._device, _WAKE):
            self._device.remote_wakeup()

    def _offer(self):
        self._offered = self._since = ticks_us()
        self.is_busy = True  # first: the host may have the report before the call returns
        try:
            if self._device.submit_xfer(self.endpoint, self._report):
                return True
        except OSError:  # disconnected since the last callback
            pass
        self.is_busy = False
        return False


_open = []  # the interfaces of this board


def connected():
    """Return whether a computer uses the open interfaces."""
    for one in _open:
        if not one.is_there():
            return False
    return bool(_open)


class _Callbacks:
    """Distributes the callbacks of the USB device among its interfaces."""

    def __init__(self, interfaces):
        self._interfaces = interfaces

    def opened(self, descriptors):
        for one in self._interfaces:
            if one.number == descriptors[2]:
                one.open()

    def reset(self):
        for one in self._interfaces:
            one.close()

    def control(self, stage, packet):
        request = packet[0] << 8 | packet[1]
        value = packet[2] | packet[3] << 8
        for one in self._interfaces:
            if one.number == packet[4]:
                if stage == _SETUP:
                    return one.answer(request, value)
                if stage == _ACK:
                    one.complete(request, value)
                return True
        return False

    def transferred(self, endpoint, result, size):
        for one in self._interfaces:
            if one.endpoint == endpoint:
                one.fetched()
        return True


def open_interfaces(names, show_leds):
    """Open HID interfaces; return ``send(report) -> bool`` for the name of each.

    USB disconnects and connects again. ``show_leds(leds)`` shows the keyboard LEDs as the host has
    set them; bit 1 is caps lock.
    """
    from . import descriptors

    device = USBDevice()
    # Without the built-in driver there would be no serial port, and no prompt.
    serial = USBDevice.BUILTIN_DEFAULT
    interfaces = []
    configuration = bytearray(serial.desc_cfg)
    for i in range(len(names)):
        number, endpoint = serial.itf_max + i, serial.ep_max + i | _IN
        kind = descriptors.REPORTS[names[i]]
        if names[i] == "mouse":
            from .mouse import set_multipliers

            one = _Interface(device, number, endpoint, kind + (_NO_BOOT,), set_multipliers)
            one.state_size = STATE_SIZE
        else:
            boot = _BOOT_KEYBOARD if names[i] == "keyboard" else _NO_BOOT
            one = _Interface(device, number, endpoint, kind + (boot,), show_leds)
        interfaces.append(one)
        configuration += one.descriptors
    drop(descriptors)
    # wTotalLength and bNumInterfaces, USB 2.0, section 9.6.3
    configuration[2] = len(configuration) & 0xFF
    configuration[3] = len(configuration) >> 8
    configuration[4] = serial.itf_max + len(names)
    if hasattr(device, _WAKE):
        configuration[7] |= _CAN_WAKE
    callbacks = _Callbacks(interfaces)
    device.active(False)
    device.builtin_driver = serial
    device.config(
        serial.desc_dev,
        configuration,
        None,  # the built-in texts
        callbacks.opened,
        callbacks.reset,
        callbacks.control,
        callbacks.transferred,
    )
    device.active(True)
    _open.extend(interfaces)
    return {name: one.send for name, one in zip(names, interfaces)}
