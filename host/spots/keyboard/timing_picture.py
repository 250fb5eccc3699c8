"""Draws when a key is a tap and when a hold, as SVG: the fingers, and what the computer gets."""

from collections.abc import Iterator
from functools import cache

from spots_device.keys.layout import RETRO_TAP

from . import trial
from .key_layout import FLAVORS, flavor_name

WIDTH = 320
_LEFT, _TERM = 8, 110  # units before the first touch, units of a tapping term
_LANE, _BAR = 13, 9  # units from lane to lane, height of a bar
_RIGHT = 2.0  # terms from the first touch to the words
_LEAST = 5  # width of the shortest bar
_TITLE, _GAP = 17, 12
# For a document, where the web UI's style sheet is missing. The colours are those of the web UI.
STYLE = """<style>
text { font: 11px system-ui, sans-serif; fill: #1d1b19; }
.title { font-weight: 600; }
.quiet { fill: #6d6761; }
.term { stroke: #8d8780; stroke-dasharray: 2 3; }
.touch { fill: #c22f3a; }
.second { fill: #d9a0a4; }
.gets-other { fill: #8d8780; }
.gets-hold { fill: #1f7a8c; }
.gets-tap { fill: #2f9e5f; }
.ground { fill: #ffffff; }
@media (prefers-color-scheme: dark) {
  text { fill: #ecebe9; }
  .quiet { fill: #a19e99; }
  .touch { fill: #ff6a73; }
  .second { fill: #8a4a4f; }
  .gets-other { fill: #918e89; }
  .gets-hold { fill: #59bccf; }
  .gets-tap { fill: #4cc38a; }
  .ground { fill: #1a1a1d; }
}
</style>"""


def picture(flavor: int) -> str:
    """Return a picture of one flavor, without a style.

    `flavor` is an index in `layout.FLAVORS`, plus `spots_device.keys.layout.RETRO_TAP`.
    """
    parts, height = _column(flavor)
    return "\n".join([_head(WIDTH, height, flavor_name(flavor)), *parts, "</svg>"])


@cache
def pictures() -> dict[str, str]:
    """Return a picture of each flavor, also with a retro tap, by its name (`flavor_name`)."""
    flavors = [flavor + retro for retro in (0, RETRO_TAP) for flavor in range(len(FLAVORS))]
    return {flavor_name(flavor): picture(flavor) for flavor in flavors}


def document() -> str:
    """Return a picture of all flavors with the style of a document."""
    columns = [_column(flavor) for flavor in range(len(FLAVORS))]
    height = max(height for _, height in columns)
    parts = [_head(2 * WIDTH, 2 * height, "Tap or hold, by flavor"), STYLE]
    parts.append(f'<rect class="ground" width="{2 * WIDTH}" height="{2 * height}" rx="8"/>')
    for i, (column, _) in enumerate(columns):
        parts.append(f'<g transform="translate({i % 2 * WIDTH} {i // 2 * height})">')
        parts += [*column, "</g>"]
    return "\n".join([*parts, "</svg>"]) + "\n"


def _head(width: int, height: int, title: str) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img">\n'
        f"<title>{title}</title>"
    )


def _column(flavor: int) -> tuple[list[str], int]:
    """Return the elements of a flavor, and their height."""
    y = 20
    parts = [f'<text class="title" x="{_LEFT}" y="{y - 4}">{flavor_name(flavor)}</text>']
    for gesture, words in trial.WORDS.items():
        top = y
        parts.append(f'<text class="quiet" x="{_LEFT}" y="{y + 12}">{words}</text>')
        y += _TITLE
        for shares, kind in zip(trial.GESTURES[gesture], ("touch", "second")):
            parts.append(_bar(kind, *shares, y))
            y += _LANE
        for what, begin, end in _typed(flavor, gesture):
            parts.append(_bar(f"gets-{what}", begin, end, y))
            parts.append(f'<text x="{_x(_RIGHT):g}" y="{y + _BAR}">{_WHAT[what]}</text>')
            y += _LANE
        at, above = _x(1), 0
        if gesture == "tap":
            parts.append(f'<text class="quiet" x="{at + 4:g}" y="{top + 12}">tapping term</text>')
            above = _LANE
        path = f"M{at:g} {top + _TITLE - above}V{y - _LANE + _BAR}"
        parts.insert(1, f'<path class="term" d="{path}"/>')
        y += _GAP
    return parts, y


_WHAT = {"tap": "tap", "hold": "hold", "other": "the other key"}


def _typed(flavor: int, gesture: str) -> Iterator[tuple[str, float, float]]:
    for what, begin_ms, end_ms in trial.play(flavor, gesture):
        yield what, begin_ms / trial.TERM_MS, end_ms / trial.TERM_MS


def _bar(kind: str, begin: float, end: float, y: int) -> str:
    width = max(_TERM * (end - begin), _LEAST)
    place = f'x="{_x(begin):g}" y="{y}" width="{width:g}" height="{_BAR}"'
    return f'<rect class="{kind}" {place} rx="2"/>'


def _x(share: float) -> float:
    return round(_LEFT + _TERM * share, 1)
