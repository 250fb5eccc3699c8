"""Picture of a worn strip for a terminal: the finger, the last gestures, and their keys."""

import math
from collections.abc import Mapping, Sequence

from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from ..errors import printable
from ..link.frames import LinkStats, Touch
from ..terminal.view import framed
from .gestures import NAMES, Gesture

_COLUMNS = 74
_ROWS = 6
_SIGNS = dict(zip(NAMES, ("·", "··", "━━", "▐█▌", "◀──", "──▶", "◁━●", "●━▷", "▐█▌▐█▌", "● ●━▷")))


def picture(
    touch: Touch | None,
    length_um: int,
    found: Sequence[Gesture],
    does: Mapping[str, str],
    stats: LinkStats,
) -> Panel:
    """Return the picture of a strip and the last gestures on it.

    `touch` is None before the first reading; `found` begins with the oldest gesture. `does` has the
    name of the key for each gesture that has a key.
    """
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    for name in ("", "gesture", "sure", "where", "does"):
        table.add_column(name, min_width=6)
    recent = list(found[-_ROWS:])[::-1]
    for i, gesture in enumerate(recent):
        table.add_row(
            _SIGNS[gesture.name],
            spoken(gesture.name),
            f"{gesture.confidence:.0%}",
            f"{gesture.position_um / 1000:.0f} mm",
            Text(printable(does.get(gesture.name, "-"))),
            style="bold" if i == 0 else "dim",
        )
    for _ in range(_ROWS - len(recent)):
        table.add_row()
    facts = f"gestures {len(found)}   frames {stats.frames}   lost {stats.lost}"
    parts = [_strip(touch, length_um), Text(), table, Text(facts, style="dim")]
    return framed(parts, "SPOTS wearable", _COLUMNS + 6)


def spoken(name: str) -> str:
    """Return the name of a gesture in words, such as ``double tap``."""
    return name.replace("_minus", " to sensor").replace("_plus", " away").replace("_", " ")


def _strip(touch: Touch | None, length_um: int) -> Text:
    line = Text("█" * _COLUMNS, style="rgb(120,30,40)")
    if touch is not None and touch.touching:
        at = touch.position_um / length_um * (_COLUMNS - 1)
        half = 0.6 + touch.force_mN / 5000
        first, last = max(math.ceil(at - half), 0), math.floor(at + half)
        line.stylize("rgb(255,220,200)", first, last + 1)
    return line
