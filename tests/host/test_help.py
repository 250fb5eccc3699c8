"""What the command line answers to a newcomer: help by purpose, examples, suggestions."""

import os
import re
import subprocess
import sys
from types import SimpleNamespace

import pytest

from spots.cli import main
from spots_device.command import Commands
from spots_device.settings import LIMITS

NAME = re.compile(r"^    ([a-z]+)\b", re.MULTILINE)


def printed(capsys, *arguments):
    with pytest.raises(SystemExit) as ended:
        main(list(arguments))
    output = capsys.readouterr()
    return ended.value.code, output.out + output.err


def test_the_list_of_commands_is_by_purpose(capsys):
    code, text = printed(capsys, "--help")
    assert code == 0
    blocks = [block.partition(":\n") for block in text.split("\n\n")]
    lists = {title: NAME.findall(rest) for title, _, rest in blocks}
    assert {"ports", "flash", "doctor", "calibrate"} <= set(lists["set up a board"])
    assert {"monitor", "command"} <= set(lists["look at a board"])
    assert {"keyboard", "controller"} <= set(lists["use a strip"])
    assert {"record", "replay"} <= set(lists["record and replay"])
    assert lists["share a board over the network"] == ["publish", "subscribe"]
    assert "demo" in lists["simulate, without hardware"]


def test_no_arguments_are_a_question_for_help(capsys):
    assert printed(capsys) == printed(capsys, "--help")


def test_every_command_has_a_description_and_an_example(capsys):
    _, text = printed(capsys, "--help")
    names = NAME.findall(text)
    assert len(names) > 20
    without = []
    for name in names:
        code, text = printed(capsys, name, "--help")
        description = text.split("\n\n")[1].replace("\n", " ")
        example = re.search(rf"^  spots {name}\b", text, re.MULTILINE)
        if code or not example or not re.match(r"[A-Z].*\.$", description):
            without.append(name)
    assert without == []


@pytest.mark.parametrize("columns", [60, 80, 120])
def test_help_fits_the_terminal(capsys, monkeypatch, columns):
    monkeypatch.setenv("COLUMNS", str(columns))
    _, text = printed(capsys, "--help")
    assert max(map(len, text.splitlines())) < columns


@pytest.mark.parametrize(
    ("arguments", "suggested"),
    [
        (["flsh", "pico"], "did you mean flash?"),
        (["Doctor"], "did you mean doctor?"),
        (["flash", "pico", "--prot", "x"], "there is no option --prot: did you mean --port?"),
        (["monitor", "--secnds=3"], "there is no option --secnds=3: did you mean --seconds"),
        (["keys", "chek", "mini"], "there is no 'chek': did you mean check?"),
        (["calibrate", "positon"], "did you mean position?"),
        (["export", "a.spots", "--to", "cvs"], "there is no 'cvs': there are mcap, csv, npz"),
        (["flash", "pico", "now"], "nothing takes the argument 'now'"),
        (["xyzzy"], "there are ports, boards, "),
    ],
)
def test_a_misspelt_word_is_answered_with_the_one_that_was_meant(capsys, arguments, suggested):
    code, text = printed(capsys, *arguments)
    assert code == 2
    assert suggested in text
    assert text.startswith("usage: spots")
    if arguments[0] in ("flash", "monitor"):
        assert text.startswith(f"usage: spots {arguments[0]} ")


def test_the_commands_of_a_board_are_listed_in_full(capsys):
    _, text = printed(capsys, "command", "--help")
    table = Commands(SimpleNamespace(use_calibration=None, use_layout=None))._table
    listed = text.partition("commands of the board:")[2].partition("\n\n")[0]
    assert set(table) <= set(re.findall(r"\w+", listed))
    assert {*LIMITS, "plan"} <= set(re.findall(r"\w+", listed))


def test_help_without_docstrings_is_short_but_there():
    run = subprocess.run(
        [sys.executable, "-OO", "-m", "spots", "command", "--help"],
        capture_output=True,
        text=True,
        env=os.environ,
        timeout=60,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert "--port" in run.stdout
