"""Draws what fingers do and what the computer gets, for the pages of the keyboard's behaviours.

The first layout in a page is played on the firmware's key engine, so a picture shows what the
layout beside it does.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

from spots.common import atomic
from spots.keyboard.key_layout import KeyLayout
from spots.keyboard.layout import compiled
from spots.keyboard.timing_picture import STYLE
from spots.keyboard.trial import Span, Touch, played
from spots.outputs.usages import MODIFIERS_FROM, USAGES, name_of
from spots_device.usb.usages import KEYBOARD
from spots_make.drawing import SVG

from .svg import picture

DOCS = Path(__file__).parents[1]
_LENGTH_MM = 100  # of the strip
_AFTER_MS = 700  # time after the last finger in which a layout of the pages has decided everything
_TOML = re.compile(r"^```toml\n(.*?)^```", re.MULTILINE | re.DOTALL)


class Finger(NamedTuple):
    """A touch on a key of the first layer.

    Attributes
    ----------
    key : int
        Number of the key, from 0 at the sensor.
    begin_ms, end_ms : int
        Times of its first and last light.
    firm_ms : int, optional
        Time from which on it presses firmly.
    slide_mm : float
        Distance that it moves during the touch, away from the sensor; the strip is 100 mm long.
    """

    key: int
    begin_ms: int
    end_ms: int
    firm_ms: int | None = None
    slide_mm: float = 0.0


# Pages in docs/type, and for each what fingers do in words and in touches.
PLAYED: dict[str, dict[str, list[Finger]]] = {
    "firm": {
        "a light touch": [Finger(0, 0, 120)],
        "a firm press, from the darker part on": [Finger(0, 0, 260, firm_ms=40)],
        "the force comes too late": [Finger(0, 0, 260, firm_ms=140)],
    },
    "double-tap": {
        "one tap": [Finger(0, 0, 70)],
        "two taps": [Finger(0, 0, 70), Finger(0, 160, 230)],
        "tap dance, one tap": [Finger(1, 0, 70)],
        "tap dance, two taps": [Finger(1, 0, 70), Finger(1, 160, 230)],
        "tap dance, held": [Finger(1, 0, 400)],
    },
    "slides": {
        "a touch without movement": [Finger(1, 0, 120)],
        "a finger slides by 13 mm": [Finger(1, 0, 700, slide_mm=13)],
        "it slides back": [Finger(1, 0, 700, slide_mm=-13)],
        "a swipe by 30 mm": [Finger(0, 0, 150, slide_mm=30)],
    },
    "layers": {
        "momentary: another finger while it is held": [Finger(2, 0, 500), Finger(0, 150, 230)],
        "after it: the first layer again": [Finger(0, 0, 80)],
        "toggle, then two keys": [Finger(3, 0, 80), Finger(0, 250, 330), Finger(1, 450, 530)],
    },
    "sticky": {
        "sticky, then two keys": [Finger(0, 0, 80), Finger(2, 250, 330), Finger(3, 450, 530)],
        "two sticky keys combine": [Finger(0, 0, 80), Finger(1, 200, 280), Finger(2, 450, 530)],
        "held beside another finger": [Finger(0, 0, 700), Finger(2, 150, 230), Finger(3, 400, 480)],
    },
    "texts": {
        "a tap on the text": [Finger(0, 0, 80)],
        "a tap on the macro": [Finger(1, 0, 80)],
    },
    "modifiers": {
        "mod-morph": [Finger(1, 0, 100)],
        "mod-morph while shift is down": [Finger(0, 0, 500), Finger(1, 150, 250)],
        "key repeat after A": [Finger(2, 0, 80), Finger(3, 200, 280)],
        "caps word, then A and a space": [
            Finger(4, 0, 80),
            Finger(2, 200, 280),
            Finger(5, 400, 480),
            Finger(2, 600, 680),
        ],
    },
}


def layout_of(page: str) -> KeyLayout:
    """Return the first layout in a page of docs/type."""
    path = DOCS / "type" / f"{page}.md"
    return compiled(path, _TOML.search(path.read_text(encoding="utf-8"))[1])


def play(layout: KeyLayout, fingers: list[Finger]) -> list[Span]:
    """Play touches on a layout; return what the computer gets, in the order of the presses."""
    keys = next(iter(layout.layers.values()))
    touches = [
        Touch(
            (keys[one.key].low + keys[one.key].high) / 2,
            one.begin_ms,
            one.end_ms,
            one.firm_ms,
            one.slide_mm / _LENGTH_MM,
        )
        for one in fingers
    ]
    return played(layout.lines, touches, _AFTER_MS, _named)


def _named(page: int, usage: int, modifiers: int) -> str:
    is_key = page == KEYBOARD and usage < MODIFIERS_FROM
    return _shown(name_of(page, usage), modifiers if is_key else 0)


def _shown(name: str, modifiers: int) -> str:
    """Return the name of a key as a person says it, with its modifiers."""
    names = [
        USAGES[KEYBOARD, MODIFIERS_FROM + bit].name for bit in range(8) if modifiers >> bit & 1
    ]
    return " + ".join(_SHOWN.get(one, one.replace("_", " ").lower()) for one in [*names, name])


_DIGITS = ["ONE", "TWO", "THREE", "FOUR", "FIVE", "SIX", "SEVEN", "EIGHT", "NINE"]
_SHOWN = {chr(i): chr(i) for i in range(ord("A"), ord("Z") + 1)} | {
    name: str(i) for i, name in enumerate(_DIGITS, 1)
}
_SHOWN |= {"LEFT_SHIFT": "shift", "LEFT_CONTROL": "ctrl", "SPACEBAR": "space"}
_SHOWN |= {"VOLUME_INCREMENT": "volume up", "VOLUME_DECREMENT": "volume down"}

_WIDTH, _LEFT, _NAMES = 640, 12, 160  # of the picture; left and right of the bars
_LANE, _BAR, _TITLE, _GAP = 15, 10, 20, 14
_STYLE = STYLE.replace("</style>", ".firm { fill: #7d1620; }\n</style>")


def document(layout: KeyLayout, gestures: dict[str, list[Finger]], title: str) -> str:
    """Return the picture of some gestures as SVG, with the style of a document."""
    rows = [(words, fingers, play(layout, fingers)) for words, fingers in gestures.items()]
    longest_ms = max(one.end_ms for _, fingers, spans in rows for one in (*fingers, *spans))
    scale = (_WIDTH - _LEFT - _NAMES) / longest_ms
    keys = next(iter(layout.layers.values()))
    parts, y = [], 10
    for words, fingers, spans in rows:
        parts.append(f'<text class="title" x="{_LEFT}" y="{y + 11}">{words}</text>')
        y += _TITLE
        bars = [(f"finger on {keys[one.key].label}", "touch", one) for one in fingers]
        bars += [(f"typed: {one.what}", "gets-tap", one) for one in spans]
        lanes: dict[str, int] = {}
        for name, kind, one in bars:
            if name not in lanes:
                lanes[name] = y
                text = name.replace("&", "&amp;").replace("<", "&lt;")
                parts.append(f'<text x="{_WIDTH - _NAMES + 12}" y="{y + _BAR - 1}">{text}</text>')
                y += _LANE
            parts.append(_bar(kind, one.begin_ms, one.end_ms, lanes[name], scale))
            if kind == "touch" and one.firm_ms is not None:
                parts.append(_bar("firm", one.firm_ms, one.end_ms, lanes[name], scale))
        y += _GAP
    y += 12
    parts.append(_axis(y, scale, longest_ms))
    return picture(title, _WIDTH, y + 8, _STYLE, parts)


def _bar(kind: str, begin_ms: int, end_ms: int, y: int, scale: float) -> str:
    width = max(scale * (end_ms - begin_ms), 3)
    x = _LEFT + scale * begin_ms
    return f'<rect class="{kind}" x="{x:.1f}" y="{y}" width="{width:.1f}" height="{_BAR}" rx="2"/>'


def _axis(y: int, scale: float, longest_ms: int) -> str:
    parts = []
    for ms in range(0, longest_ms + 1, 100):
        x = _LEFT + scale * ms
        parts.append(f'<path class="term" d="M{x:.1f} {y - 14}v4"/>')
        if ms % 200 == 0:
            parts.append(f'<text class="quiet" x="{x:.1f}" y="{y}">{ms} ms</text>')
    return "\n".join(parts)


def main(folder: Path = DOCS / "pictures") -> None:
    """Draw timing/PAGE.svg for each page, and print the paths."""
    for page, gestures in PLAYED.items():
        path = folder / "timing" / f"{page}.svg"
        title = f"What fingers do and what the computer gets: {page}"
        path.parent.mkdir(exist_ok=True)
        atomic.write_text(document(layout_of(page), gestures, title), path, SVG)
        print(path)


if __name__ == "__main__":
    main()
