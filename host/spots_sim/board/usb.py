"""The simulated USB host, which receives the HID reports of a virtual board."""

from __future__ import annotations

import errno

from spots_device.usb.descriptors import MOUSE_SIZE, STATE_SIZE

from .protocol import protocol


class UsbHost:
    """A simulated USB host; each endpoint of the board stores one report until the host polls it.

    `reports` has the interface's number and the report. Reports that change nothing are left out:
    the firmware repeats reports, see `spots_device.usb.micropython`. A report of a mouse that
    moves is a change.
    """

    def __init__(self):
        self.reports = []
        self._plugged = True
        self._last = {}
        self._waiting = {}
        self._asks = True

    @property
    def plugged(self) -> bool:
        """Whether the cable is in; a report that waits is lost when it is plugged in again."""
        return self._plugged

    @plugged.setter
    def plugged(self, plugged: bool) -> None:
        self._plugged = plugged
        self._waiting.clear()

    @property
    def asks(self) -> bool:
        """Whether the USB host polls for reports; False simulates a sleeping computer."""
        return self._asks

    @asks.setter
    def asks(self, asks: bool) -> None:
        self._asks = asks
        if asks:
            for interface, report in self._waiting.items():
                self._receive(interface, report)
            self._waiting.clear()

    def look(self) -> None:
        """Call this before a report is sent: OSError ENODEV if the host is asleep."""
        if not self._asks:
            raise OSError(errno.ENODEV, "the host sleeps")

    def offer(self, interface: int, report: bytes) -> None:
        """Put a HID report into the endpoint of its interface; OSError EAGAIN if it is full.

        An empty report only checks whether the endpoint is free.
        """
        if interface in self._waiting:
            raise OSError(protocol.EAGAIN, "the endpoint is full")
        if report and self._asks and self._plugged:
            self._receive(interface, report)
        elif report:
            self._waiting[interface] = report

    def _receive(self, interface: int, report: bytes) -> None:
        moves = len(report) == MOUSE_SIZE and any(report[STATE_SIZE:])
        if moves or report != self._last.get(interface, bytes(len(report))):
            self._last[interface] = report
            self.reports.append((interface, report))
