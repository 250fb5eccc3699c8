"""The protocol between simulator and virtual boards: equal constants on all systems."""

import errno

import pytest

from spots_sim.board.protocol import protocol
from spots_sim.board.usb import UsbHost


def test_a_full_endpoint_has_the_number_that_the_board_knows(monkeypatch):
    monkeypatch.setattr(errno, "EAGAIN", 35)  # as on macOS
    host = UsbHost()
    host.asks = False
    host.offer(0, b"a")
    with pytest.raises(BlockingIOError) as full:
        host.offer(0, b"b")
    assert full.value.errno == protocol.EAGAIN
