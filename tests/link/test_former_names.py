"""Former names of commands and of values in replies: refused with the present name, or read."""

import pytest
from support.stand_in_link import StandIn

from spots.errors import SettingError
from spots.link.board import Board
from spots.link.former_names import present


@pytest.mark.parametrize(("former", "now"), [("auto", "autoexpose"), ("rest", "tare")])
def test_a_former_command_is_answered_with_its_present_name(former, now):
    link = StandIn(1)
    board = Board(link)
    sent = len(link.lines)
    with pytest.raises(SettingError, match=f"'{former}' is now '{now}'"):
        board.command(former)
    assert len(link.lines) == sent


def test_replies_of_older_recordings_have_the_present_names():
    assert present({"re": "rest"}) == {"re": "tare"}
    assert present({"re": "get", "rest": [1] * 6}) == {"re": "get", "baseline": [1] * 6}
    assert present({"re": ["rest"]}) == {"re": ["rest"]}
