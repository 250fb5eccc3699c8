"""Report descriptors of the interfaces; a board imports them only while it opens these."""

REPORT_SIZE = 8  # of keyboard and gamepad
ONE_KEY_SIZE = 2
MOUSE_SIZE = 7
STATE_SIZE = 1  # bytes of a mouse's report before the movements

# Boot keyboard, USB HID 1.11, appendices B.1 and E.6: modifiers, a byte that is 0, six usages.
KEYBOARD_DESCRIPTOR = (
    b"\x05\x01\x09\x06\xa1\x01"  # generic desktop, keyboard, application
    b"\x05\x07\x19\xe0\x29\xe7\x15\x00\x25\x01\x75\x01\x95\x08\x81\x02"  # eight modifiers
    b"\x75\x08\x95\x01\x81\x01"  # a byte that is 0
    b"\x05\x08\x19\x01\x29\x05\x75\x01\x95\x05\x91\x02\x75\x03\x95\x01\x91\x01"  # LEDs, from host
    b"\x05\x07\x19\x00\x29\xdd\x15\x00\x26\xdd\x00\x75\x08\x95\x06\x81\x00"  # six usages
    b"\xc0"
)
# One key at a time, such as volume or play, by its usage; 0 means no key.
CONSUMER_DESCRIPTOR = (
    b"\x05\x0c\x09\x01\xa1\x01"  # consumer, consumer control, application
    b"\x15\x00\x26\xff\x03\x19\x00\x2a\xff\x03\x75\x10\x95\x01\x81\x00"  # 16 bits
    b"\xc0"
)
# Power down, sleep and wake up, one at a time; a value below the range means no key.
SYSTEM_DESCRIPTOR = (
    b"\x05\x01\x09\x80\xa1\x01"  # generic desktop, system control, application
    b"\x16\x81\x00\x26\x83\x00\x19\x81\x29\x83\x75\x10\x95\x01\x81\x40"  # 16 bits
    b"\xc0"
)
# X and Y, -32767 to 32767; Z, 0 to 32767; 16 buttons.
GAMEPAD_DESCRIPTOR = (
    b"\x05\x01\x09\x05\xa1\x01"  # generic desktop, gamepad, application
    b"\x09\x30\x09\x31\x16\x01\x80\x26\xff\x7f\x75\x10\x95\x02\x81\x02"  # X, Y
    b"\x09\x32\x15\x00\x26\xff\x7f\x75\x10\x95\x01\x81\x02"  # Z
    b"\x05\x09\x19\x01\x29\x10\x15\x00\x25\x01\x75\x01\x95\x10\x81\x02"  # buttons 1 to 16
    b"\xc0"
)
# Buttons 1 to 8, X and Y that stay 0, and two wheels, each with a resolution multiplier.
MOUSE_DESCRIPTOR = (
    b"\x05\x01\x09\x02\xa1\x01\x09\x01\xa1\x00"  # generic desktop, mouse, application; pointer
    b"\x05\x09\x19\x01\x29\x08\x15\x00\x25\x01\x75\x01\x95\x08\x81\x02"  # buttons 1 to 8
    b"\x05\x01\x09\x30\x09\x31\x15\x81\x25\x7f\x75\x08\x95\x02\x81\x06"  # X, Y, which stay 0
    b"\xa1\x02\x09\x48\x15\x00\x25\x01\x35\x01\x45\x78\x75\x02\x95\x01\xb1\x02"  # multiplier, 120
    b"\x09\x38\x16\x01\x80\x26\xff\x7f\x35\x00\x45\x00\x75\x10\x81\x06\xc0"  # wheel
    b"\xa1\x02\x09\x48\x15\x00\x25\x01\x35\x01\x45\x78\x75\x02\xb1\x02"  # multiplier, 120
    b"\x35\x00\x45\x00\x75\x04\xb1\x03"  # four bits that are 0
    b"\x05\x0c\x0a\x38\x02\x16\x01\x80\x26\xff\x7f\x75\x10\x81\x06\xc0"  # horizontal wheel
    b"\xc0\xc0"
)
# For each name of an interface, its report descriptor and the size of a report.
REPORTS = {
    "keyboard": (KEYBOARD_DESCRIPTOR, REPORT_SIZE),
    "consumer": (CONSUMER_DESCRIPTOR, ONE_KEY_SIZE),
    "system": (SYSTEM_DESCRIPTOR, ONE_KEY_SIZE),
    "mouse": (MOUSE_DESCRIPTOR, MOUSE_SIZE),
    "gamepad": (GAMEPAD_DESCRIPTOR, REPORT_SIZE),
}


def with_report_id(descriptor, report_id):
    """Return a report descriptor with a report id (1 to 255), for a shared endpoint."""
    return descriptor[:6] + bytes((0x85, report_id)) + descriptor[6:]
