"""Keys go to one host, USB first; none stays down when hosts come and go."""

from types import SimpleNamespace

import pytest
from bumble import gatt
from hidtools.hid import ReportDescriptor

from radio_air import Air
from radio_ble import Ble, Uuid
from radio_hosts import Host, is_up, pressed
from spots_device.radio.hosts import Keys
from spots_device.radio.peripheral import Radio

pytestmark = pytest.mark.board
INPUT = 1  # direction of a report
DOWN = {1: 0x1E, 2: 0x1F, 3: 0x20, 7: 0x24}  # usages of the keys of `digits`


def test_keys_go_to_usb_while_a_computer_is_there_and_else_by_radio(rig):
    host = rig.bonded()
    rig.tap(0)
    rig.link.usb.plugged = False
    rig.run(0.1)
    rig.tap(1)
    rig.link.usb.plugged = True
    rig.run(0.1)
    rig.tap(2)
    assert pressed(rig.link.usb.reports) == [DOWN[1], DOWN[3]]
    assert pressed(host.reports) == [DOWN[2]]


@pytest.mark.parametrize("plugged", [True, False])
def test_a_key_that_is_down_when_the_cable_comes_or_goes_is_released(rig, plugged):
    """Fails if the host that loses the keyboard keeps a key down."""
    host = rig.bonded()
    rig.link.usb.plugged = not plugged
    rig.run(0.1)
    rig.press(1)
    rig.link.usb.plugged = plugged
    rig.run(0.1)
    if plugged:  # else the computer releases the keys of a device that is gone
        assert (pressed(host.reports), is_up(host.reports)) == ([DOWN[2]], True)
    rig.lift()
    rig.tap(2)
    new = rig.link.usb.reports if plugged else host.reports
    assert (pressed(new), is_up(new)) == ([DOWN[3]], True)


def test_disconnections_in_a_touch_leave_no_key_down(rig):
    host = rig.bonded()
    rig.link.usb.plugged = False
    for i in range(20):
        rig.press(i % 10)
        host.disconnect()
        rig.run(0.02)
        host.reports.clear()
        host.come_back()
        host.use()
        rig.run(0.1)
        rig.lift()
        assert pressed(host.reports) == []  # the finger is ignored until it lifts
        rig.tap(6)
        assert (pressed(host.reports), is_up(host.reports)) == ([DOWN[7]], True)


def bonded_to_all(names, show_leds=print, set_multipliers=print):
    """Return a host that has bonded with a radio that has these interfaces, and a step of both."""
    air = Air()
    clock = SimpleNamespace(ticks_us=int, ticks_add=int.__add__, ticks_diff=int.__sub__)
    radio = Radio(Ble(air), Uuid, "0123", "hid", clock, [], show_leds, set_multipliers)
    radio.open(names)

    def step():
        air.settle(air.now_s + 0.001)
        radio.work()

    host = Host(air, step)
    host.connect()
    host.pair(radio.pair())
    host.find()
    return host, step


def test_the_host_sets_the_leds_and_the_resolution_of_the_wheels():
    leds, multipliers = [], []
    host, step = bonded_to_all(["keyboard", "mouse"], leds.append, multipliers.append)
    host.set(0, 2)
    host.set(1, 5)
    step()
    assert (leds, multipliers) == ([2], [5])


def test_hid_tools_reads_the_map_with_the_ids_and_sizes_of_the_reports():
    host, _ = bonded_to_all(["keyboard", "consumer", "system", "mouse", "gamepad"])
    read = ReportDescriptor.from_bytes(host.read(gatt.GATT_REPORT_MAP_CHARACTERISTIC))
    found = {}
    for one in host.peer.get_characteristics_by_uuid(gatt.GATT_REPORT_CHARACTERISTIC):
        host.wait(host.peer.discover_descriptors(one))
        reference = one.get_descriptor(gatt.GATT_REPORT_REFERENCE_DESCRIPTOR)
        number, kind = host.wait(host.peer.read_value(reference))
        if kind == INPUT:
            found[number] = len(host.wait(host.peer.read_value(one)))
    assert found == {number: one.size - 1 for number, one in read.input_reports.items()}
    assert len(found) == 5


def test_keys_that_usb_cannot_open_go_by_radio_and_the_board_says_so():
    """Fails if nobody learns why a cable brings no keys."""

    def refuse(names):
        raise OSError("no endpoint is free")

    sent = []
    radio = SimpleNamespace(open=lambda names: {"keyboard": SimpleNamespace(send=sent.append)})
    keys = Keys(SimpleNamespace(open=refuse), radio)
    assert [*keys.open(["keyboard"])] == ["keyboard"]
    assert "no endpoint is free" in keys.fault
