"""Timing pictures and tables of limits in docs/type are those of the engine."""

import re

import pytest
from make import timings

from spots.keyboard.key_layout import FLAVORS
from spots.keyboard.layout import compiled
from spots.keyboard.layout_format import RELEASE_AFTER_MS
from spots_device.keys.layout import LIMITS

PAGES = sorted(timings.PLAYED)
LAYOUTS = re.compile(r"^```toml\n(.*?)^```", re.MULTILINE | re.DOTALL)


def typed(page, words):
    """Return what the computer gets for a gesture in a picture, and when, in ms."""
    spans = timings.play(timings.layout_of(page), timings.PLAYED[page][words])
    return [(one.what, one.begin_ms) for one in spans]


@pytest.mark.parametrize("page", PAGES)
def test_a_timing_picture_shows_the_layout_of_its_page(page):
    path = timings.DOCS / "pictures" / "timing" / f"{page}.svg"
    title = f"What fingers do and what the computer gets: {page}"
    drawn = timings.document(timings.layout_of(page), timings.PLAYED[page], title)
    assert path.read_text(encoding="utf-8") == drawn


@pytest.mark.parametrize(
    ("page", "words", "expected"),
    [
        ("firm", "the force comes too late", [("E", 80)]),
        ("firm", "a firm press, from the darker part on", [("H", 40)]),
        ("double-tap", "two taps", [("enter", 160)]),
        ("double-tap", "one tap", [("space", 320)]),
        ("slides", "a swipe by 30 mm", [("scan next track", 100)]),
        ("layers", "toggle, then two keys", [("1", 250), ("2", 450)]),
        ("sticky", "sticky, then two keys", [("shift", 0), ("shift + A", 250), ("B", 450)]),
        ("modifiers", "mod-morph while shift is down", [("shift", 0), ("delete", 150)]),
        ("modifiers", "key repeat after A", [("A", 0), ("A", 200)]),
    ],
)
def test_a_gesture_types_what_its_page_says(page, words, expected):
    assert typed(page, words) == expected


def test_a_macro_waits():
    times = [ms for _, ms in typed("texts", "a tap on the macro")]
    assert times[0] < 10  # its modifier comes first
    assert times[1] - times[0] >= 200
    assert all(8 <= after - ms < 20 for ms, after in zip(times[1:], times[2:]))


@pytest.mark.parametrize("path", sorted((timings.DOCS / "type").glob("*.md")), ids=lambda p: p.stem)
def test_the_layouts_of_a_page_are_valid_and_can_be_typed(path):
    for text in LAYOUTS.findall(path.read_text(encoding="utf-8")):
        assert compiled(path, text).problems == []


def test_the_table_of_settings_has_all_limits():
    text = (timings.DOCS / "type" / "layouts.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| (\d+) \| (\d+) \| (\d+) \|", text, re.MULTILINE)
    limits = {name: of for name, of in LIMITS.items() if name != "flavor"}
    assert {name: tuple(map(int, of)) for name, *of in rows} == {
        **limits,
        "release_after_ms": RELEASE_AFTER_MS,
    }
    assert f"| `flavor` | | | `{FLAVORS[LIMITS['flavor'][2]]}` |" in text
