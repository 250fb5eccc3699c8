"""`usb_hid` of the virtual board: sends reports to the simulator's USB host."""

import time

import _protocol
import _simulator
from micropython import const

_TIMEOUT_MS = const(2_000)


class Device:
    def __init__(
        self,
        *,
        report_descriptor,
        usage_page,
        usage,
        report_ids,
        in_report_lengths,
        out_report_lengths,
    ):
        if not len(report_ids) == len(in_report_lengths) == len(out_report_lengths) == 1:
            raise ValueError("the simulator supports one report id for each device")
        self.usage_page = usage_page
        self.usage = usage
        self._size = in_report_lengths[0]

    def get_last_received_report(self, report_id=None):
        return None  # the simulated host has no caps lock

    def send_report(self, report, report_id=None):
        if len(report) != self._size:
            raise ValueError("report length must be %d" % self._size)
        for _ in range(_TIMEOUT_MS):
            if _taken(devices.index(self), report):
                return
            time.sleep(0.001)
        raise OSError("USB busy")


def _taken(index, report):
    try:
        _simulator.call(_protocol.HID, index, len(report), 0, report)
    except OSError as error:
        if error.errno != _protocol.EAGAIN:
            raise
        return False
    return True


def _built_in(usage_page, usage, report_id, size):
    return Device(
        report_descriptor=b"",
        usage_page=usage_page,
        usage=usage,
        report_ids=(report_id,),
        in_report_lengths=(size,),
        out_report_lengths=(0,),
    )


Device.KEYBOARD = _built_in(0x01, 0x06, 1, 8)
Device.MOUSE = _built_in(0x01, 0x02, 2, 4)
Device.CONSUMER_CONTROL = _built_in(0x0C, 0x01, 3, 2)
devices = (Device.KEYBOARD, Device.MOUSE, Device.CONSUMER_CONTROL)


def enable(wanted, boot_device=0):
    global devices
    devices = tuple(wanted)


def disable():
    enable(())
