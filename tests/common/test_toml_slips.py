"""Wrong keys in all TOML files: the error suggests the right key, or lists the valid ones."""

import msgspec
import pytest

from spots import SpotsError
from spots.calibrate import calibration_file
from spots.common import toml
from spots.controller import controller_settings
from spots.deploy import staging
from spots.keyboard import layout
from spots.wearable import wearable
from spots_linkage import mounted
from spots_sim.strip import files

LAYER = 'name = "x"\n[[layer]]\nname = "a"\nkeys = '
SLIPS = [
    ("layout", LAYER + '[{ tap = "A", hodl = "B" }]', "did you mean hold?"),
    ("layout", LAYER + '["A"]\n[tuning]\nflavor = "tap-prefered"', "did you mean tap-preferred?"),
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
        ("linkage", {"bar_mm": [9, 0, 9, 9]}, "entry 2 of bar_mm must be a number of at least 1.0"),
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
    with pytest.raises(toml.WrongKeyError) as refused:
        toml.convert(content, KINDS[name])
    assert str(refused.value) == says


def test_wrong_syntax_is_named_with_its_line():
    with pytest.raises(msgspec.ValidationError, match=r"^wrong TOML syntax: .* line 2, column 5"):
        toml.loads("a = 1\nb = \n")


def test_a_wrong_layout_is_reported_with_the_line_of_its_key(tmp_path):
    path = tmp_path / "my.toml"
    path.write_text(LAYER + '["A", { tap = "B", wdith = 2 }]')
    with pytest.raises(SpotsError, match="line 4: unknown key 'wdith' in entry 2 of keys"):
        layout.load(path)


def test_a_file_that_is_not_text_is_reported_with_this_reason(tmp_path):
    path = tmp_path / "my.toml"
    path.write_bytes(b"name = '\xff'\n")
    with pytest.raises(SpotsError, match=r"my\.toml is not UTF-8 text, .*: save it as UTF-8"):
        layout.load(path)
