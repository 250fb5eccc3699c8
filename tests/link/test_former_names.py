"""Former names of commands and of values in replies: refused with the present name, or read."""

import pytest
from support.stand_in_link import StandIn

from spots.errors import SettingError
from spots.link.board import Board
from spots.link.former_names import present


@pytest.mark.parametrize(
    ("line", "former", "now"),
    [
        ("auto", "auto", "autoexpose"),
        ("rest sensor=1", "rest", "tare"),
        ("set gain=9 plan=F1,F2,F3,F4,F5,F6", "plan", "channels"),
    ],
)
def test_a_former_name_is_answered_with_the_present_one(line, former, now):
    link = StandIn(1)
    board = Board(link)
    sent = len(link.lines)
    with pytest.raises(SettingError, match=f"'{former}' is now '{now}'"):
        board.command(line)
    assert len(link.lines) == sent


def test_replies_of_older_recordings_have_the_present_names():
    assert present({"re": "set", "plan": ["F1"]}) == {"re": "set", "channels": ["F1"]}
    assert present({"re": "rest"}) == {"re": "tare"}
    assert present({"re": "get", "rest": [1] * 6}) == {"re": "get", "baseline": [1] * 6}
    assert present({"re": ["rest"]}) == {"re": ["rest"]}
