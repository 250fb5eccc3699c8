"""Wrong numbers in options and files: one sentence and exit code 2, never a traceback."""

import argparse
import json
import re
import shutil
from contextlib import suppress
from pathlib import Path

import pytest

from spots import SpotsError, cli
from spots.calibrate import calibration_file as file
from spots.calibrate.session.make import make
from spots.calibrate.session.session_file import Session
from spots.controller import controller_settings
from spots.keyboard import layout
from spots.wearable import wearable
from spots_linkage import mounted, twin_points
from spots_sim.strip import files

# A warning of NumPy would be a line beside the sentence.
pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")
OPTIONS = ["nan", "inf", "-inf", "1e999", "", "x", "9" * 400, "0x10", "1,200"]
# As JSON and as TOML; `NaN` and `null` are wrong syntax in one of them.
NUMBERS = [
    "NaN",
    "1e999",
    "1e6",
    "1e-300",
    "1e300",
    "-1e300",
    "-1",
    "0",
    '"1"',
    "null",
    "9" * 400,
    "true",
    "[]",
]


def numeric_options():
    """Return a pair of words for each option or argument of each command that takes a number."""
    parser = cli._parser()
    (commands,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    found = []
    for name, command in sorted(commands.choices.items()):
        add, command.command = command.command, None
        add(command)
        command.complete()
        taken = [a for a in command._actions if a.type is not None and a.option_strings]
        for action in taken:
            found.append((name, action.option_strings[-1]))
            types[found[-1]] = action.type
        needed = [a for a in command._actions if not a.option_strings and a.nargs is None]
        words[name] = [a.choices[0] if a.choices else "no-such-file" for a in needed]
    return found


words: dict[str, list[str]] = {}
types = {}  # of the values of options
NUMERIC = numeric_options()


def one_sentence(capsys, arguments):
    try:
        code = cli.main(arguments)
    except SystemExit as end:
        code = end.code
    errors = capsys.readouterr().err
    assert code == 2, arguments
    assert errors.count("\n") == 1, arguments
    assert "Traceback" not in errors


def test_there_are_options_with_numbers():
    assert ("calibrate", "--length-mm") in NUMERIC
    assert ("design", "--rate-hz") in NUMERIC
    assert len(NUMERIC) > 30


@pytest.mark.board
@pytest.mark.parametrize(("command", "option"), NUMERIC)
def test_a_wrong_number_of_an_option_is_one_sentence(command, option, capsys):
    accepted, refused = [], []
    for value in OPTIONS:
        try:
            types[command, option](value)
            accepted.append(value)
        except (argparse.ArgumentTypeError, ValueError):
            refused.append(value)
    # All refusals of a type come the same way.
    for value in [*accepted, *refused[:1]]:
        one_sentence(capsys, [command, *words[command], f"{option}={value}"])


@pytest.fixture(scope="module")
def sessions(staged, roughly):
    """Names and lines of a session with a stage and of a session by hand."""
    found = {"stage": staged, "hand": roughly}
    found = {name: (one / "a.jsonl").read_text().splitlines() for name, one in found.items()}
    # A fit of strained positions takes as long as all the rest.
    found["stage"] = [one for one in found["stage"] if json.loads(one)["kind"] != "strain"]
    return found


def paths_of(content, path=()):
    """Return the paths of all numbers in parsed JSON or TOML; of a list, its first number."""
    if isinstance(content, dict):
        return [p for key, one in content.items() for p in paths_of(one, (*path, key))]
    if isinstance(content, list | tuple):
        return paths_of(content[0], (*path, 0)) if content else []
    is_number = isinstance(content, int | float) and not isinstance(content, bool)
    return [path] if is_number else []


def replaced(content, path, mark):
    """Return parsed JSON or TOML with the text `mark` in place of the number at `path`."""
    key, *rest = path
    changed = dict(content) if isinstance(content, dict) else list(content)
    changed[key] = replaced(content[key], rest, mark) if rest else mark
    return changed


@pytest.mark.board
@pytest.mark.parametrize("kind", ["position", "force", "joint", "hand", "mark", "choose"])
def test_a_wrong_number_of_a_session_is_one_sentence(kind, sessions, tmp_path):
    lines = sessions["hand" if kind == "hand" else "stage"]
    at = [json.loads(line)["kind"] for line in lines].index(kind) + 1
    content = json.loads(lines[at])
    tried = 0
    for path in paths_of(content):
        for number in NUMBERS:
            line = json.dumps(replaced(content, path, "@")).replace('"@"', number)
            session = tmp_path / "b.jsonl"
            session.write_text("\n".join([*lines[:at], line, *lines[at + 1 :]]) + "\n")
            tried += 1
            with suppress(SpotsError):
                make(Session(session), say=lambda text: None)
    assert tried > 80


# The first number after `=`, alone, in a list or in a table.
TOML_NUMBER = re.compile(r"^[^#\n=]*=[^#\n\w\"]*?(?:\{[^\n]*?= )?(-?\d[\d.]*)\b", re.MULTILINE)
ARM = """bar_mm = [100.0, 100, 100, 100]
base_mm = 80
[[joint]]
calibration = "a.toml"
offset_deg = -108
gain = 1.0
[[joint]]
calibration = "b.toml"
"""


def toml_files(folder):
    """Return a loader and an original file for each kind of TOML file."""
    arm, made = folder / "arm.toml", folder / "made.toml"
    arm.write_text(ARM)
    shutil.copy(Path(__file__).parents[1] / "data" / "joint.toml", made)
    return [
        (lambda path: files.load(files.SensorFile, path), files.DATA / "sensors" / "real.toml"),
        (lambda path: files.load(files.ScenarioFile, path), files.DATA / "scenarios" / "fire.toml"),
        (
            lambda path: files.load(files.LinkageFile, path),
            files.DATA / "linkages" / "default.toml",
        ),
        (lambda path: files.load(files.PathFile, path), files.DATA / "paths" / "sust.toml"),
        (files.load_change, files.DATA / "changes" / "mixed.toml"),
        (controller_settings.load, controller_settings.DEFAULT),
        (layout.load, Path(layout.__file__).parent / "layouts" / "mini.toml"),
        (wearable.Mapping, Path(wearable.__file__).parent / "wearables" / "media.toml"),
        (mounted.load, arm),
        (file.load, made),
    ]


@pytest.mark.board
def test_a_wrong_number_of_a_toml_file_is_one_sentence(tmp_path):
    for load, original in toml_files(tmp_path):
        text = original.read_text().partition("[end]")[0]
        # One number of each name.
        places = {place[0].partition("=")[0]: place for place in TOML_NUMBER.finditer(text)}
        wrong = tmp_path / "wrong.toml"
        assert places, original
        for place in places.values():
            for number in NUMBERS:
                body = text[: place.start(1)] + number + text[place.end(1) :]
                # A calibration file has a checksum, which is right here.
                end = f'[end]\ncrc32 = "{file._crc32(body)}"\n' if load is file.load else ""
                wrong.write_text(body + end)
                with suppress(SpotsError):
                    load(wrong)


@pytest.mark.board
def test_a_wrong_number_of_a_table_of_points_is_one_sentence(tmp_path, capsys):
    (tmp_path / "arm.toml").write_text(ARM)
    rows = [[20 * i, 150.0, 4.0 * i, 3.0 * i, 0.01, 0.01] for i in range(12)]
    for column in range(len(twin_points.COLUMNS)):
        for number in (*OPTIONS, "1e300", "-1e300", "0"):
            lines = [",".join(map(str, row)) for row in rows]
            words = lines[3].split(",")
            words[column] = f'"{number}"'
            lines[3] = ",".join(words)
            (tmp_path / "p.csv").write_text("\n".join([",".join(twin_points.COLUMNS), *lines]))
            arm = ["--linkage", str(tmp_path / "arm.toml"), "--calibrate", str(tmp_path / "p.csv")]
            one_sentence(capsys, ["twin", *arm])
