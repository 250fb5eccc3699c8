"""Who may have what a strip says: bonds are made in a window, with a passkey, and stay."""

from contextlib import suppress

import pytest
from bumble import gatt
from bumble.att import ATT_Error
from bumble.core import ProtocolError
from bumble.pairing import PairingDelegate
from support.refusals import refusal

from radio_hosts import REFUSED, TO_BOARD, TO_HOST
from spots.errors import BoardError
from spots_sim.strip.scenario import Press

pytestmark = pytest.mark.board
NOTHING = PairingDelegate.IoCapability.NO_OUTPUT_NO_INPUT


def test_a_host_bonds_with_the_passkey_and_comes_back_after_a_reboot(rig):
    host = rig.bonded()
    assert rig.board.command("radio list")["hosts"] == ["c0:c1:c2:c3:c4:c5"]
    rig.board.command("reboot")
    rig.run(1.0)
    assert host.connection is None
    host.come_back()
    rig.run(0.1)
    assert rig.board.command("radio list")["connected"]


def test_a_wrong_passkey_makes_no_bond(rig):
    host = rig.host()
    host.connect()
    with pytest.raises(ProtocolError):
        host.pair((rig.passkey() + 1) % 1_000_000)
    rig.run(0.5)
    assert rig.board.command("radio list")["hosts"] == []


def test_a_host_that_types_no_passkey_makes_no_bond_even_in_the_window(rig):
    """Fails if pairing that a man in the middle can do passes for the passkey that was shown."""
    rig.passkey()
    host = rig.host(io=NOTHING, mitm=False)
    host.connect()
    host.pair(0)
    rig.run(0.5)
    found = rig.board.command("radio list")
    assert host.connection is None
    assert (found["hosts"], found["connected"]) == ([], False)


def test_what_a_host_wrote_that_was_refused_is_no_command_of_the_next_host(rig):
    """Fails if bytes wait in the stack until a trusted host has sent a line."""
    stranger = rig.host(io=NOTHING, mitm=False, address="C0:C1:C2:C3:C4:99")
    stranger.connect()
    stranger.find()

    async def pair_and_write():
        await stranger.connection.pair()
        port = stranger.characteristic(TO_BOARD)
        await stranger.peer.write_value(port, b"set gain=1\n", with_response=False)

    with suppress(*REFUSED):
        stranger.wait(pair_and_write())
    rig.run(0.5)
    assert stranger.connection is None
    host = rig.bonded()
    host.send("hello")
    rig.run(0.2)
    assert rig.board.command("get")["gain"] != 1


@pytest.mark.parametrize("io", [NOTHING, None])
def test_outside_the_window_nobody_bonds(rig, io):
    host = rig.host(io=io, mitm=False)
    host.connect()
    with suppress(*REFUSED):
        host.pair(0)
    rig.run(21.0)
    found = rig.board.command("radio list")
    assert host.connection is None  # the one connection is free again
    assert (found["hosts"], found["connected"]) == ([], False)


def test_a_stranger_with_the_address_of_a_host_ends_no_bond(rig):
    """Fails if the stack may delete the bond of a host that pairs again outside the window."""
    host = rig.bonded()
    host.disconnect()
    rig.air.remove(host.device)
    stranger = rig.host(io=NOTHING, mitm=False)
    stranger.connect()
    with suppress(*REFUSED):
        stranger.pair(0)
        stranger.use()
    rig.tap(1)
    rig.run(21.0)
    assert (stranger.reports, stranger.data) == ([], b"")
    rig.air.remove(stranger.device)
    again = rig.host(keys=host.device.keystore)
    again.come_back()
    rig.run(0.1)
    assert rig.board.command("radio list")["connected"]


def test_who_is_not_bonded_reads_writes_and_hears_nothing(rig):
    host = rig.host()
    host.connect()
    host.find()
    for uuid in (gatt.GATT_REPORT_MAP_CHARACTERISTIC, gatt.GATT_REPORT_CHARACTERISTIC, TO_HOST):
        with pytest.raises(ATT_Error):
            host.read(uuid)
    for uuid in (TO_BOARD, gatt.GATT_PROTOCOL_MODE_CHARACTERISTIC):
        with pytest.raises(ATT_Error):
            host.write(uuid, b"set gain=1\n")
        host.write(uuid, b"set gain=1\n", with_response=False)
    host.subscribe(encrypted=False)
    rig.tap(1)
    assert (host.reports, host.data) == ([], b"")
    assert rig.board.command("get")["gain"] != 1
    assert host.read(gatt.GATT_MANUFACTURER_NAME_STRING_CHARACTERISTIC) == b"SPOTS"


def test_a_forgotten_host_gets_nothing_and_can_pair_again(rig):
    host = rig.bonded()
    rig.board.command("radio forget c0:c1:c2:c3:c4:c5")
    rig.run(0.5)
    assert host.connection is None
    host.connect()
    with pytest.raises(REFUSED):
        host.encrypt()
    host.disconnect()
    host.device.keystore.all_keys.clear()
    host.connect()
    host.pair(rig.passkey())
    assert rig.board.command("radio list")["hosts"] == ["c0:c1:c2:c3:c4:c5"]


def test_a_host_that_forgot_its_bond_pairs_again_in_a_window(rig):
    host = rig.bonded()
    for _ in range(10):
        host.disconnect()
        host.device.keystore.all_keys.clear()
        host.connect()
        host.pair(rig.passkey())
        assert rig.board.command("radio list")["connected"]
    assert rig.board.command("radio list")["hosts"] == ["c0:c1:c2:c3:c4:c5"]


def test_a_fourth_host_is_refused_and_no_bond_is_lost(rig):
    for i in range(3):
        host = rig.bonded(address=f"C0:C1:C2:C3:C4:0{i}")
        host.disconnect()
    with refusal(BoardError, why="bad_value"):
        rig.board.command("radio pair")
    assert len(rig.board.command("radio list")["hosts"]) == 3


@pytest.mark.parametrize(
    "line", ["radio pair", "radio forget x", "set radio=off", "set gain=9 radio=hid"]
)
def test_a_command_that_changes_who_may_listen_goes_by_usb_only(rig, line):
    host = rig.bonded()
    host.send(line)
    rig.run(0.1)
    [reply] = host.replies()
    assert reply["why"] == "by_usb_only"


def test_three_firm_presses_let_one_host_bond_without_a_passkey(rig):
    """Fails if a wearer needs a cable, or if the board stays open to strangers."""
    rig.link.usb.plugged = False
    rig.run(0.1)
    for _ in range(3):
        rig.held.press = Press(30.0, 4000, 4.0)
        rig.run(2.2)
        rig.lift()
    host = rig.host(io=NOTHING, mitm=False)
    host.connect()
    host.pair(0)
    rig.run(0.1)
    assert rig.board.command("radio list")["connected"]
    host.disconnect()
    rig.run(2.5)
    stranger = rig.host(io=NOTHING, mitm=False, address="C0:C1:C2:C3:C4:99")
    stranger.connect()
    with suppress(*REFUSED):
        stranger.pair(0)
    rig.run(0.1)
    assert rig.board.command("radio list")["hosts"] == ["c0:c1:c2:c3:c4:c5"]
