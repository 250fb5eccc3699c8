"""Picture of a controller for a terminal: stick, force and buttons."""

from rich.panel import Panel
from rich.text import Text

from ..outputs.devices import AXIS_MAX, BUTTONS, REST, State
from ..terminal.view import bar, bar_grid, framed

_COLUMNS = 61  # odd, so that there is a middle column
_KNOB = 7


def picture(
    state: State, held: bool = False, buttons: int = BUTTONS, title: str = "", facts: str = ""
) -> Panel:
    """Return the picture of a gamepad state.

    With `held`, a remark says that this is the last valid state, because the latest readings are
    untrusted or missing. `facts` is a line below the picture, if any.
    """
    numbers = bar_grid()
    along = "held: the reading is untrusted or missing" if held else ""
    numbers.add_row("x", f"{state.x:+d}" if state.x else "0", Text(along, style="yellow"))
    if state.y:
        numbers.add_row("y", f"{state.y:+d}")
    numbers.add_row("z", str(state.z), Text(bar(state.z / AXIS_MAX), style="cyan"))
    parts = [*_stick(state), Text(), numbers, Text(), _buttons(state.buttons, buttons)]
    if facts:
        parts += [Text(), Text("  " + facts, style="dim")]
    return framed(parts, title, _COLUMNS + 19)


def _stick(state: State) -> list[Text]:
    # The left edge of the knob moves from column 0 to _COLUMNS - _KNOB.
    at = round((state.x + AXIS_MAX) / (2 * AXIS_MAX) * (_COLUMNS - _KNOB))
    half = "═" * (_COLUMNS // 2)
    rail, empty = f"{half}╪{half}", " " * _COLUMNS
    share = state.z / AXIS_MAX
    rgb = (110 + round(145 * share), 150 - round(60 * share), 190 - round(150 * share))
    style = "dim" if state == REST else "bold rgb({},{},{})".format(*rgb)
    rows = zip((empty, rail, empty), ("╭─────╮", "│  ●  │", "╰─────╯"))
    return [
        Text.assemble(" " * 7, (row[:at], "dim"), (knob, style), (row[at + _KNOB :], "dim"))
        for row, knob in rows
    ]


def _buttons(pressed: int, count: int) -> Text:
    line = Text("  buttons  ")
    for i in range(count):
        down = pressed >> i & 1
        line.append(f" {i + 1} ", style="bold black on yellow1" if down else "grey62 on grey23")
        line.append(" ")
    return line
