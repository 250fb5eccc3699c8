"""``spots keys``: shows and validates layout files, and uploads a layout to a board."""

from typing import NamedTuple
from unicodedata import normalize

from rich.cells import cell_len
from rich.console import Console
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from spots_device.keys import layout as lines_of
from spots_device.keys.layout import BEHAVIOUR

from ..advice.key_exposure import is_automatic, sentence, shortest_us
from ..errors import FileError, SettingError, printable
from ..link.board import Board
from ..link.connect import ensured, upload_lines
from ..link.stored import stored_calibration, stored_layout
from ..outputs.usages import ALIASES, KEYBOARD, MODIFIERS_FROM, ON_BOARDS, USAGES, name_of
from ..terminal.view import framed
from . import trial
from .hosts import every as every_host
from .key_layout import LAYER_VERBS, SLOTS, SWIPES, KeyLayout, PlacedKey, flavor_name, parts_of
from .layout import load

COLUMNS = 74
_LABEL = 20  # characters of a label; a longer one takes several lines
_GAP = 2  # between the columns of a table
_NAME = 32  # width of a name in the list of names
_SHADES = ("white on rgb(150,40,50)", "white on rgb(120,30,40)")
_TERM = 10  # characters of a drawing that are a tapping term
_VERBS = {kind: verb for verb, kind in LAYER_VERBS.items()}


def check(name: str) -> None:
    """Validate a layout file, and print its number of keys.

    Raises FileError if it is invalid. Prints what can never be typed, and raises FileError.
    """
    layout = load(name)
    for problem in layout.problems:
        print(printable(problem))
    if layout.problems:
        many = len(layout.problems)
        what = "1 key or action" if many == 1 else f"{many} keys or actions"
        raise FileError(
            f"layout {name}: {what} can never be typed: change the layout as the lines above "
            "describe",
            name,
        )
    keys = sum(len(row) for row in layout.layers.values())
    many = len(layout.layers)
    layers = "1 layer" if many == 1 else f"{many} layers"
    print(f"{printable(layout.name)}: {keys} keys in {layers}, no problem found")


def show(name: str) -> None:
    """Print a picture of a layout with all its actions."""
    Console().print(picture(load(name)))


class Pushed(NamedTuple):
    """What `push` did.

    `note` is the reason why the keys do not work yet; None if they work. `exposure` has the
    exposure of the board and whether every key is certain; None if it is unknown.
    """

    note: str | None
    exposure: str | None


def push(board: Board, layout: KeyLayout, expose: bool = False) -> Pushed:
    """Upload a layout to a calibrated board, switch on keys, and store both on the board.

    With `expose`, the shortest exposure at which every key is certain is set, unless the user has
    set another one. BoardError if the board refuses the layout or a command.
    """
    info = board.command("hello")
    calibration = stored_calibration(board, info)
    line, chosen_us = "set keys=1", None
    if expose and calibration:
        before = stored_layout(board, info)
        strain_ppm = info["strain_ppm"]
        had_us = None if before is None else shortest_us(calibration, before, strain_ppm)
        chosen_us = shortest_us(calibration, layout.lines, strain_ppm)
        if chosen_us and is_automatic(info["exposure_us"], had_us):
            line += f" exposure_us={chosen_us}"
    upload_lines(board, "layout", layout.lines)
    reply = ensured(board, line)
    note = reply.get("note")
    ensured(board, "save")
    if reply.get("why") == "needs_reboot":  # it is saved already
        note = "reboot the board: until then, it is not the USB keyboard of this layout"
    known = expose and calibration
    return Pushed(note, sentence(reply["exposure_us"], chosen_us) if known else None)


def new_texts(board: Board, layout: KeyLayout) -> list[str]:
    """Return the texts and macros of a layout that the layout on a board does not have.

    They are in the notation of layout files.
    """
    # What one character needs is no text that somebody else could have written.
    texts = {text: own for text, own in layout.texts.items() if len(text) > len("text x")}
    known = _texts_on(board) if texts else set()
    return [text for text, own in texts.items() if own not in known]


def _texts_on(board: Board) -> set[tuple[int, ...]]:
    lines: list[str] = []
    while True:
        part = board.command(f"layout lines {len(lines)}").get("lines")
        if not isinstance(part, list) or not part:
            break
        lines += map(str, part)
    try:
        stored = lines_of.parse(lines)
    except lines_of.LayoutError:  # no layout, or one of another version
        return set()
    found = set()
    for i in range(len(stored._begins)):
        n = stored.behaviour(i)
        if stored.behaviours[n] == lines_of.TEXT:
            first, count = stored.behaviours[n + 1 : n + 3]
            found.add(tuple(stored.steps[first : first + count]))
    return found


def names(word: str) -> list[str]:
    """Return a line for each key whose names contain a word, or that types a character.

    An empty word is for all keys. For a character, the lines name the keys of each host, too.
    SettingError if nothing is found.
    """
    word = normalize("NFC", word)
    found = []
    for one in USAGES.values():
        every = [*ALIASES.get(one.name, ()), one.linux]
        types = one.pynput if one.pynput and len(one.pynput) == 1 else ""
        fits = word == types if len(word) == 1 else word.upper() in " ".join([one.name, *every])
        if fits or word.upper() == one.name:
            found.append(f"{one.name:<{_NAME}} {' '.join(filter(None, [types, *every]))}")
    found += [one for one in ON_BOARDS if len(word) != 1 and word.upper() in one]
    for name, host in every_host().items() if len(word) == 1 else ():
        strokes = host.strokes(word)
        if strokes:
            keys = (_chord(KEYBOARD, stroke.usage, stroke.modifiers) for stroke in strokes)
            found.append(f"host {name:<{_NAME - 5}} {', '.join(keys)}")
    if not found:
        raise SettingError(
            f"no key or host has '{word}': use a part of a name, such as VOL, or 'usage 7:0x87'"
        )
    return found


