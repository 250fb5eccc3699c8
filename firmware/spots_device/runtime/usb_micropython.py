"""USB reports through MicroPython's usb-device-hid, which has to be on the board."""

import usb.device
from micropython import const
from usb.device.hid import HIDInterface

from ..hid import (
    CONSUMER_DESCRIPTOR,
    CONSUMER_SIZE,
    GAMEPAD_DESCRIPTOR,
    KEYBOARD_DESCRIPTOR,
    REPORT_SIZE,
)

_NONE = const(0)  # protocols of an interface, HID 1.11, section 4.3
_KEYBOARD = const(1)
_SETUP = const(1)  # stage of a control transfer
_GET_REPORT = (0xA1, 1)  # bmRequestType, bRequest
_INTERVAL_MS = const(1)  # between two polls of an endpoint by the host

_INTERFACES = {
    "keyboard": (KEYBOARD_DESCRIPTOR, REPORT_SIZE, _KEYBOARD),
    "consumer": (CONSUMER_DESCRIPTOR, CONSUMER_SIZE, _NONE),
    "gamepad": (GAMEPAD_DESCRIPTOR, REPORT_SIZE, _NONE),
}


class _Reports(HIDInterface):
    def __init__(self, show_leds, descriptor, size, protocol):
        # Hosts set the LEDs of a keyboard; a refusal of that may upset them.
        super().__init__(descriptor, set_report_buf=bytearray(1), protocol=protocol)
        self._show_leds = show_leds
        self._described_as = protocol
        # The stack reads it until the host has it.
        self._report = bytearray(size)

    def desc_cfg(self, desc, itf_num, ep_num, strs):
        # Called twice, and the library then stores the active protocol in this attribute: the
        # second time every interface would be described as one of a boot keyboard.
        self.protocol = self._described_as
        super().desc_cfg(desc, itf_num, ep_num, strs)
        # bInterval is the last byte of the endpoint descriptor, which is the last one. Versions
        # before 0.2 of the library know no other way; the first call has no buffer to write to.
        if desc.b:
            desc.b[desc.o - 1] = _INTERVAL_MS

    def on_interface_control_xfer(self, stage, request):
        if stage == _SETUP and (request[0], request[1]) == _GET_REPORT:
            return self._report  # the library prints at this, into the frames
        return super().on_interface_control_xfer(stage, request)

    def on_set_report(self, report_data, report_id, report_type):
        self._show_leds(report_data[0])
        return True

    def send(self, report):
        """Offer a report to the stack; return whether it was taken. Never blocks."""
        if not self.is_open() or self.busy():
            return False
        for i in range(len(report)):
            self._report[i] = report[i]
        try:
            return self.send_report(self._report, 0)
        except (OSError, RuntimeError):  # disconnected since `is_open`
            return False


def open_interfaces(names, show_leds):
    """Make the board a USB device with these interfaces; return what sends reports, by name.

    ``show_leds(leds)`` gets the LEDs that the host sets on a keyboard: bit 1 is caps lock.
    """
    interfaces = {name: _Reports(show_leds, *_INTERFACES[name]) for name in names}
    # Without the built-in driver there would be no serial port, and no prompt.
    usb.device.get().init(*[interfaces[name] for name in names], builtin_driver=True)
    return {name: interfaces[name].send for name in names}
