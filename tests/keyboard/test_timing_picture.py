"""Picture and table of tap and hold in docs/type/tap-hold.md are those of the engine."""

import re
from pathlib import Path
from xml.etree import ElementTree

from spots.keyboard import timing_picture, trial
from spots.keyboard.key_layout import FLAVORS
from spots_device.keys.layout import RETRO_TAP

DOCS = Path(__file__).parents[2] / "docs"
_RECT = "{http://www.w3.org/2000/svg}rect"


def first(flavor, gesture):
    """Return when the key is decided, as a share of the tapping term, and what it is."""
    span = next(one for one in trial.play(flavor, gesture) if one.what != "other")
    return round(span.begin_ms / trial.TERM_MS, 1), span.what


def test_the_table_of_the_flavors_is_that_of_the_engine():
    text = (DOCS / "type" / "tap-hold.md").read_text(encoding="utf-8")
    rows = dict(
        re.findall(r"^\| `([\w-]+)`(?: \(default\))? (\|(?:[^|]*\|){4})$", text, re.MULTILINE)
    )
    for flavor, name in enumerate(FLAVORS):
        pressed, released, late, before = (cell.strip() for cell in rows[name].split("|")[1:5])
        down, up = trial.GESTURES["nested"][1]
        assert first(flavor, "held") == (1.0, late)
        assert first(flavor, "tap") == (0.5, before)
        at, what = first(flavor, "nested")
        expected = (down, pressed) if pressed else (up, released) if released else (0.9, before)
        assert (at, what) == expected, name


def test_a_retro_tap_is_a_hold_only_beside_another_key():
    for flavor in range(len(FLAVORS)):
        assert first(flavor + RETRO_TAP, "held")[1] == "tap"
        is_tap = FLAVORS[flavor] == "tap-unless-interrupted"
        assert first(flavor + RETRO_TAP, "later") == ((1.0, "tap") if is_tap else (1.3, "hold"))


def test_the_picture_shows_each_finger_and_each_key():
    root = ElementTree.fromstring(timing_picture.picture(FLAVORS.index("balanced")))
    kinds = [rect.get("class") for rect in root.iter(_RECT)]
    alone, beside = ["touch"], ["touch", "second"]
    tap, hold, other = "gets-tap", "gets-hold", "gets-other"
    assert kinds == [
        *(*alone, tap, *alone, hold),
        *(*beside, hold, other, *beside, tap, other, *beside, hold, other),
    ]


def test_the_picture_of_the_document_is_the_present_one():
    picture = (DOCS / "pictures" / "flavors.svg").read_text(encoding="utf-8")
    assert picture == timing_picture.document()
