"""What lets a user of Linux open the port of a board."""

from __future__ import annotations

import sys

from .serial_link import usb_ports


def with_rule(sentence: str, port: str) -> str:
    """Add a udev rule for a board to a message which says that its port may not be opened.

    Parameters
    ----------
    sentence : str
        The message; another one is returned unchanged.
    port : str
        The serial port.

    Returns
    -------
    str
    """
    if "may not be opened" not in sentence or not sys.platform.startswith("linux"):
        return sentence
    vid = next((usb.vid for usb in usb_ports() if usb.device == port), None)
    if vid is None:
        return sentence
    rule = f'SUBSYSTEM=="tty", ATTRS{{idVendor}}=="{vid:04x}", TAG+="uaccess"'
    return f"{sentence}; or put this into /etc/udev/rules.d/60-spots.rules and replug: {rule}"