def picture(layout: KeyLayout) -> Panel:
    """Return a picture of each layer with its keys along the strip, and of what each key does."""
    parts = []
    rules = list(
        dict.fromkeys(
            _rule(layout, key.actions["hold"])
            for keys in layout.layers.values()
            for key in keys
            if key.actions["hold"]
        )
    )
    for name, keys in layout.layers.items():
        actions = [(key.label, _words(layout, key, rules)) for key in keys]
        if any(layout.swipes[name].values()):
            words = {slot: say(layout, one) for slot, one in layout.swipes[name].items()}
            actions.append(("(anywhere)", words))
        parts += [Text(name, style="bold"), row(keys), _table(actions), Text()]
    for one in dict.fromkeys(one.text for one in layout.behaviours):
        lines = _steps(layout, one)
        if lines:
            parts += [Text(one, style="bold"), *map(Text, lines), Text()]
    for number, rule in enumerate(rules, 1):
        title = f"hold ({number})" if len(rules) > 1 else "hold"
        parts += [Text(title, style="bold"), _drawn(rule), Text()]
    return framed(parts[:-1], layout.name, COLUMNS + 6)


def row(keys: list[PlacedKey], lit: int | None = None) -> Text:
    """Return a picture of one layer's keys as one line; the sensor is on the left.

    `lit` is the index of a key to highlight.
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
    """Return an action in the notation of layout files, such as ``toggle`` and the name of a layer.

    The action is encoded as by `spots_device.keys.layout.action`; the text is empty for 0, no
    action.
    """
    if not action:
        return ""
    kind, number, bits = parts_of(action)
    if kind == BEHAVIOUR:
        return layout.behaviours[number].text
    if kind in _VERBS:
        return f"{_VERBS[kind]} {list(layout.layers)[number]}"
    if action in layout.characters:
        return layout.characters[action]
    return _chord(kind, number, bits, layout.characters.get(lines_of.action(kind, number)))


def _chord(page: int, usage: int, bits: int, key: str | None = None) -> str:
    return "+".join([*_modifiers(bits), key or name_of(page, usage)])


def _words(layout: KeyLayout, key: PlacedKey, rules: list) -> dict[str, str]:
    words = {slot: say(layout, one) for slot, one in key.actions.items()}
    if words["hold"] and len(rules) > 1:
        words["hold"] += f" ({rules.index(_rule(layout, key.actions['hold'])) + 1})"
    return words


def _rule(layout: KeyLayout, hold: int) -> tuple[int, ...]:
    """Return flavor and times of a hold, as in a ``behaviour`` line."""
    kind, number, _ = parts_of(hold)
    if kind == BEHAVIOUR and layout.behaviours[number].numbers[0] == lines_of.HOLD_TAP:
        return layout.behaviours[number].numbers[1:5]
    tuning = dict(line.split() for line in layout.lines if len(line.split()) == 2)
    names = "flavor", "tapping_term_ms", "quick_tap_ms", "require_prior_idle_ms"
    return tuple(int(tuning[name]) for name in names)


def _drawn(rule: tuple[int, ...]) -> Table:
    """Return a drawing of what a key does when its finger is alone, and beside another finger."""
    flavor, term_ms, quick_ms, idle_ms = rule
    table = Table.grid(padding=(0, _GAP, 0, 0))
    table.add_column(no_wrap=True)
    table.add_row(flavor_name(flavor), "=" * _TERM, f"tapping term {term_ms} ms")
    for gesture, words in trial.WORDS.items():
        found = trial.play(flavor, gesture)
        what = next(one.what for one in found if one.what != "other")
        fingers = [
            " " * round(_TERM * begin) + mark * round(_TERM * (end - begin))
            for mark, (begin, end) in zip("=-", trial.GESTURES[gesture])
        ]
        table.add_row(words, "\n".join(fingers), what)
    if quick_ms:
        table.add_row("again, soon after a tap", "", f"tap, within {quick_ms} ms")
    if idle_ms:
        table.add_row("soon after another key", "", f"tap, within {idle_ms} ms")
    return table


def _steps(layout: KeyLayout, text: str) -> list[str]:
    """Return what a tap dance or mod-morph does, in lines; empty for other behaviours."""
    kind, *numbers = next(one.numbers for one in layout.behaviours if one.text == text)
    if kind == lines_of.TAP_DANCE:
        term_ms, many, *actions = numbers
        words = [say(layout, one) or "nothing" for one in actions]
        holds = [f", held: {one}" if one != "nothing" else "" for one in words[many:]]
        holds += [""] * (many - len(holds))
        lines = [
            f"{count} tap{'s' * (count > 1)}: {words[count - 1]}{holds[count - 1]}"
            for count in range(1, many + 1)
        ]
        return [*lines, f"at most {term_ms} ms from press to press"]
    if kind == lines_of.MOD_MORPH:
        mods, kept, action, morphed = numbers
        hidden = _modifiers(mods & ~kept)
        without = f", without {' and '.join(hidden)}" if hidden else ""
        return [
            say(layout, action) or "nothing",
            f"with {' or '.join(_modifiers(mods))}: {say(layout, morphed) or 'nothing'}{without}",
        ]
    return []


def _modifiers(bits: int) -> list[str]:
    return [name_of(KEYBOARD, MODIFIERS_FROM + i) for i in range(8) if bits >> i & 1]


def _table(actions: list[tuple[str, dict[str, str]]]) -> Table:
    """Return a table of labels and actions; if its columns are too wide, a line for each action."""
    does = [
        (label, {_heading(slot): text for slot, text in by_slot.items() if text})
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
