"""The HID descriptors of a board, read by hid-tools, which knows them as Linux does."""

import pytest
from hidtools.hid import ReportDescriptor

from spots_device.usb.descriptors import (
    CONSUMER_DESCRIPTOR,
    GAMEPAD_DESCRIPTOR,
    KEYBOARD_DESCRIPTOR,
    MOUSE_DESCRIPTOR,
    MOUSE_SIZE,
    ONE_KEY_SIZE,
    REPORT_SIZE,
    SYSTEM_DESCRIPTOR,
    with_report_id,
)
from spots_device.usb.gamepad import GamepadReports
from spots_device.usb.mouse import MouseReports, set_multipliers
from spots_device.usb.reports import KeyboardReports

# Descriptor, application, bytes of a report, and bytes of what the host sends.
KINDS = {
    "keyboard": (KEYBOARD_DESCRIPTOR, "Keyboard", REPORT_SIZE, 1),
    "consumer": (CONSUMER_DESCRIPTOR, "Consumer Control", ONE_KEY_SIZE, 0),
    "system": (SYSTEM_DESCRIPTOR, "System Control", ONE_KEY_SIZE, 0),
    "mouse": (MOUSE_DESCRIPTOR, "Mouse", MOUSE_SIZE, 1),
    "gamepad": (GAMEPAD_DESCRIPTOR, "Game Pad", REPORT_SIZE, 0),
}


def parsed(descriptor):
    """Return hid-tools' view of a descriptor; all its bytes are known items."""
    there = ReportDescriptor.from_bytes(descriptor)
    assert b"".join(bytes(item.bytes) for item in there.rdesc_items) == descriptor
    return there


@pytest.mark.parametrize("report_id", [None, 4])
@pytest.mark.parametrize("name", KINDS)
def test_each_descriptor_describes_its_reports(name, report_id):
    descriptor, application, size, received_size = KINDS[name]
    more = 0
    if report_id is not None:
        descriptor = with_report_id(descriptor, report_id)
        more = 1  # hid-tools counts the id
    there = parsed(descriptor)
    (report,) = there.input_reports.values()
    assert report.application_name == application
    assert report.size == size + more
    assert report.numbered == (report_id is not None)
    received = [*there.output_reports.values(), *there.feature_reports.values()]
    assert [one.size for one in received] == [received_size + more] * (received_size > 0)


def fields(descriptor, report):
    """Return what hid-tools reads from a report: values by usage."""
    (there,) = parsed(descriptor).input_reports.values()
    found = {}
    for field in there:
        for usage, value in zip(field.usages or [field.usage], field.get_values(list(report))):
            found[usage & 0xFFFF, usage >> 16] = value
    return found


def last(reports):
    """Return the newest report of an object that has queued one."""
    reports.flush()
    return bytes(reports.outbox.newest())


def test_hid_tools_reads_the_reports():
    keys = KeyboardReports(None, int)
    keys.key(4, 2, True)
    (there,) = parsed(KEYBOARD_DESCRIPTOR).input_reports.values()
    values = [field.get_values(list(last(keys))) for field in there]
    assert values[1] == [1]  # left shift
    assert "a and A" in str(values[-1][0]) or values[-1][0] == 4
    pad = GamepadReports(None, int)
    pad.update(-32_767, 5, 32_767, 0b101)
    read = fields(GAMEPAD_DESCRIPTOR, pad.outbox.newest())
    assert (read[0x30, 1], read[0x31, 1], read[0x32, 1]) == (-32_767, 5, 32_767)
    assert [read[button, 9] for button in (1, 2, 3)] == [1, 0, 1]


@pytest.mark.parametrize(("number", "usage", "sign"), [
    (9, (0x38, 1), 1), (10, (0x38, 1), -1), (11, (0x238, 12), -1), (12, (0x238, 12), 1),
])  # fmt: skip
def test_a_wheel_turns_as_its_name_says(number, usage, sign):
    set_multipliers(0b0101)
    try:
        mouse = MouseReports(None, int)
        mouse.key(2, 0, True)
        mouse.scroll(number, 300)
        read = fields(MOUSE_DESCRIPTOR, last(mouse))
    finally:
        set_multipliers(0)
    assert read[usage] == 300 * sign
    assert sum(abs(value) for value in read.values()) == 301  # and button 2
    assert read[2, 9] == 1
