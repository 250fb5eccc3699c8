"""USB reports through CircuitPython's usb_hid, which boot.py sets up before USB connects.

All devices share one endpoint, which the host polls every 8 ms. While the endpoint is full,
``send_report`` blocks for up to 2 s. While the host sleeps, ``send_report`` discards the report
without an error (shared-module/usb_hid/Device.c). So there is a minimum time between two reports,
and no report is sent while the host is disconnected or asleep. After a timeout, each further report
could block for 2 s again. So no report is sent for 64 s, or until the host sets the keyboard's
LEDs.

After these 2 s, ``send_report`` asks a sleeping host to wake up. So a press that finds the host
asleep sends a report without keys, at most every 64 s.
"""

import supervisor
import usb_hid

from .reports import is_pressed

# HID usage page and usage that identify a device.
_USAGES = {
    "keyboard": (0x01, 0x06),
    "consumer": (0x0C, 0x01),
    "system": (0x01, 0x80),
    "mouse": (0x01, 0x02),
    "gamepad": (0x01, 0x05),
}
# Report ids; CircuitPython's own devices use 1 to 3.
_IDS = {"gamepad": 4, "system": 5, "mouse": 6}
_SPACE_MS = 10  # minimum time between two reports
_PAUSE_MS = 64_000  # after a timeout, because the next report may block for two seconds again
_HALF = 1 << 28  # half the period of ticks_ms


def enable(names):
    """Select interfaces of `interfaces.INTERFACES`. Call it in boot.py, before USB connects."""
    usb_hid.enable(tuple([_device(name) for name in names]))


def _device(name):
    if name == "keyboard":
        # No boot protocol: CircuitPython offers it only on the first interface, which belongs to
        # the serial port.
        return usb_hid.Device.KEYBOARD
    if name == "consumer":
        return usb_hid.Device.CONSUMER_CONTROL
    from .descriptors import REPORTS, with_report_id

    descriptor, size = REPORTS[name]
    return usb_hid.Device(
        report_descriptor=with_report_id(descriptor, _IDS[name]),
        usage_page=_USAGES[name][0],
        usage=_USAGES[name][1],
        report_ids=(_IDS[name],),
        in_report_lengths=(size,),
        out_report_lengths=(1 if name == "mouse" else 0,),
    )


def open_interfaces(names, show_leds):
    """Return ``send(report) -> bool`` for each name of an interface that boot.py has enabled.

    ``show_leds(leds)`` shows the keyboard LEDs as the host has set them (bit 1 is caps lock); it is
    called before the next keyboard report.
    """
    endpoint = _Endpoint()
    sends = {}
    for device in usb_hid.devices:
        for name in names:
            if (device.usage_page, device.usage) == _USAGES[name]:
                sends[name] = _Interface(endpoint, device, _receiver_of(name, show_leds)).send
    return sends


def _receiver_of(name, show_leds):
    if name == "mouse":
        from .mouse import set_multipliers

        return set_multipliers
    return show_leds if name == "keyboard" else None


class _Endpoint:
    """Limits the rate of the reports of all interfaces, which share one endpoint."""

    def __init__(self):
        self._from_ms = supervisor.ticks_ms()
        self._wait_ms = 0
        self._was_connected = self._was_asleep = False

    def free(self):
        if not supervisor.runtime.usb_connected:  # not mounted, or suspended
            if not self._was_asleep:
                self._was_asleep = True
                self._wait(0)
            return False
        if self._was_asleep:
            self._wait(0)
        self._was_asleep, self._was_connected = False, True
        return self._is_over()

    def may_wake(self):
        """Return whether a host that does not take reports may be asked to wake up."""
        return self._was_asleep and self._was_connected and self._is_over()

    def _is_over(self):
        # Ticks wrap, so a time in the far past looks like a time in the future.
        if 0 < _diff(self._from_ms, supervisor.ticks_ms()) <= self._wait_ms:
            return False
        self._wait_ms = 0  # the wait is over, even if the ticks wrap before the next call
        return True

    def took(self):
        self._wait(_SPACE_MS)

    def refused(self):
        self._wait(_PAUSE_MS)

    def heard(self):
        # The host has a keyboard driver, so it will probably poll.
        if self._wait_ms == _PAUSE_MS:
            self._wait_ms = 0

    def _wait(self, duration_ms):
        self._wait_ms = duration_ms
        self._from_ms = supervisor.ticks_ms() + duration_ms


def _diff(end, start):
    return ((end - start + _HALF) & (2 * _HALF - 1)) - _HALF


class _Interface:
    def __init__(self, endpoint, device, receive):
        self._endpoint = endpoint
        self._device = device
        self._receive = receive

    def send(self, report):
        """Send a report unless the call would block; return whether it was sent."""
        if self._receive is not None:
            received = self._device.get_last_received_report()  # None if nothing is new
            if received:
                self._receive(received[0])
                self._endpoint.heard()
        if not self._endpoint.free():
            if is_pressed(report) and self._endpoint.may_wake():
                self._wake(len(report))
            return False
        try:
            self._device.send_report(report)
        except OSError:
            self._endpoint.refused()
            return False
        self._endpoint.took()
        # If the host has just fallen asleep, it did not get the report. The result False makes the
        # caller send the report again. Sending the same state twice has no effect.
        return supervisor.runtime.usb_connected

    def _wake(self, size):
        # A press that the host did not see must not be delivered when it wakes.
        try:
            self._device.send_report(bytes(size))
        except OSError:
            pass
        self._endpoint.refused()
