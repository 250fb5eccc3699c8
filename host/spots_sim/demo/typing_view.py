"""Picture of a strip as a keyboard in the terminal: keys, finger, typed text."""

from __future__ import annotations

import math

from rich.console import Group
from rich.panel import Panel
from rich.text import Text

from spots.errors import printable
from spots.keyboard.key_engine import KeyEngine
from spots.keyboard.key_layout import KeyLayout
from spots.keyboard.keys import COLUMNS, row
from spots.link.frames import LinkStats, Touch

from ..person.typist import TypedText

_LINES = 4
_FULL_FORCE_MN = 10_000
_LEVELS = "▁▂▃▄▅▆▇█"


def picture(
    layout: KeyLayout, engine: KeyEngine, touch: Touch | None, typed: TypedText, stats: LinkStats
) -> Panel:
    """Return the present picture of the keyboard; the touched key is highlighted."""
    keys = layout.layers[engine.layer]
    held = touch is not None and touch.touching and not math.isnan(touch.position_um)
    share = touch.position_um / engine.length_um if held else -1.0
    lit = next((i for i, key in enumerate(keys) if key.low <= share < key.high), None)
    finger = Text()
    if held:
        at = min(max(round(share * COLUMNS), 0), COLUMNS - 1)
        level = min(touch.force_mN * len(_LEVELS) // _FULL_FORCE_MN, len(_LEVELS) - 1)
        finger = Text(" " * at + _LEVELS[level], style="bold cyan")
    paper = _wrapped(typed.text)
    force = firm_scale(touch.force_mN if held else 0, engine.firm_mN)
    facts = Text(
        f"keys {typed.presses}   frames {stats.frames}   lost {stats.lost}   bad {stats.bad_crc}",
        style="dim",
    )
    layer = Text.assemble(("layer ", "dim"), engine.layer, ("   force ", "dim"), force)
    parts = [row(keys, lit if held else None), finger, layer, Text(), *paper, Text(), facts]
    return Panel(
        Group(*parts),
        title=Text(f"SPOTS keyboard  {printable(layout.name)}"),
        width=COLUMNS + 6,
        padding=(1, 2),
    )


def firm_scale(force_mN: int, firm_mN: int) -> Text:
    """Return a bar that shows a force; its colour changes at the least force of a firm press."""
    columns = 24
    full = round(min(force_mN / _FULL_FORCE_MN, 1) * columns)
    firm = round(min(firm_mN / _FULL_FORCE_MN, 1) * columns)
    bar = Text("█" * min(full, firm), style="cyan")
    bar.append("█" * (full - firm), style="yellow")
    bar.append("·" * (columns - max(full, 0)), style="dim")
    return bar


def _wrapped(text: str) -> list[Text]:
    lines = [""]
    for character in text:
        if character == "\n" or len(lines[-1]) >= COLUMNS - 1:
            lines.append("")
        if character != "\n":
            lines[-1] += character
    lines[-1] += "▏"
    lines = lines[-_LINES:]
    return [Text(line, style="bold") for line in lines + [""] * (_LINES - len(lines))]
