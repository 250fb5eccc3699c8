"""Layouts of computers: which keys type a character, by the table ``hosts.txt``.

A keyboard sends positions of keys; the layout of the computer decides which character appears.
The table is that of Linux desktops, written by tools/host_layouts.py. Windows has the same
characters on most keys, but fewer with AltGr and behind dead keys. A Mac has others with Option,
its name of AltGr. What a system is not known to type is refused for it.
"""

from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import NamedTuple

from ..errors import SettingError

FILE = Path(__file__).with_name("hosts.txt")
LINUX, WINDOWS, MAC = SYSTEMS = ("linux", "windows", "mac")
# Usages of the keys that type characters: the order of the columns of the table. The last four are
# space, the key beside left shift, and two keys of Brazilian and Japanese keyboards.
KEYS = (*range(0x04, 0x28), *range(0x2D, 0x32), *range(0x33, 0x39), 0x2C, 0x64, 0x87, 0x89)
NOTHING = "none"  # in the table: a key without a character
SHIFT, ALT_GR = 0x02, 0x40  # bits of left shift and right alt
_LEVELS = (0, SHIFT, ALT_GR, SHIFT | ALT_GR)
_EVERYWHERE = {"\n": 0x28, "\t": 0x2B}  # enter and tab
# Not every keyboard has the last three keys, so other keys are preferred: by this many levels.
_RARE, _RARE_COST = KEYS[-3:], 1.5
# What dead keys without AltGr make on Windows and Macs, too.
_LETTERS = "áàâäãéèêëíìîïóòôöõúùûüñčďěňřšťž"
_BY_DEAD_KEYS = {*_LETTERS, *_LETTERS.upper(), *"^`~'\""}
_NAMED_MAX = 6  # layouts in an error message


class Stroke(NamedTuple):
    """A key of HID page 7 that is pressed once, with the bits of its modifier keys."""

    modifiers: int
    usage: int


class Table(NamedTuple):
    """The part of ``hosts.txt`` for one layout.

    `name` is that of layout files, such as ``de``; `xkb` that of XKB; `language` the locale of the
    users without its encoding. `rows` has, for no modifier, shift, AltGr, and shift with AltGr, the
    characters and the names of dead keys, in the order of `KEYS`. `windows` has the keys that type
    the same character with AltGr on Windows. `without` has characters of dead keys that the
    languages of a layout make in different ways.
    """

    name: str
    xkb: str
    language: str
    rows: list[list[str]]
    windows: list[Stroke]
    without: set[str]


class Sequence(NamedTuple):
    """Dead keys and the key after them, with the character that they make."""

    dead: tuple[str, ...]
    last: str
    result: str


class Host:
    """The layout of a computer with one of `SYSTEMS`; `sequences` is what dead keys make."""

    def __init__(self, table: Table, sequences: list[Sequence], system: str = LINUX):
        self.name = table.name
        self._at: dict[str, tuple[float, tuple[Stroke, ...]]] = {}  # characters and dead keys
        self._keys: dict[str, Stroke] = {}  # letters
        for level, row in enumerate(table.rows):
            for usage, text in zip(KEYS, row):
                stroke = Stroke(_LEVELS[level], usage)
                if text != NOTHING and (level < 2 or _is_known(stroke, table, system)):
                    self._add(text, level + (_RARE_COST if usage in _RARE else 0), (stroke,))
                    if len(text) == 1 and text.isalpha() and _is_cap(text, level, usage, table):
                        self._keys.setdefault(text, Stroke(0, usage))
        self._direct = set(self._at)
        for one in sequences:
            self._compose(one, table, system)

    @property
    def characters(self) -> list[str]:
        """All characters that this layout types."""
        return sorted(one for one in self._at if len(one) == 1)

    def strokes(self, character: str) -> tuple[Stroke, ...]:
        """Return the keys that type a character one after the other; empty if none do.

        A line feed is the key enter, a tab the key tab.
        """
        if character in _EVERYWHERE:
            return (Stroke(0, _EVERYWHERE[character]),)
        return self._at[character][1] if len(character) == 1 and character in self._at else ()

    def key(self, letter: str) -> Stroke | None:
        """Return the key with this letter, in either case, on it; None if there is none."""
        return self._keys.get(letter)

    def _add(self, text: str, cost: float, strokes: tuple[Stroke, ...]) -> None:
        if text not in self._at or cost < self._at[text][0]:
            self._at[text] = cost, strokes

    def _compose(self, one: Sequence, table: Table, system: str) -> None:
        if one.result in self._direct or one.result in table.without:
            return
        if not self._direct.issuperset((*one.dead, one.last)):
            return
        keys = [self._at[text] for text in (*one.dead, one.last)]
        if system == LINUX or one.result in _BY_DEAD_KEYS:
            # Few strokes first: a cost is below 10.
            cost = 10 * len(keys) + sum(cost for cost, _ in keys)
            self._add(one.result, cost, tuple(stroke for _, (stroke,) in keys))


def _is_cap(letter: str, level: int, usage: int, table: Table) -> bool:
    # Whether a letter, or the capital of it, is what a key types without a modifier.
    first = table.rows[0][KEYS.index(usage)]
    return level == 0 or (level == 1 and first.upper() == letter)


def _is_known(stroke: Stroke, table: Table, system: str) -> bool:
    # Whether a key with AltGr types on a system what it types on Linux.
    return system == LINUX or (system == WINDOWS and stroke in table.windows)


def read(lines: Iterable[str]) -> tuple[list[Table], list[Sequence]]:
    """Return the layouts of the lines of ``hosts.txt``, and what dead keys make."""
    tables: list[Table] = []
    sequences = []
    for line in lines:
        word, *words = line.split()
        if word == "host":
            tables.append(Table(*words, [], [], set()))
        elif not tables and word == "dead":
            dead, *texts = words
            for last, result in zip(texts[::2], texts[1::2]):
                sequences.append(Sequence(tuple(dead.split(",")), _text(last), _text(result)))
        elif not tables:
            continue  # a comment
        elif word == "windows":
            strokes = (Stroke(*(int(number, 16) for number in one.split(":"))) for one in words)
            tables[-1].windows.extend(strokes)
        elif word == "without":
            tables[-1].without.update(map(_text, words))
        else:
            tables[-1].rows.append(list(map(_text, (word, *words))))
    return tables, sequences


def _text(word: str) -> str:
    return chr(int(word[2:], 16)) if word.startswith("U+") and len(word) > 2 else word


@cache
def every(system: str = LINUX) -> dict[str, Host]:
    """Return all layouts of a system (one of `SYSTEMS`) by their names."""
    tables, sequences = read(FILE.read_text("utf-8").splitlines())
    return {table.name: Host(table, sequences, system) for table in tables}


def host_of(name: str, system: str = LINUX) -> Host:
    """Return a layout; SettingError with all names if there is none of this name."""
    hosts = every(system)
    if name not in hosts:
        raise SettingError(f"there is no host '{name}': use one of {', '.join(hosts)}")
    return hosts[name]


def typing(character: str, system: str = LINUX) -> str:
    """Return which layouts of a system type a character, such as "these hosts can: de, ch"."""
    names = [name for name, host in every(system).items() if host.strokes(character)]
    if not names:
        return "no host of SPOTS can"
    more = " and others" if len(names) > _NAMED_MAX else ""
    return f"these hosts can: {', '.join(names[:_NAMED_MAX])}{more}"
