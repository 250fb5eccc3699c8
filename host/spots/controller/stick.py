"""The picture of a controller in the terminal: stick, force and buttons."""

from __future__ import annotations

from rich.console import Group
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from ..errors import printable
from ..outputs.devices import AXIS_MAX, BUTTONS, REST, State
from ..terminal.view import bar

_COLUMNS = 61  # odd, so that rest is a column
_KNOB = 7


def picture(
    state: State, held: bool = False, buttons: int = BUTTONS, title: str = "", facts: str = ""
) -> Panel:
    """Return the picture of a state.

    Parameters
    ----------
    state : State
    held : bool
        Whether it is held because readings are untrusted or missing.
    buttons : int
        How many to show.
    title, facts : str
        Above, and below.

    Returns
    -------
    rich.panel.Panel
    """
    numbers = Table.grid(padding=(0, 1))
    numbers.add_column(justify="right", width=9)
    numbers.add_column(justify="right", width=10)
    numbers.add_column()
    along = "held: the reading is untrusted or missing" if held else ""
    numbers.add_row("x", f"{state.x:+d}" if state.x else "0", Text(along, style="yellow"))
    if state.y:
        numbers.add_row("y", f"{state.y:+d}")
    numbers.add_row("z", str(state.z), Text(bar(state.z / AXIS_MAX), style="cyan"))
    parts = [*_stick(state), Text(), numbers, Text(), _buttons(state.buttons, buttons)]
    if facts:
        parts += [Text(), Text("  " + facts, style="dim")]
    return Panel(Group(*parts), title=Text(printable(title)), width=_COLUMNS + 19, padding=(1, 2))


def _stick(state: State) -> list[Text]:
    # The knob's left edge runs from column 0 to _COLUMNS - _KNOB.
    room = _COLUMNS - _KNOB
    at = round((state.x + AXIS_MAX) / (2 * AXIS_MAX) * room)
    middle = _COLUMNS // 2
    rail = ["╪" if i == middle else "═" for i in range(_COLUMNS)]
    share = state.z / AXIS_MAX
    rgb = (110 + round(145 * share), 150 - round(60 * share), 190 - round(150 * share))
    style = "dim" if state == REST else "bold rgb({},{},{})".format(*rgb)
    lines = []
    for row, knob in enumerate(("╭─────╮", "│  ●  │", "╰─────╯")):
        line = Text(" " * 7)
        left, right = (rail[:at], rail[at + _KNOB :]) if row == 1 else (" " * at, "")
        line.append("".join(left), style="dim")
        line.append(knob, style=style)
        line.append("".join(right), style="dim")
        lines.append(line)
    return lines


def _buttons(pressed: int, count: int) -> Text:
    line = Text("  buttons  ")
    for i in range(count):
        down = pressed >> i & 1
        line.append(f" {i + 1} ", style="bold black on yellow1" if down else "grey62 on grey23")
        line.append(" ")
    return line
