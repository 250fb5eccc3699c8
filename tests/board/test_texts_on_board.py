"""Texts in a real MicroPython, on both runtimes: stored after a question, typed, and ended."""

import random
from pathlib import Path

import pytest
from support.boards import store
from support.computer import text_of

from spots import cli
from spots.keyboard.hosts import host_of_file
from spots.keyboard.keys import new_texts, push
from spots.keyboard.layout import compiled
from spots_sim.person.typist import TypedText

pytestmark = pytest.mark.board

BOARDS = ["virtual", "virtual_circuitpython"]
FOUR_MM = [85 * (i + 0.5) / 4 for i in range(4)]
TEXT_KEY = 3
FILE = 'name = "x"\nhost = "us"\n[[layer]]\nname = "a"\nkeys = ["B", "C", "D", "text %s"]\n'


def layout(text):
    return compiled(Path("x"), FILE % text)


@pytest.fixture
def typing(rig, calibration, tmp_path):
    """Return a function that starts a board as a keyboard with a text on its last key."""

    def make(board, text):
        store(tmp_path, calibration=calibration, settings=["keys=1"])
        made = rig(folder=tmp_path, board=board)
        made.settle(0.3)
        push(made.board, layout(text))
        return made

    return make


def reports(made):
    return [data for number, data in made.link.usb.reports if number == 0]


def tap(made, i, seconds=0.06):
    made.press(FOUR_MM[i], 1500)
    made.settle(seconds)
    made.release()
    made.settle(seconds)


def random_text(seed, length):
    return "".join(random.Random(seed).choices("abcXYZ12!?.,-_aa", k=length))


# CircuitPython sends 100 reports a second, and is slow to simulate.
@pytest.mark.parametrize(("board", "steps", "taps"), [(BOARDS[0], 1024, 14), (BOARDS[1], 120, 6)])
def test_a_long_text_is_typed_beside_fingers(typing, board, steps, taps):
    text = random_text(1, steps)
    made = typing(board, text)
    tap(made, TEXT_KEY)
    for i in range(taps):
        tap(made, i % 3)
    assert len(reports(made)) < 2 * (len(text) + taps)  # the text is still being typed
    before = 0
    while before < len(reports(made)):
        before = len(reports(made))
        made.settle(0.5)
    assert text_of(reports(made)) == text + "".join("bcd"[i % 3] for i in range(taps))
    assert not any(reports(made)[-1])
    reply = made.board.command("get")
    assert (reply["dropped_reports"], reply["missed"]) == (0, 0)


WINDOWS = """
name = "x"
host = "es"
os = "windows"
[[layer]]
name = "a"
keys = ["caps_word", "ñ", {tap = "CAPS_LOCK", double = "F1"}, {text = "~aB"}]
"""


@pytest.mark.parametrize("board", BOARDS)
def test_a_board_types_what_the_host_has_and_each_key_for_its_time(typing, board):
    made = typing(board, "a")
    layout = compiled(Path("x"), WINDOWS)
    push(made.board, layout)
    made.settle(0.3)
    for i in (0, 1, 3, 2):
        tap(made, i)
        made.settle(0.6)
    shown, before = TypedText(host_of_file(layout.content)), bytes(8)
    found = reports(made)
    for report in found:
        for usage in set(report[2:]) - set(before[2:]) - {0x39}:
            assert report[0] == before[0]  # a modifier is a report of its own
            shown.key(7, usage, report[0], True)
        before = report
    assert shown.text == "Ñ~aB"  # the sign ends caps word
    assert not any(found[-1])


@pytest.mark.parametrize("board", BOARDS[:1])
@pytest.mark.parametrize("end", ["layout clear", "set keys=0", "sleep"])
def test_whatever_ends_a_text_leaves_all_keys_up(typing, board, end):
    text = random_text(2, 300)
    made = typing(board, text)
    tap(made, TEXT_KEY, 0.1)
    if end == "sleep":
        made.link.usb.asks = False
        made.settle(1.0)
        made.link.usb.asks = True
    else:
        made.board.command(end)
    made.settle(0.5)
    typed = text_of(reports(made))
    assert 0 < len(typed) < len(text)
    assert not any(reports(made)[-1])
    made.settle(0.5)
    assert text_of(reports(made)) == typed


def test_a_push_asks_before_it_stores_texts_that_the_board_does_not_have(
    rig, tmp_path, calibration
):
    made = rig(calibration=calibration)
    assert new_texts(made.board, layout("abc")) == ["text abc"]
    push(made.board, layout("abc"))
    assert new_texts(made.board, layout("abc")) == []
    assert new_texts(made.board, layout("abd")) == ["text abd"]
    # Text of one character, such as that of a dead key, is no question.
    assert new_texts(made.board, layout("a")) == []


def test_a_push_of_texts_without_a_terminal_needs_yes(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.toml").write_text(FILE % "secret", "utf-8")
    assert cli.main(["keys", "push", "mine.toml", "--port", "virtual"]) == 2
    shown = capsys.readouterr()
    assert "text secret\n" in shown.out
    assert "add --yes" in shown.err
    assert cli.main(["keys", "push", "mine.toml", "--port", "virtual", "--yes"]) == 0
    assert "x is on the board" in capsys.readouterr().out
    with pytest.raises(SystemExit) as ended:
        cli.main(["keys", "show", "mine.toml", "--yes"])
    assert ended.value.code == 2
    assert "only 'push' uses a board" in capsys.readouterr().err
