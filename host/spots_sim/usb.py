"""The computer that a virtual board is plugged into, as its USB reports see it."""

from __future__ import annotations

import errno

from .protocol import protocol


class UsbHost:
    """Takes reports from endpoints that hold one each until the host asks for it.

    Attributes
    ----------
    reports : list of (int, bytes)
        What the host has got: interface and report.
    """

    def __init__(self):
        self.reports = []
        self._waiting = {}
        self._asks = True

    @property
    def asks(self) -> bool:
        """Whether the host asks for reports; a computer that sleeps or starts does not."""
        return self._asks

    @asks.setter
    def asks(self, asks: bool) -> None:
        self._asks = asks
        if asks:
            self.reports.extend(self._waiting.items())
            self._waiting.clear()

    def look(self) -> None:
        """Do nothing if it is awake.

        Raises
        ------
        OSError
            ENODEV, if it does not ask for reports.
        """
        if not self._asks:
            raise OSError(errno.ENODEV, "the host sleeps")

    def offer(self, interface: int, report: bytes) -> None:
        """Take a report into its endpoint; an empty one only asks whether there is room.

        Parameters
        ----------
        interface : int
            Number of the HID interface.
        report : bytes
            Empty to ask whether there is room.

        Raises
        ------
        OSError
            EAGAIN, if the endpoint is full.
        """
        if interface in self._waiting:
            raise OSError(protocol.EAGAIN, "the endpoint is full")
        if report and self._asks:
            self.reports.append((interface, report))
        elif report:
            self._waiting[interface] = report
