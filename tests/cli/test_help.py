"""Help of the command line for a new user: sorted by purpose, with examples and suggestions."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import spots
from spots.cli import glyphs, main
from spots_device.board.command import Commands
from spots_device.board.settings import LIMITS

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
    assert {"ports", "flash", "doctor", "calibrate", "radio"} <= set(lists["set up a board"])
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
        (
            ["design", "--lenght-mm", "60"],
            "there is no option --lenght-mm: did you mean --length-mm",
        ),
        (["--verson"], "there is no option --verson: did you mean --version?"),
        (["command", "get", "-x"], "there is no option -x"),
        (["keys", "chek", "mini"], "there is no 'chek': did you mean check?"),
        (["calibrate", "positon"], "did you mean position?"),
        (["flash", "pico", "now"], "unexpected argument 'now'"),
        (["xyzzy"], "valid names are ports, boards, "),
    ],
)
def test_a_misspelt_word_is_answered_with_the_one_that_was_meant(capsys, arguments, suggested):
    code, text = printed(capsys, *arguments)
    assert code == 2
    assert suggested in text
    assert text.count("\n") == 1
    if arguments[0] in ("flash", "monitor"):
        assert text.startswith(f"spots {arguments[0]}: ")


def test_a_mistake_without_a_suggestion_names_the_help(capsys):
    code, text = printed(capsys, "flash")
    assert code == 2
    assert text == (
        "spots flash: the following arguments are required: BOARD; see 'spots flash --help'\n"
    )


def test_the_commands_of_a_board_are_listed_in_full(capsys):
    _, text = printed(capsys, "command", "--help")
    table = Commands._TABLE
    listed = text.partition("commands of the board:")[2].partition("\n\n")[0]
    assert set(table) <= set(re.findall(r"\w+", listed))
    assert {*LIMITS, "channels"} <= set(re.findall(r"\w+", listed))


@pytest.mark.board
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


@pytest.mark.board
def test_a_locale_without_unicode_gets_plain_characters(tmp_path):
    path = tmp_path / "my.toml"
    keys = '{ tap = "A", label = "\N{LATIN SMALL LETTER E WITH ACUTE}" }, "B"'
    path.write_text(f'name = "x \N{FULL BLOCK}"\n[[layer]]\nname = "a"\nkeys = [{keys}]\n', "utf-8")
    plain = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    for what, shown in (("check", "x #: 2 keys"), ("show", "x #")):
        run = subprocess.run(
            [sys.executable, "-m", "spots", "keys", what, str(path)],
            capture_output=True,
            env=os.environ | plain,
            timeout=60,
            check=False,
        )
        assert run.returncode == 0, run.stderr
        assert shown in run.stdout.decode("ascii")


def test_every_glyph_of_a_picture_has_a_plain_character():
    views = ("terminal/view.py", "calibrate/session/guide.py", "controller/stick.py")
    text = "".join((Path(spots.__file__).parent / name).read_text("utf-8") for name in views)
    assert [c for c in set(text) if not c.isascii() and c not in glyphs.PLAIN] == []
    assert all(len(plain) == 1 and plain.isascii() for plain in glyphs.PLAIN.values())


@pytest.mark.parametrize(
    "line",
    [
        "monitor --port A --port B",
        "flash pico --port=A --port=B",
        "record x.spots --port A --port A",
        "design --length-mm 60 --length-mm 70",
        "calibrate --session a --session b",
        "demo --use keyboard --use wearable",
    ],
)
def test_an_option_with_one_value_is_refused_when_it_is_given_twice(capsys, line):
    code, text = printed(capsys, *line.split())
    assert code == 2
    assert "it is given twice, as '" in text
    assert "leave out one of them" in text
