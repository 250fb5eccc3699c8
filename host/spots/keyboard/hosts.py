"""Layouts of computers: which keys type a character, by the table ``hosts.txt``.

A keyboard sends positions of keys; the layout of the computer decides which character appears.
The table, written by tools/host_layouts.py, has those of Linux desktops and of Windows. A Mac has
the same characters as Linux on most keys, but others with Option, its name of AltGr. What a system
is not known to type is refused for it.
"""

import itertools
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import NamedTuple

from ..errors import SettingError

FILE = Path(__file__).with_name("hosts.txt")
LINUX, WINDOWS, MAC = SYSTEMS = ("linux", "windows", "mac")
AMERICAN = "us"
BOTH = "both"  # what Linux and Windows have in common
# Usages of the keys that type characters: the order of the columns of the table. The last four are
# space, the key beside left shift, and two keys of Brazilian and Japanese keyboards.
KEYS = (*range(0x04, 0x28), *range(0x2D, 0x32), *range(0x33, 0x39), 0x2C, 0x64, 0x87, 0x89)
NOTHING = "none"  # in the table: a key without a character
SAME = "same"  # in the table: a row of Windows that is equal to that of Linux
SHIFT, ALT_GR = 0x02, 0x40  # bits of left shift and right alt
LEVELS = (0, SHIFT, ALT_GR, SHIFT | ALT_GR)
_EVERYWHERE = {"\n": 0x28, "\t": 0x2B}  # enter and tab
# Not every keyboard has the last three keys, so other keys are preferred: by this many levels.
_RARE, _RARE_COST = KEYS[-3:], 1.5
# What dead keys without AltGr make on Macs, too.
_LETTERS = "áàâäãéèêëíìîïóòôöõúùûüñčďěňřšťž"
_BY_DEAD_KEYS = {*_LETTERS, *_LETTERS.upper(), *"^`~'\""}
_NAMED_MAX = 6  # layouts in an error message


class Stroke(NamedTuple):
    """A key of HID page 7 that is pressed once, with the bits of its modifier keys."""

    modifiers: int
    usage: int


class Sequence(NamedTuple):
    """Dead keys and the key after them, with the character that they make."""

    dead: tuple[str, ...]
    last: str
    result: str


class Table(NamedTuple):
    """The part of ``hosts.txt`` for one layout.

    `name` is that of layout files, such as ``de``; `xkb` that of XKB; `language` the locale of the
    users without its encoding. `rows` has, for no modifier, shift, AltGr, and shift with AltGr, the
    characters and the names of dead keys, in the order of `KEYS`. `without` has characters of dead
    keys that the languages of a layout make in different ways. `windows` are the rows of Windows,
    `accents` what its dead keys make; without rows, only those of Linux without AltGr and without
    dead keys are known.
    """

    name: str
    xkb: str
    language: str
    rows: list[list[str]]
    without: set[str]
    windows: list[list[str]]
    accents: list[Sequence]


class Host:
    """The layout of a computer with one of `SYSTEMS`, or of `BOTH`.

    `sequences` is what dead keys make on Linux.
    """

    def __init__(self, table: Table, sequences: list[Sequence], system: str):
        self.name = table.name
        self._rows, made = _of_system(table, sequences, system)
        ways = _ways(self._rows, made)
        if system == BOTH:
            # The same keys must type the same.
            other = _ways(*_of_system(table, sequences, LINUX))
            for text, own in ways.items():
                for strokes in own.keys() - other.get(text, {}).keys():
                    del own[strokes]
        self._at = {text: min(own, key=own.__getitem__) for text, own in ways.items() if own}
        self._made = {strokes: text for text, own in ways.items() for strokes in own}

    @property
    def characters(self) -> list[str]:
        """All characters that this layout types."""
        return sorted(self._at)

    def strokes(self, character: str) -> tuple[Stroke, ...]:
        """Return the keys that type a character one after the other; empty if none do.

        A line feed is the key enter, a tab the key tab.
        """
        if character in _EVERYWHERE:
            return (Stroke(0, _EVERYWHERE[character]),)
        return self._at.get(character, ())

    def key(self, letter: str) -> Stroke | None:
        """Return the key with this letter, in either case, on it; None if there is none."""
        for level, row in enumerate(self._rows[:2] if letter.isalpha() else ()):
            for usage, text in zip(KEYS, row):
                if (
                    text == letter
                    and self._at.get(letter)
                    and _is_cap(letter, level, usage, self._rows)
                ):
                    return Stroke(0, usage)
        return None

    def typed(self, stroke: Stroke) -> str:
        """Return the character of a key, or the name of its dead key; empty if it has none."""
        level = LEVELS.index(stroke.modifiers) if stroke.modifiers in LEVELS else len(LEVELS)
        if level >= len(self._rows) or stroke.usage not in KEYS:
            return ""
        text = self._rows[level][KEYS.index(stroke.usage)]
        return "" if text == NOTHING else text

    def made(self, strokes: tuple[Stroke, ...]) -> str:
        """Return the character that dead keys and the key after them type; empty if none."""
        return self._made.get(strokes, "")

    def cap(self, usage: int) -> str:
        """Return the character on the cap of a key, a letter as capital; empty if it has none."""
        small, large = (self.typed(Stroke(bits, usage)) for bits in (0, SHIFT))
        return "" if len(small) > 1 or small == " " else large if large.isupper() else small


