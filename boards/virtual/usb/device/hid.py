"""``usb.device.hid`` of the virtual board: sends reports to the simulator's USB host."""

import _protocol
import _simulator
from micropython import const

_HID = const(3)


class HIDInterface:
    """Replaces MicroPython's class of this name; has only the methods that the firmware uses."""

    def __init__(self, report_descriptor, set_report_buf=None, protocol=0):
        self.report_descriptor = report_descriptor
        self.protocol = protocol
        self._open = False
        self._index = 0

    def desc_cfg(self, desc, itf_num, ep_num, strs):
        desc.interface(itf_num, 1, _HID, 1 if self.protocol else 0, self.protocol)
        self._index = itf_num
        # From now on `protocol` is the host's choice: 0 for boot reports, 1 for the reports that
        # the descriptor defines.
        self.protocol = 1

    def on_open(self):
        self._open = True

    def on_interface_control_xfer(self, stage, request):
        return False

    def is_open(self):
        return self._open

    def busy(self):
        return self._open and self._refuses(b"")

    def send_report(self, report_data, timeout_ms=100):
        if not self._open:
            return False
        return not self._refuses(report_data)

    def _refuses(self, report):
        try:
            _simulator.call(_protocol.HID, self._index, len(report), 0, report)
        except OSError as error:
            if error.errno != _protocol.EAGAIN:
                raise
            return True
        return False
