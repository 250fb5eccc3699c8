"""Wrong keys in all TOML files: the error suggests the right key, or lists the valid ones."""

from datetime import date, datetime
from typing import Annotated, Any, Literal, Optional, Union

import pytest
from msgspec import Meta
from support.refusals import refusal

from spots import SpotsError
from spots.calibrate import calibration_file
from spots.common import schema, toml
from spots.controller import controller_settings
from spots.deploy import staging
from spots.errors import FileError
from spots.keyboard import layout
from spots.wearable import wearable
from spots_linkage import mounted
from spots_sim.strip import files

LAYER = 'name = "x"\n[[layer]]\nname = "a"\nkeys = '
SLIPS = [
    ("layout", LAYER + '[{ tap = "A", hodl = "B" }]', "did you mean hold?"),
    ("layout", LAYER + '["A"]\n[tuning]\nflavor = "tap-prefered"', "did you mean tap-preferred?"),
    (
        "layout",
        "[layer]\nname = 'a'\n[layer]\nname = 'b'",
        r"write \[\[layer\]\] with two brackets",
    ),
    ("board", "titel = 'x'", "did you mean title?"),
    ("board", "title = 'x'\nruntime = 'micropithon'\n[device]", "did you mean micropython?"),
    ("calibration", "bord = 'x'", "did you mean board?"),
    ("controller", "[x]\nfrom = 'force'\nsmooth = { bta = 1 }", "did you mean beta?"),
    (
        "controller",
        "[x]\nfrom = 'force'\nbogus = 1",
        "valid names are from, deadband, expo, .*max_mN",
    ),
    ("controller", "[[button]]\nwhen = 'tapped'\nnumber = 1\nlongst_ms = 3", "mean longest_ms?"),
    ("wearable", "least_confidense = 1", "did you mean least_confidence?"),
    ("linkage", "bars_mm = 3", "did you mean bar_mm or base_mm?"),
    ("simulated linkage", "base_eror_percent = 3", "did you mean base_error_percent?"),
    ("sensor", "lenght_mm = 3", "did you mean length_mm?"),
    ("sensor", "[led]\ncolour = 3", "valid names are blue_nm, "),
    ("path", "speed_mms = 3", "did you mean speed_mm_s?"),
    ("scenario", "[faults.i2c]\nnacks = 1", "valid names are nack_percent, nack_bursts, "),
    ("scenario", "[faults.power]\nbrown_out = { per_min = 1 }", "did you mean brown_outs?"),
]
KINDS = {
    "board": staging.Device,
    "calibration": calibration_file.CalibrationFile,
    "controller": controller_settings.ControllerSettings,
    "linkage": mounted.Mounted,
    "simulated linkage": files.LinkageFile,
    "sensor": files.SensorFile,
    "path": files.PathFile,
    "scenario": files.ScenarioFile,
}
# Words for a kind of file in messages, where they differ from its name here.
WORDS = {"controller": "settings", "simulated linkage": "linkage"}


def read(kind, path):
    """Read a TOML file of a kind (a key of `KINDS`, ``layout`` or ``wearable``) as `spots` does."""
    if kind == "layout":
        return layout.load(path)
    if kind == "wearable":
        return wearable.Mapping(path)
    return toml.checked(path.read_text(), KINDS[kind], WORDS.get(kind, kind), path)


@pytest.mark.parametrize(("kind", "text", "says"), SLIPS)
def test_a_slip_is_answered_with_what_was_meant(tmp_path, kind, text, says):
    path = tmp_path / "my.toml"
    path.write_text(text)
    with pytest.raises(SpotsError, match=says) as refused:
        read(kind, path)
    assert str(path) in str(refused.value)


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("linkage", {}, "the key 'bar_mm' is missing: add it"),
        ("controller", {"x": {"deadband": 0.1}}, "the key 'from' is missing in table x: add it"),
        ("linkage", {"bar_mm": [9, 0, 9, 9]}, "entry 2 of bar_mm must be a number of at least 1"),
        ("linkage", {"bar_mm": [9, 9]}, "bar_mm must be a list of 4 entries, not 2"),
        ("sensor", {"length_mm": "x"}, "length_mm must be a number, not text"),
        (
            "controller",
            {"button": [{"when": "pressed", "number": 1.0}]},
            "number in entry 1 of button must be a whole number, not a decimal number",
        ),
        (
            "controller",
            {"button": [{"when": "presed", "number": 1}]},
            "when in entry 1 of button cannot be 'presed': did you mean pressed?",
        ),
    ],
)
def test_the_error_names_the_key_in_the_words_of_the_file(name, content, says):
    with pytest.raises(schema.WrongKeyError) as refused:
        schema.convert(content, KINDS[name])
    assert str(refused.value) == says


class Tap(toml.Strict, tag_field="when", tag="tapped"):
    number: int = 0


class Press(toml.Strict, tag_field="when", tag="pressed"):
    force: int = 0


class Everything(toml.Strict):
    """A key of each type that a file may have."""

    flag: bool = False
    whole: Annotated[int, Meta(ge=2, lt=9)] = 2
    number: Annotated[float, Meta(gt=0, le=3)] = 1.0
    text: Annotated[str, Meta(min_length=1, max_length=3)] = "x"
    day: Optional[datetime] = None
    level: Literal[0, 1] = 0
    flavor: Literal["tap", "hold"] = "tap"
    pin: Union[int, str, None] = None
    pair: tuple[int, float] = (0, 0.0)
    six: Annotated[tuple[int, ...], Meta(min_length=6, max_length=6)] = (0,) * 6
    few: Annotated[list[int], Meta(max_length=2)] = []
    shares: dict[str, dict[str, Annotated[float, Meta(le=1)]]] = {}
    free: dict[str, Any] = {}
    button: list[Union[Tap, Press]] = []
    other: Optional[Tap] = None

    def __post_init__(self):
        if self.level and not self.flag:
            raise ValueError("level needs flag")


