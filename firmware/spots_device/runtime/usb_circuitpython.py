"""USB reports through CircuitPython's usb_hid, which boot.py sets up before USB connects.

All devices share one endpoint, which the host asks every 8 ms. While it is full ``send_report``
blocks for up to 2 s, and while the host sleeps it discards the report without an error
(shared-module/usb_hid/Device.c). So reports are spaced out, none is sent while the host is
disconnected, and after each timeout the back-off doubles.
"""

import supervisor
import usb_hid

from ..hid import GAMEPAD_DESCRIPTOR, REPORT_SIZE, with_report_id

# Usage page and usage by which a device is known.
_USAGES = {"keyboard": (0x01, 0x06), "consumer": (0x0C, 0x01), "gamepad": (0x01, 0x05)}
_GAMEPAD_ID = 4  # 1 to 3 are those of CircuitPython's own devices
_SPACE_MS = 10
_PAUSE_MS = 2_000  # after a timeout; twice as long after each further one
_PAUSE_MAX_MS = 64_000
_HALF = 1 << 28  # of the period of ticks_ms


def enable(keyboard, gamepad):
    """Choose what the host will see; for boot.py, USB must not be connected yet."""
    devices = []
    if keyboard:
        devices += [usb_hid.Device.KEYBOARD, usb_hid.Device.CONSUMER_CONTROL]
    if gamepad:
        devices.append(
            usb_hid.Device(
                report_descriptor=with_report_id(GAMEPAD_DESCRIPTOR, _GAMEPAD_ID),
                usage_page=_USAGES["gamepad"][0],
                usage=_USAGES["gamepad"][1],
                report_ids=(_GAMEPAD_ID,),
                in_report_lengths=(REPORT_SIZE,),
                out_report_lengths=(0,),
            )
        )
    usb_hid.enable(tuple(devices))


def open_interfaces(names, show_leds):
    """Return what sends reports, by name, for those of the names that boot.py has set up.

    ``show_leds(leds)`` gets the LEDs that the host sets on a keyboard, at the next report: bit 1
    is caps lock.
    """
    endpoint = _Endpoint()
    sends = {}
    for device in usb_hid.devices:
        for name in names:
            if (device.usage_page, device.usage) == _USAGES[name]:
                show = show_leds if name == "keyboard" else None
                sends[name] = _Interface(endpoint, device, show).send
    return sends


class _Endpoint:
    """When the next report may go."""

    def __init__(self):
        self._from_ms = supervisor.ticks_ms()
        self._wait_ms = 0
        self._pause_ms = _PAUSE_MS

    def free(self):
        if not supervisor.runtime.usb_connected:  # neither mounted nor awake
            self._wait(0)
            self._pause_ms = _PAUSE_MS
            return False
        # The ticks wrap: a time long past looks like a future one.
        if 0 < _diff(self._from_ms, supervisor.ticks_ms()) <= self._wait_ms:
            return False
        self._wait_ms = 0  # over, however often the ticks wrap until the next one
        return True

    def took(self):
        self._wait(_SPACE_MS)
        self._pause_ms = _PAUSE_MS

    def refused(self):
        self._wait(self._pause_ms)
        self._pause_ms = min(2 * self._pause_ms, _PAUSE_MAX_MS)

    def _wait(self, duration_ms):
        self._wait_ms = duration_ms
        self._from_ms = supervisor.ticks_ms() + duration_ms


def _diff(end, start):
    return ((end - start + _HALF) & (2 * _HALF - 1)) - _HALF


class _Interface:
    def __init__(self, endpoint, device, show_leds):
        self._endpoint = endpoint
        self._device = device
        self._show_leds = show_leds

    def send(self, report):
        """Offer a report to the stack, unless that would block; return whether it was sent."""
        if self._show_leds is not None:
            leds = self._device.get_last_received_report()  # None unless it is news
            if leds:
                self._show_leds(leds[0])
        if not self._endpoint.free():
            return False
        try:
            self._device.send_report(report)
        except OSError:
            self._endpoint.refused()
            return False
        self._endpoint.took()
        # A host that has just gone to sleep did not get it. Sending the same state twice is
        # harmless.
        return supervisor.runtime.usb_connected
