"""Changes values in the text of a TOML file, and keeps the rest of the text as it is."""

from collections import Counter
from collections.abc import Callable, Mapping, MutableMapping, MutableSequence
from difflib import SequenceMatcher
from typing import Any

import msgspec
import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Array, Table

from .. import toml
from ..errors import SpotsError

# Longer lists are replaced as a whole: the time to compare two lists grows with both lengths.
_PAIRS_MAX = 100_000
# What tomlkit raises for valid files that it cannot change.
_UNABLE = TOMLKitError, LookupError, TypeError, ValueError, AttributeError


def edited(text: str, read: Callable[[str], dict], content: dict) -> str:
    """Return the text of a TOML file after a change of its content.

    Comments, line ends, spaces and the notation of unchanged values are kept. If that is not
    possible, all of the text is written again, without comments.

    Parameters
    ----------
    text : str
        Valid text of the file; empty for a new file.
    read : callable
        ``read(text)`` returns the content of a text, or raises SpotsError if it is invalid.
    content : dict
        New content of the file.

    Returns
    -------
    str
        The new text. If `content` is invalid, ``read`` raises SpotsError for this text.

    Raises
    ------
    SpotsError
        If `content` cannot be written as TOML.
    """
    was = read(text) if text else {}
    if was == content:
        return text
    try:
        made = _patched(text, was, content)
        toml.loads(made)
        try:
            kept = read(made) == content
        except SpotsError:
            kept = True  # the new content is invalid, not its text
    except RecursionError:
        raise SpotsError("tables or lists are nested too deep") from None
    except (*_UNABLE, msgspec.ValidationError):
        kept = False
    return made if kept else _written(content, text)


def lost_comments(before: str, after: str) -> int:
    """Count the comments that a change of a TOML text removes.

    Parameters
    ----------
    before, after : str
        The text before and after the change.

    Returns
    -------
    int
    """
    return (Counter(toml.comments(before)) - Counter(toml.comments(after))).total()


def _written(content: Mapping, before: str) -> str:
    try:
        made = _patched("", {}, content)
        return made.replace("\n", "\r\n") if "\r\n" in before else made
    except _UNABLE as error:
        raise SpotsError(f"the content cannot be written as TOML: {error}") from None


def _patched(text: str, was: Mapping, now: Mapping) -> str:
    crlf = 0 < text.count("\r\n") == text.count("\n")
    document = tomlkit.parse(text.replace("\r\n", "\n") if crlf else text)
    _update(document, was, now)
    made = tomlkit.dumps(document)
    return made.replace("\n", "\r\n") if crlf else made


def _update(table: MutableMapping, was: Mapping, now: Mapping) -> None:
    """Change `table`, whose content is `was` and perhaps default values, to the content `now`."""
    for key in dict.fromkeys([*was, *now]):
        before, after = was.get(key), now.get(key)
        if key not in now:
            table.pop(key, None)
        elif key in was and before == after:
            continue
        elif isinstance(after, dict) and isinstance(table.get(key), dict):
            _update(table[key], before or {}, after)
        elif isinstance(before, list) and isinstance(after, list) and _alike(table, key, after):
            _update_list(table[key], before, after)
        else:
            table[key] = _item(after, table)


def _alike(table: Mapping, key: str, after: list) -> bool:
    """Return whether the list `after` can be written in the notation of the list in `table`."""
    there = table[key]
    tables = not isinstance(there, AoT) or all(isinstance(one, dict) for one in after)
    return tables and 0 < len(there) * len(after) <= _PAIRS_MAX


def _update_list(items: MutableSequence, was: list, now: list) -> None:
    for i0, i1, j0, j1 in reversed(_changes(was, now)):
        both = min(i1 - i0, j1 - j0)
        for i in reversed(range(i0 + both, i1)):
            del items[i]
        for i, one in enumerate(now[j0 + both : j1], i0 + both):
            if isinstance(items, AoT):
                _insert_table(items, i, one)
            else:
                items.insert(i, _item(one, items))
        for i, j in zip(range(i0, i0 + both), range(j0, j1)):
            if isinstance(items[i], dict) and isinstance(now[j], dict):
                _update(items[i], was[i] if isinstance(was[i], dict) else {}, now[j])
            elif was[i] != now[j]:
                items[i] = _item(now[j], items)


def _changes(was: list, now: list) -> list[tuple[int, int, int, int]]:
    """Return the changed ranges of two lists: begin and end in `was`, begin and end in `now`."""
    texts = [[msgspec.json.encode(x, order="deterministic") for x in many] for many in (was, now)]
    codes = SequenceMatcher(None, *texts, autojunk=False).get_opcodes()
    ranges = [tuple(code[1:]) for code in codes if code[0] != "equal"]
    # Among equal entries, the matcher can take a new value for an added and a removed entry.
    moved = sum(max(i1 - i0, j1 - j0) for i0, i1, j0, j1 in ranges)
    if len(was) == len(now) and sum(a != b for a, b in zip(*texts)) < moved:
        return [(0, len(was), 0, len(now))]
    return ranges


def _item(value: Any, inside: MutableMapping | MutableSequence) -> Any:
    """Return a value for tomlkit, in the notation for its place: in the file, a table or a list."""
    if isinstance(value, dict) and isinstance(inside, Array):
        inline = tomlkit.inline_table()
        inline.update(value)
        return inline
    if not isinstance(value, list) or not isinstance(inside, (tomlkit.TOMLDocument, Table)):
        return value
    if isinstance(inside, tomlkit.TOMLDocument) and all(isinstance(one, dict) for one in value):
        tables = tomlkit.aot()
        for i, one in enumerate(value):
            _insert_table(tables, i, one)
        return tables
    array = tomlkit.array()
    array.extend(_item(one, array) for one in value)
    return array.multiline(any(isinstance(one, dict) for one in value))


def _insert_table(tables: AoT, at: int, content: dict) -> None:
    table = tomlkit.table()
    for name, one in content.items():
        table[name] = _item(one, table)
    # An empty line separates the tables. Between two tables, it belongs to the first one.
    between = tables[at - 1].as_string().endswith("\n\n") if at else len(tables) > 0
    if between:
        table.add(tomlkit.nl())
    else:
        table.trivia.indent = "\n"
    tables.insert(at, table)
