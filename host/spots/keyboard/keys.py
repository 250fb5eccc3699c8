"""``spots keys``: shows and validates layout files, and uploads a layout to a board."""

from rich.cells import cell_len
from rich.console import Console
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from spots_device.keys.layout import BEHAVIOUR

from ..errors import SpotsError, printable
from ..link.board import Board
from ..link.connect import ensured, upload_lines
from ..outputs.usages import KEYBOARD, MODIFIERS_FROM, name_of
from ..terminal.view import framed
from .layout import LAYER_VERBS, SLOTS, SWIPES, KeyLayout, PlacedKey, load, parts_of

COLUMNS = 74
_LABEL = 20  # characters of a label; a longer one takes several lines
_GAP = 2  # between the columns of a table
_SHADES = ("white on rgb(150,40,50)", "white on rgb(120,30,40)")
_VERBS = {kind: verb for verb, kind in LAYER_VERBS.items()}


def check(name: str) -> None:
    """Validate a layout file, and print its number of keys.

    Raises SpotsError if it is invalid. Prints keys that can never be typed, and raises SpotsError.
    """
    layout = load(name)
    for problem in layout.problems:
        print(printable(problem))
    if layout.problems:
        many = len(layout.problems)
        raise SpotsError(
            f"layout {name}: {many} keys can never be typed: change the layers as the lines above "
            "describe"
        )
    keys = sum(len(row) for row in layout.layers.values())
    print(f"{printable(layout.name)}: {keys} keys in {len(layout.layers)} layers, no problem found")


def show(name: str) -> None:
    """Print a picture of a layout with all its actions."""
    Console().print(picture(load(name)))


def push(board: Board, layout: KeyLayout) -> str | None:
    """Upload a layout to a board, switch on keys, and store both on the board.

    Parameters
    ----------
    board : Board
        A calibrated board.
    layout : KeyLayout
        Layout to upload.

    Returns
    -------
    str or None
        Reason why the keys do not work yet; None if they work.

    Raises
    ------
    SpotsError
        If the board refuses the layout or a command.
    """
    upload_lines(board, "layout", layout.lines)
    note = ensured(board, "set keys=1").get("note")
    ensured(board, "save")
    if not note or "save and reboot" not in note:
        return note
    return note.replace("save and reboot", "reboot").replace("; keys are", "; until then, keys are")


def picture(layout: KeyLayout) -> Panel:
    """Return a picture of each layer: the keys along the strip, and a table of all actions."""
    parts = []
    for name, keys in layout.layers.items():
        actions = [(key.label, key.actions) for key in keys]
        if any(layout.swipes[name].values()):
            actions.append(("(anywhere)", layout.swipes[name]))
        parts += [Text(name, style="bold"), row(keys), _table(layout, actions), Text()]
    return framed(parts[:-1], layout.name, COLUMNS + 6)


def row(keys: list[PlacedKey], lit: int | None = None) -> Text:
    """Return a picture of one layer's keys as one line; the sensor is on the left.

    Parameters
    ----------
    keys : list of PlacedKey
        Keys of the layer.
    lit : int, optional
        Index of a key to highlight.

    Returns
    -------
    rich.text.Text
    """
    line = Text()
    for i, key in enumerate(keys):
        begin, end = round(key.low * COLUMNS), round(key.high * COLUMNS)
        line.append(" " * (begin - len(line)))
        width = max(1, end - begin)
        style = "black on bright_white" if i == lit else _SHADES[i % 2]
        line.append(key.label[:width].center(width), style=style)
    return line


def say(layout: KeyLayout, action: int) -> str:
    """Return an action in the notation of layout files.

    Parameters
    ----------
    layout : KeyLayout
        Layout that the action belongs to, for the names of its layers.
    action : int
        Action as the board encodes it, see `spots_device.keys.layout.action`; 0 for no action.

    Returns
    -------
    str
        Modifiers and key, joined by ``+``; or a word such as ``toggle`` and the name of a layer.
        Empty for no action.
    """
    if not action:
        return ""
    kind, number, bits = parts_of(action)
    if kind == BEHAVIOUR:
        return layout.behaviours[number].text
    if kind in _VERBS:
        return f"{_VERBS[kind]} {list(layout.layers)[number]}"
    names = [name_of(KEYBOARD, MODIFIERS_FROM + i) for i in range(8) if bits >> i & 1]
    return "+".join([*names, name_of(kind, number)])


def _table(layout: KeyLayout, actions: list[tuple[str, dict[str, int]]]) -> Table:
    """Return a table of labels and actions; if its columns are too wide, a line for each action."""
    does = [
        (label, {_heading(slot): say(layout, action) for slot, action in by_slot.items() if action})
        for label, by_slot in actions
    ]
    used = dict.fromkeys(_heading(slot) for slot in (*SLOTS, *SWIPES))
    used = [heading for heading in used if any(heading in texts for _, texts in does)]
    rows = [("key", *used)]
    rows += [(label, *(texts.get(heading, "") for heading in used)) for label, texts in does]
    if sum(max(map(cell_len, column)) + _GAP for column in zip(*rows)) - _GAP > COLUMNS:
        rows = [("key", "when", "action")]
        for label, texts in does:
            for heading, text in texts.items() or [("", "")]:
                rows.append((label, heading, text))
                label = ""
    table = Table(box=None, padding=(0, _GAP, 0, 0), header_style="dim")
    (first, *others), *body = rows
    table.add_column(first, overflow="fold", max_width=_LABEL)
    for heading in others:
        table.add_column(heading, overflow="fold")
    for cells in body:
        table.add_row(*map(Text, cells))
    return table


def _heading(slot: str) -> str:
    return slot.replace("_minus", " to sensor").replace("_plus", " away")
