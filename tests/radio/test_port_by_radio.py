"""Frames and commands by radio are those of the serial port."""

import pytest
from support.boards import store
from support.refusals import refusal

from radio_hosts import whole_frames
from spots.errors import BoardError
from spots.link.board import Board
from spots.link.frames import Touch
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.scenario import Held

pytestmark = pytest.mark.board


def test_a_host_gets_no_frames_until_it_sends_a_command(rig):
    """Fails if a phone that only wants a keyboard gets a hundred frames a second."""
    host = rig.bonded()
    rig.run(0.5)
    assert not host.data
    host.send("hello")
    rig.run(0.5)
    assert host.replies()[0]["board"] == "virtual"


@pytest.mark.parametrize("exposure_us", [10_000, 2_780])
def test_the_radio_carries_every_frame_that_usb_gets(rig, exposure_us):
    host = rig.bonded()
    rig.board.set(exposure_us=exposure_us)
    host.send("stream touch")
    rig.run(0.1)
    host.data.clear()
    rig.received()
    rig.run(5.0)
    by_usb = {f.sequence: f for f in whole_frames(rig.received()) if isinstance(f, Touch)}
    by_radio = {f.sequence: f for f in whole_frames(bytes(host.data)) if isinstance(f, Touch)}
    assert len(by_radio) > 4e6 / exposure_us
    first, last = min(by_radio), max(by_radio)
    assert [*by_radio] == list(range(first, last + 1))  # none is lost, and they are in order
    assert all(by_usb[number] == by_radio[number] for number in by_usb.keys() & by_radio.keys())


def test_what_the_air_does_not_take_is_counted_and_later_frames_arrive(rig):
    host = rig.bonded()
    host.send("stream touch")
    rig.run(0.1)
    rig.air.holds = True
    rig.run(1.0)
    rig.air.holds = False
    host.data.clear()
    rig.run(0.5)
    assert 0 < rig.board.command("get")["dropped"] < 100
    assert len([f for f in whole_frames(bytes(host.data)) if isinstance(f, Touch)]) > 40


def test_a_line_by_usb_and_one_by_radio_do_not_mix(rig):
    host = rig.bonded()
    host.send("hello")
    rig.run(0.1)
    host.data.clear()
    rig.link.write(b"hel")
    rig.run(0.02)
    host.send("sync")
    rig.run(0.02)
    rig.link.write(b"lo\n")
    rig.run(0.1)
    assert [reply["re"] for reply in host.replies() if "re" in reply] == ["hello", "sync"]


def test_a_radio_that_cannot_be_switched_on_is_a_fault_that_hello_tells(tmp_path, sensor):
    """Fails if a board whose radio is broken loses its cable, too."""
    store(tmp_path, settings=["radio=both", "keys=1"])
    with Board(LockstepLink(sensor, Held(), folder=tmp_path)) as board:
        (fault,) = board.command("hello")["boot"]
        assert "the radio cannot be switched on" in fault
        with refusal(BoardError, why="no_radio"):
            board.command("radio pair")


def test_a_line_that_is_too_long_is_refused_as_a_whole(rig):
    """Fails if its end is taken for a command."""
    host = rig.bonded()
    host.send("x" * 256 + "set gain=1")
    rig.run(0.2)
    (reply,) = host.replies()
    assert reply["why"] == "bad_line"
    assert rig.board.command("get")["gain"] != 1