def _of_system(
    table: Table, sequences: list[Sequence], system: str
) -> tuple[list[list[str]], list[Sequence]]:
    """Return the rows that are known of a system, and what its dead keys make."""
    if system == LINUX:
        return table.rows, [one for one in sequences if one.result not in table.without]
    if system == MAC:
        made = [one for one in sequences if one.result in _BY_DEAD_KEYS - table.without]
        return table.rows[:2], made
    return (table.windows, table.accents) if table.windows else (table.rows[:2], [])


def _ways(
    rows: list[list[str]], sequences: list[Sequence]
) -> dict[str, dict[tuple[Stroke, ...], float]]:
    """Return all ways to type each character, with their costs."""
    direct: dict[str, dict[Stroke, float]] = {}  # characters and dead keys
    for level, row in enumerate(rows):
        for usage, text in zip(KEYS, row):
            cost = level + (_RARE_COST if usage in _RARE else 0)
            direct.setdefault(text, {})[Stroke(LEVELS[level], usage)] = cost
    ways = {
        text: {(stroke,): cost for stroke, cost in own.items()}
        for text, own in direct.items()
        if len(text) == 1
    }
    for one in sequences:
        parts = [direct.get(text) for text in (*one.dead, one.last)]
        if one.result in direct or not all(parts):
            continue
        for keys in itertools.product(*(part.items() for part in parts if part)):
            # Few strokes first: a cost is below 10.
            cost = 10 * len(keys) + sum(cost for _, cost in keys)
            ways.setdefault(one.result, {})[tuple(stroke for stroke, _ in keys)] = cost
    return ways


def _is_cap(letter: str, level: int, usage: int, rows: list[list[str]]) -> bool:
    # Whether a letter, or the capital of it, is what a key types without a modifier.
    first = rows[0][KEYS.index(usage)]
    return level == 0 or (level == 1 and first.upper() == letter)


def read(lines: Iterable[str]) -> tuple[list[Table], list[Sequence]]:
    """Return the layouts of the lines of ``hosts.txt``, and what dead keys make."""
    tables: list[Table] = []
    rows: list[list[str]] = []  # that of the last table
    sequences: list[Sequence] = []
    accents: list[list[Sequence]] = []
    for line in lines:
        word, *words = line.split()
        if word == "host":
            tables.append(Table(*words, [], set(), [], []))
            rows = tables[-1].rows
        elif not tables and word in ("dead", "accent"):
            dead, *texts = words
            made = [
                Sequence(tuple(dead.split(",")), last, result)
                for last, result in zip(map(_text, texts[::2]), map(_text, texts[1::2]))
            ]
            if word == "dead":
                sequences += made
            else:
                accents.append(made)
        elif not tables:
            continue  # a comment
        elif word == "windows":
            rows = tables[-1].windows
            for number in words:
                tables[-1].accents.extend(accents[int(number)])
        elif word == "without":
            tables[-1].without.update(map(_text, words))
        else:
            texts = list(map(_text, (word, *words)))
            texts += [NOTHING] * (len(KEYS) - len(texts))
            linux = tables[-1].rows
            if word == SAME and not words:
                texts = linux[len(rows)] if len(rows) < len(linux) else [NOTHING] * len(KEYS)
            rows.append(texts)
    return tables, sequences


def _text(word: str) -> str:
    return chr(int(word[2:], 16)) if word.startswith("U+") and len(word) > 2 else word


@cache
def every(system: str = LINUX) -> dict[str, Host]:
    """Return all layouts of a system (one of `SYSTEMS`) by their names."""
    tables, sequences = read(FILE.read_text("utf-8").splitlines())
    return {table.name: Host(table, sequences, system) for table in tables}


def host_of_file(content: dict) -> Host | None:
    """Return the layout of the computer that the content of a layout file names."""
    name = content.get("host")
    return host_of(name, content.get("os") or BOTH) if name else None


def host_of(name: str, system: str = LINUX) -> Host:
    """Return a layout; SettingError with all names if there is none of this name."""
    hosts = every(system)
    if name not in hosts:
        raise SettingError(f"there is no host '{name}': use one of {', '.join(hosts)}")
    return hosts[name]


def first(character: str) -> str:
    """Return the first layout that types a character; the American one if none does."""
    names = (name for name, host in every().items() if host.strokes(character))
    return next(names, AMERICAN)


def typing(character: str, system: str = LINUX) -> str:
    """Return which layouts of a system type a character, such as "these hosts can: de, ch"."""
    names = [name for name, host in every(system).items() if host.strokes(character)]
    if not names:
        return "no host of SPOTS can"
    more = " and others" if len(names) > _NAMED_MAX else ""
    return f"these hosts can: {', '.join(names[:_NAMED_MAX])}{more}"