class Outside(toml.Strict):
    inside: list[Everything]


WRONG = [
    ({"flag": 1}, "flag must be true or false, not a whole number"),
    ({"whole": True}, "whole must be a whole number, not true or false"),
    ({"whole": 2.0}, "whole must be a whole number, not a decimal number"),
    ({"whole": 1}, "whole must be a whole number of at least 2"),
    ({"whole": 9}, "whole must be a whole number of less than 9"),
    ({"number": 0}, "number must be a number of more than 0"),
    ({"number": 3.5}, "number must be a number of at most 3"),
    ({"number": date(2026, 1, 1)}, "number must be a number, not a date"),
    ({"text": ""}, "text must be text of at least 1 character, not 0"),
    ({"text": "long"}, "text must be text of at most 3 characters, not 4"),
    ({"day": "soon"}, "day must be a date with a time, not text"),
    ({"level": 2}, "level must be 0 or 1, not 2"),
    ({"level": "0"}, "level must be a whole number, not text"),
    ({"flavor": "hodl"}, "flavor cannot be 'hodl': did you mean hold?"),
    ({"pin": 1.5}, "pin must be a whole number or text, not a decimal number"),
    ({"pair": [1]}, "pair must be a list of 2 entries, not 1"),
    ({"pair": [1, "x"]}, "entry 2 of pair must be a number, not text"),
    ({"six": [1]}, "six must be a list of 6 entries, not 1"),
    ({"few": [1, 2, 3]}, "few must be a list of at most 2 entries, not 3"),
    ({"shares": {"a": {"b": 2}}}, "shares.a.b must be a number of at most 1"),
    ({"free": []}, "free must be a table, not a list"),
    ({"button": [{}]}, "the key 'when' is missing in entry 1 of button: add it"),
    ({"button": [{"when": []}]}, "when in entry 1 of button must be text, not a list"),
    (
        {"button": [{"when": "tapped", "force": 1}]},
        "unknown key 'force' in entry 1 of button: valid names are when, number",
    ),
    ({"other": {"when": "pressed"}}, "other.when cannot be 'pressed': valid names are tapped"),
    ({"other": {"when": "tapped", "numbr": 1}}, "unknown key 'numbr' in table other: did you"),
    ({"level": 1}, "level needs flag"),
]


@pytest.mark.parametrize(("content", "says"), WRONG)
def test_each_type_of_key_is_refused_in_the_words_of_a_file(content, says):
    with pytest.raises(schema.WrongKeyError) as refused:
        schema.convert(content, Everything)
    assert str(refused.value).startswith(says)
    with pytest.raises(schema.WrongKeyError) as refused:
        schema.convert({"inside": [{}, content]}, Outside)
    assert "entry 2 of inside" in str(refused.value)
    assert refused.value.keys[0] == "inside"


def test_a_valid_value_of_each_type_is_no_fault_beside_another_one():
    valid = {
        "flag": True,
        "whole": 8,
        "number": 3,
        "text": "xyz",
        "day": "2026-01-01T00:00:00Z",
        "level": 1,
        "flavor": "hold",
        "pin": "D5",
        "pair": [1, 2],
        "six": [0] * 6,
        "few": [],
        "shares": {"a": {"b": -5}},
        "free": {"x": [{}]},
        "button": [{"when": "tapped", "number": 2}, {"when": "pressed"}],
        "other": {"when": "tapped"},
    }
    assert schema.convert(valid, Everything).pair == (1, 2)
    with pytest.raises(schema.WrongKeyError) as refused:
        schema.convert({**valid, "bogus": 1}, Everything)
    assert refused.value.keys == ["bogus"]


def test_an_error_of_a_file_has_its_line_or_its_key_as_place(monkeypatch, tmp_path):
    path = tmp_path / "my.toml"
    for text, place in [
        ("flag = 1", "flag"),
        ("inside = [{}, {shares = {a = {b = 2}}}]", "inside"),
        ("flag = true\nnumber = inf", "line 2"),
        ("\n\nwhole = " + 400 * "9", "line 3"),
    ]:
        with refusal(FileError, path=str(path), place=place):
            toml.checked(text, Everything, "test", path)
    with refusal(FileError, place="inside.shares.a.b"):
        toml.checked("[[inside]]\nshares = {a = {b = 2}}", Outside, "test", path)

    def wrong_at_line_7(text, parse_float):
        error = toml.tomllib.TOMLDecodeError("Invalid value")
        error.lineno = 7  # as from Python 3.14 on
        raise error

    monkeypatch.setattr(toml.tomllib, "loads", wrong_at_line_7)
    with refusal(FileError, place="line 7"):
        toml.checked("", Everything, "test", path)


def test_wrong_syntax_is_named_with_its_line():
    with pytest.raises(schema.WrongTomlError) as wrong:
        toml.loads("a = 1\nb = \n")
    assert "wrong TOML syntax: Invalid value (at line 2, column 5)" in str(wrong.value)


def test_a_wrong_layout_is_reported_with_the_line_of_its_key(tmp_path):
    path = tmp_path / "my.toml"
    path.write_text(LAYER + '["A", { tap = "B", wdith = 2 }]')
    with refusal(FileError, place="line 4", file="my.toml"):
        layout.load(path)


def test_a_file_that_is_not_text_is_reported_with_this_reason(tmp_path):
    path = tmp_path / "my.toml"
    path.write_bytes(b"name = '\xff'\n")
    with refusal(FileError, file="my.toml"):
        layout.load(path)
