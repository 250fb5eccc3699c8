"""GATT services of the board: HID over GATT, a serial port, and who made the board.

Sources: HID over GATT Profile 1.0 ("HOGP"); HID Service 1.0; Bluetooth Assigned Numbers; the UUIDs
of the serial port are those of Nordic's UART service, which terminals for phones know.
"""

from binascii import unhexlify

from .. import __version__, const
from ..usb.descriptors import REPORTS, with_report_id

UART = "6e400001-b5a3-f393-e0a9-e50e24dcca9e"
TO_BOARD = "6e400002-b5a3-f393-e0a9-e50e24dcca9e"
TO_HOST = "6e400003-b5a3-f393-e0a9-e50e24dcca9e"
_RECEIVED_MAX = const(512)  # bytes that wait until the loop reads them

_HID = const(0x1812)
_DEVICE = const(0x180A)
_MAKER, _REVISION, _PNP = const(0x2A29), const(0x2A26), const(0x2A50)
_INFORMATION, _MAP, _CONTROL = const(0x2A4A), const(0x2A4B), const(0x2A4C)
_REPORT, _PROTOCOL = const(0x2A4D), const(0x2A4E)
_REFERENCE = const(0x2908)
# Version 1.11, no country; the host may sleep, and this device can always connect.
_HID_INFORMATION = b"\x11\x01\x00\x03"
_REPORT_PROTOCOL = b"\x01"
_INPUT, _OUTPUT, _FEATURE = const(1), const(2), const(3)
# The vendor id 0xFFFF of the Bluetooth SIG stands for no company.
_PNP_ID = b"\x01\xff\xff\x01\x00\x01\x00"

# Flags of characteristics, as MicroPython's `bluetooth` defines them.
_READ, _WRITE_NOW, _WRITE, _NOTIFY = const(0x02), const(0x04), const(0x08), const(0x10)
_READ_SAFE, _WRITE_SAFE = const(0x0200), const(0x1000)  # only encrypted

# Report ids. Those of one board need not be those of USB.
_IDS = {"keyboard": 1, "consumer": 2, "system": 3, "mouse": 4, "gamepad": 5}


class Handles:
    """Numbers of the characteristics: -1 for one that is not there.

    Attributes
    ----------
    reports : dict
        For each name of an interface, the handle of its input report.
    leds, multipliers : int
        What the host writes for the keyboard and for the mouse.
    to_host, to_board : int
        The two directions of the serial port.
    """

    def __init__(self):
        self.reports = {}
        self.leds = self.multipliers = self.to_host = self.to_board = -1


def register(ble, uuid, names, data):
    """Register all services; return their `Handles`.

    Parameters
    ----------
    ble : bluetooth.BLE
        The stack, active.
    uuid : callable
        ``bluetooth.UUID``.
    names : list of str
        Names of the HID interfaces, from `interfaces.INTERFACES`; none without HID.
    data : bool
        Whether there is a serial port.
    """
    services = [
        (uuid(_DEVICE), ((uuid(_MAKER), _READ), (uuid(_REVISION), _READ), (uuid(_PNP), _READ)))
    ]
    if names:
        services.append((uuid(_HID), _characteristics(uuid, names)))
    if data:
        services.append(
            (
                uuid(UART),
                (
                    (uuid(TO_HOST), _READ_SAFE | _READ | _NOTIFY),
                    (uuid(TO_BOARD), _WRITE_SAFE | _WRITE | _WRITE_NOW),
                ),
            )
        )
    numbers = list(ble.gatts_register_services(tuple(services)))
    maker, revision, pnp = numbers.pop(0)
    ble.gatts_write(maker, b"SPOTS")
    ble.gatts_write(revision, __version__.encode())
    ble.gatts_write(pnp, _PNP_ID)
    made = Handles()
    if names:
        _fill(ble, numbers.pop(0), names, made)
    if data:
        made.to_host, made.to_board = numbers.pop(0)
        ble.gatts_set_buffer(made.to_board, _RECEIVED_MAX, True)
    return made


def _received(names):
    # Interfaces to which the host writes, and the type of this report.
    found = []
    if "keyboard" in names:
        found.append(("keyboard", _OUTPUT))
    if "mouse" in names:
        found.append(("mouse", _FEATURE))
    return found


def _characteristics(uuid, names):
    reference = ((uuid(_REFERENCE), _READ),)  # NimBLE guards no descriptor
    made = [
        (uuid(_INFORMATION), _READ | _READ_SAFE),
        (uuid(_MAP), _READ | _READ_SAFE),
        (uuid(_CONTROL), _WRITE_NOW | _WRITE_SAFE),
        (uuid(_PROTOCOL), _READ | _READ_SAFE | _WRITE_NOW | _WRITE_SAFE),
    ]
    made += [(uuid(_REPORT), _READ | _READ_SAFE | _NOTIFY, reference) for _ in names]
    written = _READ | _READ_SAFE | _WRITE | _WRITE_NOW | _WRITE_SAFE
    made += [(uuid(_REPORT), written, reference) for _ in _received(names)]
    return tuple(made)


def _fill(ble, numbers, names, made):
    information, report_map, _, protocol = numbers[:4]
    ble.gatts_write(information, _HID_INFORMATION)
    ble.gatts_write(protocol, _REPORT_PROTOCOL)
    ble.gatts_write(report_map, b"".join([with_report_id(REPORTS[n][0], _IDS[n]) for n in names]))
    at = 4
    for name in names:
        ble.gatts_write(numbers[at], bytes(REPORTS[name][1]))
        ble.gatts_write(numbers[at + 1], bytes((_IDS[name], _INPUT)))
        made.reports[name] = numbers[at]
        at += 2
    for name, kind in _received(names):
        ble.gatts_write(numbers[at], b"\0")
        ble.gatts_write(numbers[at + 1], bytes((_IDS[name], kind)))
        if name == "keyboard":
            made.leds = numbers[at]
        else:
            made.multipliers = numbers[at]
        at += 2


def advertisement(name, hid, data):
    """Return what the board advertises, and its answer to a scan (bytes, at most 31 each).

    Flags, the name, and with HID its service and the appearance of a keyboard; the answer has the
    serial port, if there is one.
    """
    made = b"\x02\x01\x06"  # flags: discoverable, no classic Bluetooth
    if hid:
        made += b"\x03\x03\x12\x18\x03\x19\xc1\x03"
    made += bytes((len(name) + 1, 9)) + name.encode()
    wire = bytes(reversed(unhexlify(UART.replace("-", ""))))
    return made, b"\x11\x07" + wire if data else b""
