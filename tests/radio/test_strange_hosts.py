"""Hosts that are slow, old, hostile or broken: no key stays down, no loss is hidden."""

from contextlib import suppress

import pytest
from bumble import gatt
from bumble.att import ATT_Error
from bumble.core import UUID

from radio_hosts import REFUSED, TO_BOARD, is_up, pressed, whole_frames
from spots.link.frames import Touch
from spots_device.radio.services import UART

pytestmark = pytest.mark.board
CONTROL, PROTOCOL = (
    gatt.GATT_HID_CONTROL_POINT_CHARACTERISTIC,
    gatt.GATT_PROTOCOL_MODE_CHARACTERISTIC,
)
TWO, FOUR = 0x1F, 0x21  # usages of the keys 1 and 3 of `digits`
# Types of attributes that are not secret: declarations, what a host subscribes to, and the number
# and direction of a report.
OPEN = (
    gatt.GATT_REPORT_REFERENCE_DESCRIPTOR,
    gatt.GATT_PRIMARY_SERVICE_ATTRIBUTE_TYPE,
    gatt.GATT_CHARACTERISTIC_ATTRIBUTE_TYPE,
    gatt.GATT_CLIENT_CHARACTERISTIC_CONFIGURATION_DESCRIPTOR,
)


def touches(data):
    return {one.sequence: one for one in whole_frames(bytes(data)) if isinstance(one, Touch)}


@pytest.mark.parametrize(("mtu", "interval_s", "repeated"), [(23, 0.0, 0.0), (247, 0.05, 0.05)])
def test_all_frames_and_keys_arrive_where_a_packet_is_small_or_late(rig, mtu, interval_s, repeated):
    """Fails if a frame is cut, or if the queue of the stack fills before its time comes."""
    host = rig.host()
    host.connect(mtu if mtu > 23 else None)
    host.pair(rig.passkey())
    host.use()
    rig.board.set(exposure_us=2_780)
    host.send("stream touch")
    rig.run(0.2)
    rig.link.usb.plugged = False
    rig.air.interval_s, rig.air.repeated = interval_s, repeated
    host.data.clear()
    rig.received()
    for _ in range(10):
        rig.tap(3)
        rig.run(0.1)
    by_usb = touches(rig.received())
    rig.air.interval_s = 0.0
    rig.run(0.2)
    assert rig.board.command("get")["dropped"] == 0
    by_radio = touches(host.data)
    assert len(by_usb.keys() & by_radio.keys()) >= len(by_usb) - 1  # the first one may be cut
    assert all(by_usb[one] == by_radio[one] for one in by_usb.keys() & by_radio.keys())
    assert (pressed(host.reports), is_up(host.reports)) == ([FOUR] * 10, True)


def test_what_a_host_writes_to_the_keyboard_ends_no_firmware(rig):
    """Fails if a host that suspends, asks for the boot protocol, or writes nothing, stops keys."""
    host = rig.bonded()
    rig.link.usb.plugged = False
    rig.run(0.1)
    written = [
        one
        for one in host.peer.get_characteristics_by_uuid(gatt.GATT_REPORT_CHARACTERISTIC)
        if one.properties & gatt.Characteristic.Properties.WRITE
    ]
    for data in (b"", b"\0", b"\1", b"\xff" * 200):
        for uuid in (CONTROL, PROTOCOL):
            host.write(uuid, data, with_response=False)
        for one in written:
            host.wait(host.peer.write_value(one, data, with_response=True))
        rig.run(0.1)
    rig.tap(1)
    assert (pressed(host.reports), is_up(host.reports)) == ([TWO], True)
    assert rig.board.command("get")["fault"] is None


def test_a_flood_of_bytes_stops_neither_keys_nor_samples(rig):
    host = rig.bonded()
    rig.link.usb.plugged = False
    rig.run(0.1)
    missed = rig.board.command("get")["missed"]
    for i in range(40):
        for data in (b"\xff" * 200, b"\n" * 50, b"set gain=" + b"1" * 100):
            host.write(TO_BOARD, data, with_response=False)
        if i == 20:
            rig.press(1)
    rig.run(0.5)
    rig.lift()
    host.write(TO_BOARD, b"\n")
    rig.run(0.5)
    host.data.clear()
    host.send("hello")
    rig.run(0.2)
    assert [reply["re"] for reply in host.replies()] == ["hello"]
    assert (pressed(host.reports), is_up(host.reports)) == ([TWO], True)
    assert rig.board.command("get")["missed"] == missed


def test_only_who_made_the_board_can_be_read_without_a_bond(rig):
    """Fails if one of all handles is readable or writable: values, descriptors, long reads."""
    host = rig.host()
    host.connect()
    host.find()
    types = {one.handle: one.type for one in host.wait(host.peer.discover_attributes())}
    handles = [
        handle
        for service in host.peer.services
        if service.uuid in (gatt.GATT_HUMAN_INTERFACE_DEVICE_SERVICE, UUID(UART))
        for handle in range(service.handle, service.end_group_handle + 1)
        if types.get(handle) not in OPEN
    ]
    assert len(handles) >= 8
    for handle in handles:
        with pytest.raises(ATT_Error):
            host.wait(host.peer.read_value(handle))
        with pytest.raises(ATT_Error):
            host.wait(host.peer.write_value(handle, b"set gain=1\n", with_response=True))
    rig.tap(1)
    assert (host.reports, host.data) == ([], b"")
    assert rig.board.command("get")["gain"] != 1


def test_a_pairing_that_ends_at_any_step_leaves_a_board_that_can_pair(rig):
    """Fails if a half bond is taken for one, or if the board no longer advertises."""
    for steps in range(1, 60, 6):
        host = rig.host(address=f"C0:C1:C2:C3:C5:{steps:02d}")
        host.connect()
        host.passkey = rig.passkey()
        done = []

        async def pair(host=host, done=done):
            with suppress(*REFUSED):
                await host.connection.pair()
                done.append(host)

        rig.air.begin(pair())
        for _ in range(steps):
            rig.step()
        rig.air.remove(host.device)
        rig.run(0.1)
        hosts = rig.board.command("radio list")["hosts"]
        assert len(hosts) <= len(done)
        for address in hosts:
            rig.board.command("radio forget " + address)
    assert rig.bonded().connection


def test_a_board_that_has_a_host_takes_no_other_and_is_free_again_after_it(rig):
    host = rig.bonded()
    other = rig.host(address="C0:C1:C2:C3:C4:77")
    with pytest.raises(TimeoutError):
        other.connect()
    assert rig.board.command("radio list")["connected"]
    host.disconnect()
    rig.run(0.1)
    assert other.device.connections  # it has waited
    rig.air.remove(other.device)
    host.come_back()
    rig.run(0.1)
    assert rig.board.command("radio list")["connected"]


def test_a_host_without_secure_connections_needs_the_passkey_too(rig):
    host = rig.host(sc=False)
    host.connect()
    with suppress(*REFUSED):
        host.pair((rig.passkey() + 1) % 1_000_000)
    rig.run(0.5)
    assert rig.board.command("radio list")["hosts"] == []
