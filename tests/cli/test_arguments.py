"""Options that have no effect, are given twice or are abbreviated: one sentence, exit code 2."""

import argparse
import subprocess
import sys
from pathlib import Path

import pytest

from spots import cli

DATA = Path(__file__).parents[1] / "data"


def parsers():
    """Return the parser of each command, by its name, with its options."""
    parser = cli._parser()
    (commands,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    for command in commands.choices.values():
        add, command.command = command.command, None
        command.set_defaults(run=add(command))
        command.complete()
    return commands.choices


PARSERS = parsers()
OPTIONS = [
    (name, action)
    for name, parser in PARSERS.items()
    for action in parser._actions
    if action.option_strings and not isinstance(action, argparse._HelpAction)
]
NAMES = [f"{name} {action.option_strings[-1]}" for name, action in OPTIONS]


def refused(capsys, line):
    """Run ``spots`` with arguments that it must refuse with one line; return this line."""
    try:
        code = cli.main(line.split())
    except SystemExit as end:
        code = end.code
    output = capsys.readouterr()
    assert (code, output.out, output.err.count("\n")) == (2, "", 1), output
    return output.err


def values(action):
    """Return two values of an option; none for an option without a value."""
    if action.nargs == 0:
        return "", ""
    if action.choices:
        first, *_, last = action.choices
        return f"={first}", f"={last}"
    return ("=3000", "=3001") if "exposure" in action.dest else ("=30", "=31")


@pytest.mark.parametrize(("command", "action"), OPTIONS, ids=NAMES)
def test_no_option_has_an_abbreviation(command, action, capsys):
    option, value = action.option_strings[-1], values(action)[0]
    error = refused(capsys, f"{command} {option[:-1]}{value}")
    # Of two options that differ by their last letter only, the shorter one is an option.
    assert "there is no option" in error or option[:-1] in PARSERS[command]._option_string_actions


ONCE = [one for one in OPTIONS if not isinstance(one[1], argparse._AppendAction)]


@pytest.mark.parametrize(
    ("command", "action"), ONCE, ids=[f"{name} {one.option_strings[-1]}" for name, one in ONCE]
)
def test_an_option_given_twice_is_refused(command, action, capsys):
    (option, *_), (first, second) = action.option_strings, values(action)
    assert "it is given twice" in refused(capsys, f"{command} {option}{first} {option}{second}")


CHOSEN = [one for one in OPTIONS if one[1].choices]


@pytest.mark.parametrize(
    ("command", "action"), CHOSEN, ids=[f"{name} {one.option_strings[-1]}" for name, one in CHOSEN]
)
def test_a_value_that_an_option_does_not_offer_is_refused(command, action, capsys):
    option = action.option_strings[-1]
    assert option in refused(capsys, f"{command} {option} 7")


DESIGN = "design --length-mm 85 --resolution-um 50 --rate-hz 10"
NO_EFFECT = {
    f"{DESIGN} --breakout sparkx-17719": "add --out DIR",
    f"{DESIGN} --strips 2": "add --out DIR",
    f"{DESIGN} --test-dose 3": "add --measure-dye",
    f"{DESIGN} --test-length-mm 30": "add --measure-dye",
    f"{DESIGN} --sensor long_200mm": "add --measure-dye",
    f"{DESIGN} --port /dev/nope": "add --measure-dye",
    f"{DESIGN} --measure-dye --out x": "leave out --measure-dye",
    f"{DESIGN} --measure-dye --scenario quiet": "add --port virtual",
    "flash pico --yes": "add --runtime FILE.uf2",
    "flash pico --runtime no.uf2 --dry-run": (
        "to write the file that --runtime copies, use 'spots image'"
    ),
    "keys show mini --port nope": "only 'push' uses a board",
    "keys check mini --port nope": "only 'push' uses a board",
    "monitor --sensor long_200mm": "add --port virtual",
    "monitor --scenario=quiet --port /dev/nope": "add --port virtual",
    "record a.spots --seed 1": "add --port virtual",
    "monitor --zenoh-config a.json5": "add --port zenoh:ID",
    "monitor --wait --port virtual": "give a serial port or ble:NAME or zenoh:ID",
    "calibrate --seed 1": "add --port virtual",
    "calibrate joint --channels F1,F2,F3,F4,F5,F6": "the session has these settings already",
    "calibrate strain --strain-percent 5 --keep-settings": "the session has these settings already",
    "calibrate joint --length-mm 30": "a joint needs no length",
    "controller --calibrate --dry-run": "leave out --calibrate",
    "controller --calibrate --seconds 3": "leave out --calibrate",
    "controller --calibrate --port recording:a": "give the port of a board",
    "serve --scenario quiet": "add --port virtual",
    "serve --zenoh-config a.json5": "add --port zenoh:ID",
    "publish --to osc --zenoh-config a.json5": "add --to ros2",
    "publish --to osc --name a": "add --to ros2",
    "publish --to osc --qos reliable": "add --to ros2",
    "publish --to osc --depth 3": "add --to ros2",
    "twin --place-sigma-mm 1": "add --calibrate POINTS.csv",
    "twin --publish": "name the linkage file of real boards with --linkage",
    "twin --calibrate p.csv --seed 1": "name a simulated linkage with --linkage",
    "twin --port /dev/nope --path sust": "name a simulated linkage with --linkage",
    "twin --linkage arm.toml --port a --port b --measure p.csv --json": "leave out --measure",
    "twin --linkage arm.toml --port a --port b --measure p.csv --seconds 1": "leave out --measure",
    "characterize --presses 3": "add --rezero 3",
    "characterize --mark-error-um 30": "add --rezero 3",
    "rezero --joint --force-N 1": "a joint presses with its own indenter, and --use not at all",
    "rezero --joint --with finger": "a joint presses with its own indenter, and --use not at all",
    "rezero --use finger --marks 5": "--use presses nothing",
}


@pytest.mark.parametrize("line", NO_EFFECT)
def test_an_option_without_an_effect_is_refused(line, capsys):
    error = refused(capsys, line)
    assert f" has no effect here: {NO_EFFECT[line]}, or leave out --" in error


READ_ONLY = ["recording:a.spots", "zenoh:abc"]


@pytest.mark.parametrize("port", READ_ONLY)
@pytest.mark.parametrize(
    "line",
    ["calibrate", "rezero", "dark", "publish", "keys push mini", f"{DESIGN} --measure-dye"],
)
def test_a_command_that_changes_a_board_takes_no_board_that_cannot_change(line, port, capsys):
    error = refused(capsys, f"{line} --port {port}")
    assert f"this command cannot use '{port}': give a serial port or ble:NAME or 'virtual'" in error


def test_a_recording_is_not_recorded_again(capsys):
    error = refused(capsys, "record b.spots --port recording:a.spots")
    assert (
        "cannot use 'recording:a.spots': give a serial port or ble:NAME, 'virtual' or zenoh:ID"
        in error
    )


@pytest.mark.parametrize("line", ["record a.spots", "calibrate", "publish", "keyboard --dry-run"])
def test_no_board_offers_only_what_the_command_takes(line, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("spots.link.connect.find", lambda: ([], []))
    error = refused(capsys, line)
    assert "no board found: plug a board in, or give " in error
    assert ("recording" in error) == line.startswith("keyboard")


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("record no/a.spots", "there is no folder no: make it first"),
        ("calibrate --channels F1,F2", "--channels: a channel plan needs six different diodes"),
        ("calibrate --channels F1,F2,F3,F4,F5,F9", "--channels: no diode is called 'F9'"),
        ("calibrate --places 3", "--places must be from 12 to 1000 for 'fine'"),
        ("calibrate --places 2000 --rough", "--places must be from 8 to 1000 for 'rough'"),
        ("rezero TABLE --force-N 50", "50 N is not a force of this calibration"),
        ("flash pico --strips 0", "pico can have 1 to 2 strips, not 0: change --strips"),
        ("build pico --strips nan", "argument --strips: 'nan' is not a whole number"),
        ("export a.spots --to npz --out a.csv", "a.csv is the name of a csv file, but the format"),
        ("export a.spots --to csv --out a.MCAP", "a.MCAP is the name of a mcap file, but the"),
        ("subscribe a.spots", "'a.spots' is not a topic of ROS 2: give one such as"),
        ("publish --name 1a --port x", "'1a' is not the name of a node"),
        ("publish --to ros2=233 --port x", "'233' is not a ROS domain: give a number from 0 to"),
    ],
)
def test_wrong_values_are_reported_before_a_board_is_searched(line, says, capsys):
    made = str(DATA / "joint.toml")
    assert says in refused(capsys, line.replace("TABLE", made))


def test_a_negative_number_is_a_value_and_no_option(capsys):
    assert "must be a whole number from 0" in refused(capsys, "demo --seed -1")


@pytest.mark.board
def test_help_offers_the_ports_that_a_command_takes():
    shown = subprocess.run(
        [sys.executable, "-m", "spots", "publish", "--help"], capture_output=True, text=True
    ).stdout
    assert "recording:" not in shown
    assert "'virtual'" in shown
