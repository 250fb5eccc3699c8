"""The port ``ble:NAME``: bleak's own client and scanner, on an adapter that Bumble simulates."""

import pytest
from bleak.exc import BleakGATTProtocolError
from support.refusals import refusal

from bleak_backends import Adapter
from spots.errors import PortError
from spots.link.board import Board
from spots.link.frames import Touch
from spots_ble import ble_link
from spots_ble.ble_link import BleLink

pytestmark = pytest.mark.board


@pytest.fixture
def computer(rig, monkeypatch):
    """Return a function that gives the rig's air a computer with bleak, bonded or not."""
    monkeypatch.setattr(ble_link, "_FIND_S", 1.0)
    made = []

    def make(bonded=True):
        host = rig.bonded() if bonded else rig.host()
        if bonded:
            host.disconnect()
        adapter = Adapter(rig, host)
        made.append(adapter)
        adapter.open = lambda target: Board(BleLink(target, adapter.scanner(), adapter.client()))
        return adapter

    yield make
    for one in made:
        one.stop()


def test_a_board_by_radio_is_read_like_one_on_usb(rig, computer):
    with computer().open("") as board:
        assert board.port.startswith("ble:SPOTS ")
        touches = []
        for frame in board.frames(5.0):
            if isinstance(frame, Touch):
                touches.append(frame)
            if len(touches) == 100:
                break
        assert board.stats.lost == 0
        # The board's time: simulated time has no fixed speed.
        assert touches[-1].t_us - touches[0].t_us == pytest.approx(990_000, abs=50_000)


def test_a_connection_that_ends_is_made_again(rig, computer):
    adapter = computer()
    with adapter.open("F0:F1:F2:F3:F4:F5") as board:
        frames = (frame for frame in board.frames() if isinstance(frame, Touch))
        before = next(frames).time_s
        adapter.drop()
        after = next(frame.time_s for frame in frames if frame.time_s > before + 1.0)
        assert after < before + 10.0


def test_a_write_that_the_stack_of_the_board_has_no_memory_for_is_sent_again(computer):
    """Fails if a bonded computer is told to pair."""
    adapter = computer()
    errors = [BleakGATTProtocolError(0x11), BleakGATTProtocolError(0x11)]

    class Client(adapter.client()):
        async def write_gatt_char(self, *arguments, **options):
            if errors:
                raise errors.pop()
            return await super().write_gatt_char(*arguments, **options)

    with Board(BleLink("", adapter.scanner(), Client)) as board:
        assert board.command("get")["radio"] == "both"
    assert not errors


def test_a_computer_that_is_not_bonded_is_told_how_to_pair(rig, computer):
    with refusal(PortError) as caught:
        computer(bonded=False).open("")
    assert "spots radio pair" in str(caught.value)


def test_a_board_that_is_not_in_reach_is_named(rig, computer):
    with refusal(PortError) as caught:
        computer(bonded=False).open("SPOTS ffff")
    assert "no board SPOTS ffff is in reach" in str(caught.value)
