"""Changes values in the text of a TOML file, and keeps the rest of the text as it is."""

import re
from collections import Counter
from collections.abc import Callable, Mapping, MutableMapping, MutableSequence
from difflib import SequenceMatcher
from typing import Any

import msgspec
import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Array, Table

from spots.common import toml
from spots.errors import SettingError

# Longer lists are replaced as a whole: the time to compare two lists grows with both lengths.
_PAIRS_MAX = 100_000
# Strings, comments, brackets, commas and other values in the text of a list.
_TOKEN = re.compile(rf"{toml.STRING_OR_COMMENT.pattern}|[\[\]{{}},]|[^\s\[\]{{}},\"'#]+", re.DOTALL)
# What tomlkit raises for valid files that it cannot change.
_UNABLE = TOMLKitError, LookupError, TypeError, ValueError, AttributeError


def edited(text: str, read: Callable[[str], dict], content: dict) -> str:
    """Return the text of a TOML file after a change of its content.

    Comments, line ends, spaces and the notation of unchanged values are kept. If that is not
    possible, all of the text is written again, without comments. `text` is empty for a new file.
    ``read(text)`` returns the content of a text, or raises SpotsError, also for a new content that
    is invalid. SettingError if the content cannot be written as TOML.
    """
    was = read(text) if text else {}
    if was == content:
        return text
    try:
        made = _patched(text, was, content)
        wanted = toml.loads(text) if text else {}
        _update(wanted, was, content)
        kept = toml.loads(made) == wanted
    except RecursionError:
        raise SettingError("tables or lists are nested too deep: write fewer levels") from None
    except (*_UNABLE, msgspec.ValidationError):
        kept = False
    return made if kept else _written(content, text)


def lost_comments(before: str, after: str) -> int:
    """Count the comments that a change of a TOML text removes."""
    return (Counter(toml.comments(before)) - Counter(toml.comments(after))).total()


def _written(content: Mapping, before: str) -> str:
    try:
        made = _patched("", {}, content)
        return made.replace("\n", "\r\n") if "\r\n" in before else made
    except _UNABLE as error:
        raise SettingError(f"the content cannot be written as TOML: {error}") from None


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
            _update_list(table, key, before, after)
        else:
            table[key] = _item(after, table)


def _alike(table: Mapping, key: str, after: list) -> bool:
    """Return whether the list `after` can be written in the notation of the list in `table`."""
    there = table[key]
    tables = not isinstance(there, AoT) or all(isinstance(one, dict) for one in after)
    return tables and 0 < len(there) * len(after) <= _PAIRS_MAX


def _update_list(table: MutableMapping, key: str, was: list, now: list) -> None:
    items = table[key]
    if isinstance(items, Array):
        text = _array(items.as_string(), was, now)
        table[key] = tomlkit.parse(f"key = {text}")["key"]
    elif isinstance(items, AoT):
        _update_tables(items, was, now)
    else:
        table[key] = _merged(items, was, now)


def _merged(items: list, was: list, now: list) -> list:
    """Return the content of a list, with the default values of its tables, after a change."""
    for i0, i1, j0, j1 in reversed(_changes(was, now)):
        both = min(i1 - i0, j1 - j0)
        items[i0 + both : i1] = now[j0 + both : j1]
        for i, j in zip(range(i0, i0 + both), range(j0, j1)):
            if isinstance(items[i], dict) and isinstance(now[j], dict):
                _update(items[i], was[i] if isinstance(was[i], dict) else {}, now[j])
            else:
                items[i] = now[j]
    return items


def _update_tables(tables: MutableSequence, was: list, now: list) -> None:
    for i0, i1, j0, j1 in reversed(_changes(was, now)):
        both = min(i1 - i0, j1 - j0)
        del tables[i0 + both : i1]
        for i, one in enumerate(now[j0 + both : j1], i0 + both):
            _insert_table(tables, i, one)
        for i, j in zip(range(i0, i0 + both), range(j0, j1)):
            _update(tables[i], was[i], now[j])


def _array(text: str, was: list, now: list) -> str:
    """Return the text of a list, with its brackets, after its content `was` became `now`."""
    entries = _entries(text)
    for i0, i1, j0, j1 in reversed(_changes(was, now)):
        both = min(i1 - i0, j1 - j0)
        for i in reversed(range(i0 + both, i1)):
            text = _without(text, entries, i)
            entries = _entries(text)
        for one in reversed(now[j0 + both : j1]):
            text = _with(text, entries, i0 + both, _literal(one))
            entries = _entries(text)
        for i, j in reversed(list(zip(range(i0, i0 + both), range(j0, j1)))):
            begin, end, _ = entries[i]
            text = text[:begin] + _changed(text[begin:end], was[i], now[j]) + text[end:]
    return text


def _changed(text: str, was: Any, now: Any) -> str:
    """Return the text of an entry of a list whose value `was` became `now`."""
    if not (isinstance(was, dict) and isinstance(now, dict)):
        return text if was == now else _literal(now)
    document = tomlkit.parse(f"entry = {text}")
    _update(document["entry"], was, now)
    return document["entry"].as_string()


def _literal(value: Any) -> str:
    return tomlkit.item(_item(value, tomlkit.array())).as_string()


def _entries(text: str) -> list[tuple[int, int, int | None]]:
    """Return the entries of a list: begin and end of the value, and place of the comma after it."""
    found: list[tuple[int, int, int | None]] = []
    begin = end = None
    depth = 0
    for match in _TOKEN.finditer(text):
        token = match[0]
        if token[0] == "#":
            continue
        if depth == 1 and token in (",", "]"):
            if begin is not None:
                found.append((begin, end, match.start() if token == "," else None))
            begin = None
        elif depth >= 1:
            begin = match.start() if begin is None else begin
            end = match.end()
        depth += (token in ("[", "{")) - (token in ("]", "}"))
    return found


def _without(text: str, entries: list, at: int) -> str:
    """Return the text of a list without an entry, and without the comment on its line."""
    begin, end, comma = entries[at]
    stop = end if comma is None else comma + 1
    indent = _indent(text, begin)
    rest = re.match(r"[ \t]*(?:#[^\n]*)?\n", text[stop:])
    if indent is not None and rest and "\n" not in text[end:stop]:  # a line of its own
        return text[: begin - len(indent)] + text[stop + rest.end() :]
    if comma is None and at > 0:  # the comma before the last entry goes, too
        before = entries[at - 1][1]
        begin = begin if "#" in text[before:begin] else before
    return text[:begin] + text[stop:].lstrip(" \t")


def _with(text: str, entries: list, at: int, literal: str) -> str:
    """Return the text of a list with a new entry, on a line of its own if the others have one."""
    if at < len(entries):
        begin = entries[at][0]
        indent = _indent(text, begin)
        gap = " " if indent is None else f"\n{indent}"
        return f"{text[:begin]}{literal},{gap}{text[begin:]}"
    begin, end, comma = entries[-1]
    indent = _indent(text, begin)
    if comma is None:
        text = f"{text[:end]},{text[end:]}"
    stop = (end if comma is None else comma) + 1
    comment = re.match(r"[ \t]*#[^\n]*|", text[stop:])[0]
    gap = " " if indent is None and not comment else f"\n{indent or ''}"
    closing = "" if comma is None else ","
    stop += len(comment)
    return f"{text[:stop]}{gap}{literal}{closing}{text[stop:]}"


def _indent(text: str, begin: int) -> str | None:
    """Return the space before an entry that is the first one on its line, else None."""
    line = text.rfind("\n", 0, begin) + 1
    before = text[line:begin]
    return before if line and not before.strip() else None


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
