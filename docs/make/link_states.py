"""Draws the states of the link between board and host, with the timeouts of the host."""

from __future__ import annotations

from pathlib import Path

from spots.common import atomic
from spots.link import timeouts
from spots_make.drawing import SVG

from .svg import picture, text

_WIDTH, _HEIGHT = 720, 370
_BOX = 130, 56  # width and height of a state
# Place of each state: the middle of its box.
_PLACES = {
    timeouts.SEARCHING: (95, 120),
    timeouts.CONNECTED: (300, 120),
    timeouts.STALLED: (595, 120),
    timeouts.LOST: (300, 260),
    timeouts.REFUSED: (595, 260),
}
_SENTENCES = {
    timeouts.SEARCHING: "web UI only",
    timeouts.CONNECTED: "readings arrive",
    timeouts.STALLED: "asks the board",
    timeouts.LOST: "opens the port again",
    timeouts.REFUSED: "another board",
}
_STYLE = """<style>
text { font: 13px system-ui, sans-serif; fill: #1d1b19; }
.state { font-weight: 600; font-size: 14px; }
.quiet { fill: #6d6761; }
.title { font-weight: 600; font-size: 14px; }
.box { fill: #e9edf2; stroke: #8d8780; }
.good { fill: #d6efe4; stroke: #1f7a55; stroke-width: 2; }
.arrow { fill: none; stroke: #6d6761; stroke-width: 1.5; }
.head { fill: #6d6761; }
.ground { fill: #ffffff; }
@media (prefers-color-scheme: dark) {
  text { fill: #ecebe9; }
  .quiet { fill: #a19e99; }
  .box { fill: #2a2c31; stroke: #8d8780; }
  .good { fill: #17382b; stroke: #58c795; }
  .arrow { stroke: #a19e99; }
  .head { fill: #a19e99; }
  .ground { fill: #1a1a1d; }
}
</style>"""


def document() -> str:
    """Return the picture as SVG."""
    parts = [
        '<defs><marker id="head" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="8" '
        'markerHeight="8" orient="auto"><path class="head" d="M0 0L10 5L0 10z"/></marker></defs>',
        _text(20, 34, "States of the link while a board streams", "title", "start"),
        *(part for state in _PLACES for part in _state(state)),
        *_arrows(),
    ]
    title = "States of the link between board and host"
    return picture(title, _WIDTH, _HEIGHT, _STYLE, parts)


def _text(x: float, y: float, words: str, kind: str = "", anchor: str = "middle") -> str:
    return text(x, y, words, kind, anchor)


def _state(state: str) -> list[str]:
    x, y = _PLACES[state]
    wide, tall = _BOX
    kind = "good" if state == timeouts.CONNECTED else "box"
    return [
        f'<rect class="{kind}" x="{x - wide / 2:g}" y="{y - tall / 2:g}" width="{wide}" '
        f'height="{tall}" rx="8"/>',
        _text(x, y - 3, state, "state"),
        _text(x, y + 16, _SENTENCES[state], "quiet"),
    ]


def _arrow(begin: tuple[float, float], end: tuple[float, float]) -> str:
    (x, y), (to_x, to_y) = begin, end
    return f'<path class="arrow" marker-end="url(#head)" d="M{x:g} {y:g}L{to_x:g} {to_y:g}"/>'


def _arrows() -> list[str]:
    half_wide, half_tall = _BOX[0] / 2, _BOX[1] / 2
    searching_x, y = _PLACES[timeouts.SEARCHING]
    connected_x, _ = _PLACES[timeouts.CONNECTED]
    right_x, low_y = _PLACES[timeouts.REFUSED]
    left, right = connected_x + half_wide, right_x - half_wide
    top, bottom = y + half_tall, low_y - half_tall
    middle_x, middle_y = (left + right) / 2, (top + bottom) / 2
    return [
        _arrow((searching_x + half_wide, y), (connected_x - half_wide, y)),
        _text((searching_x + connected_x) / 2, y - 40, "a board is found", "quiet"),
        _arrow((left, y - 12), (right, y - 12)),
        _text(middle_x, y - 20, f"no reading for {timeouts.STALLED_S:g} s"),
        _arrow((right, y + 12), (left, y + 12)),
        _text(middle_x, y + 32, "a reading arrives"),
        _arrow((connected_x - 14, top), (connected_x - 14, bottom)),
        _text(connected_x - 24, middle_y - 2, "the port", anchor="end"),
        _text(connected_x - 24, middle_y + 14, "disappears", anchor="end"),
        _arrow((connected_x + 14, bottom), (connected_x + 14, top)),
        _text(connected_x + 24, middle_y - 2, "the same board", anchor="start"),
        _text(connected_x + 24, middle_y + 14, "answers", anchor="start"),
        _arrow((left, low_y - 12), (right, low_y - 12)),
        _text(middle_x, low_y - 20, "another board answers"),
        _arrow((right, low_y + 12), (left, low_y + 12)),
        _text(middle_x, low_y + 32, "no board answers"),
        _arrow((right_x, top), (connected_x + half_wide, low_y - half_tall)),
        _text(middle_x + 30, middle_y + 14, "the port disappears", anchor="start"),
        _text(
            20,
            _HEIGHT - 40,
            f"The right board also leads from {timeouts.REFUSED} to {timeouts.CONNECTED}.",
            "quiet",
            "start",
        ),
        _text(
            20,
            _HEIGHT - 20,
            f"After {timeouts.PATIENCE_S:g} s in {timeouts.LOST} or {timeouts.REFUSED}, "
            "an iterator over readings raises an error.",
            "quiet",
            "start",
        ),
    ]


def main(folder: Path = Path(__file__).parents[1] / "pictures") -> None:
    """Draw link_states.svg, and print its path."""
    path = folder / "link_states.svg"
    atomic.write_text(document(), path, SVG)
    print(path)


if __name__ == "__main__":
    main()
