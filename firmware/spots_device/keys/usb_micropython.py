"""USB reports through MicroPython's library usb-device-hid, which the board must have.

The USB stack stores an accepted report until the host fetches it, even while the host sleeps, and
MicroPython does not know whether the host sleeps. A key that is typed meanwhile must not be
delivered when the host wakes. So a report with a pressed key is only sent to a host that has just
fetched another report. If there is none, the last report is sent again first: it changes nothing,
so it may wait for the host.
"""

from time import sleep_us, ticks_add, ticks_diff, ticks_us

import usb.device
from usb.device.hid import HIDInterface

from .. import const
from .reports import (
    CONSUMER_DESCRIPTOR,
    CONSUMER_SIZE,
    GAMEPAD_DESCRIPTOR,
    KEYBOARD_DESCRIPTOR,
    REPORT_SIZE,
    is_pressed,
)

_NONE = const(0)  # boot protocols of an interface, HID 1.11, section 4.3
_KEYBOARD = const(1)
_SETUP = const(1)  # stage of a control transfer
_GET_REPORT = (0xA1, 1)  # bmRequestType, bRequest
_INTERVAL_MS = const(1)  # between two polls of an endpoint by the host
# A host is awake for this time after the start of a report that it has fetched.
_AWAKE_US = const(20_000)
_FETCH_US = const(3_000)  # longest wait for the host to fetch the repeated report
_STEP_US = const(100)

_INTERFACES = {
    "keyboard": (KEYBOARD_DESCRIPTOR, REPORT_SIZE, _KEYBOARD),
    "consumer": (CONSUMER_DESCRIPTOR, CONSUMER_SIZE, _NONE),
    "gamepad": (GAMEPAD_DESCRIPTOR, REPORT_SIZE, _NONE),
}


class _Reports(HIDInterface):
    def __init__(self, show_leds, descriptor, size, protocol):
        # Hosts set the LEDs of a keyboard, and some cannot handle a refusal.
        super().__init__(descriptor, set_report_buf=bytearray(1), protocol=protocol)
        self._show_leds = show_leds
        self._described_as = protocol
        # The USB stack reads this buffer until the host has the report.
        self._report = bytearray(size)
        self._offered = ticks_add(ticks_us(), -_AWAKE_US)

    def desc_cfg(self, desc, itf_num, ep_num, strs):
        # The library calls this twice and stores the active protocol in `protocol` in between.
        # Without this line, the second call would describe every interface as a boot keyboard.
        self.protocol = self._described_as
        super().desc_cfg(desc, itf_num, ep_num, strs)
        # bInterval is the last byte of the last descriptor. The library has no option for it
        # before version 0.2. The first call has no buffer.
        if desc.b:
            desc.b[desc.o - 1] = _INTERVAL_MS

    def on_interface_control_xfer(self, stage, request):
        if stage == _SETUP and (request[0], request[1]) == _GET_REPORT:
            return self._report  # the library would print a message into the stream of frames
        return super().on_interface_control_xfer(stage, request)

    def on_set_report(self, report_data, report_id, report_type):
        self._show_leds(report_data[0])
        return True

    def send(self, report):
        """Offer a report to the USB stack; return whether it was accepted.

        Waits for 3 ms at most, and only before the first press after a pause.
        """
        if not self.is_open() or self.busy():
            return False
        if is_pressed(report) and not self._is_host_awake():
            return False
        for i in range(len(report)):
            self._report[i] = report[i]
        return self._offer()

    def _is_host_awake(self):
        began = ticks_us()
        if 0 <= ticks_diff(began, self._offered) < _AWAKE_US:
            return True
        if not self._offer():
            return False
        while self.busy():
            if ticks_diff(ticks_us(), began) >= _FETCH_US:
                return False
            sleep_us(_STEP_US)
        return True

    def _offer(self):
        self._offered = ticks_us()
        try:
            # Version 0.1.0 of the library returns None for an accepted report.
            return self.send_report(self._report, 0) is not False
        except (OSError, RuntimeError):  # disconnected since `is_open`
            return False


def open_interfaces(names, show_leds):
    """Open HID interfaces; return the functions that send their reports.

    USB disconnects and connects again.

    Parameters
    ----------
    names : list of str
        Names of interfaces, from `uses.INTERFACES`.
    show_leds : callable
        ``show_leds(leds)`` shows the keyboard LEDs as the host has set them; bit 1 is caps lock.

    Returns
    -------
    dict
        For the name of each interface, the function ``send(report) -> bool``.
    """
    interfaces = {name: _Reports(show_leds, *_INTERFACES[name]) for name in names}
    # Without the built-in driver there would be no serial port, and no prompt.
    usb.device.get().init(*[interfaces[name] for name in names], builtin_driver=True)
    return {name: interfaces[name].send for name in names}
