"""The parts of a board: no part is too long, and a link needs no package for serial ports."""

import subprocess
import sys

import pytest

from spots.link import link


def loads(program):
    """Return the names of the modules that a program loads."""
    program += "\nimport sys; print(*sys.modules)"
    return {*subprocess.run([sys.executable, "-c", program], stdout=-1, text=True).stdout.split()}


@pytest.mark.board
def test_a_board_on_a_link_of_ones_own_needs_no_serial_ports():
    loaded = loads("from spots.link.board import Board")
    assert "spots.link.channel" in loaded
    assert not {"serial", "spots.link.serial_link", "spots.recording"} & loaded


@pytest.mark.board
def test_the_import_of_spots_is_light():
    assert not {"numpy", "serial", "msgspec", "rich"} & loads("import spots")


class Bytes(link.Link):
    name = "bytes"


class Replies(Bytes):
    def reply(self, line, timeout_s):
        return {}


@pytest.mark.parametrize("made", [Bytes, Replies])
def test_a_link_replies_itself_if_it_has_the_method(made):
    assert isinstance(made(), link.ReplyingLink) == (made is Replies)
    assert not isinstance(made(), link.FrameLink)
