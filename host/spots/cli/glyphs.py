"""Pictures where the locale has no Unicode: each glyph has a plain character of its width."""

from __future__ import annotations

import codecs
from io import TextIOWrapper
from typing import TextIO

_HANDLER = "spots.plain"
_STAND_INS = {
    "#": "█▉▊▋▌",
    "|": "▍▎▏▐▕│",
    "=": "▇▆▅▄━═",
    "-": "▃▂▁─·",
    "+": "╭╮╰╯╪",
    "<": "◀◁",
    ">": "▶▷",
    "^": "▲",
    "o": "●°",
    "u": "µ",
    "2": "²",
}
PLAIN = {glyph: plain for plain, glyphs in _STAND_INS.items() for glyph in glyphs}


def plain(error: UnicodeError) -> tuple[str, int]:
    """Return the characters for what cannot be encoded, as `codecs.register_error` wants it."""
    text = error.object[error.start : error.end]
    return "".join(PLAIN.get(character, "?") for character in text), error.end


def never_fail(output: TextIO) -> None:
    """Let a stream write plain characters for those that its encoding does not have."""
    codecs.register_error(_HANDLER, plain)
    if isinstance(output, TextIOWrapper):  # else it encodes nothing
        output.reconfigure(errors=_HANDLER)
