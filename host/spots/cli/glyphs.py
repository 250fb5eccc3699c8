"""ASCII substitutes for the glyphs in pictures, for terminals without Unicode."""

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
    """Error handler for `codecs.register_error` that replaces characters.

    It returns the replacement text, and the index at which encoding continues.
    """
    text = error.object[error.start : error.end]
    return "".join(PLAIN.get(character, "?") for character in text), error.end


def never_fail(output: TextIO) -> None:
    """Make a stream replace the characters that it cannot encode, instead of raising an error."""
    codecs.register_error(_HANDLER, plain)
    if isinstance(output, TextIOWrapper):  # other streams encode nothing
        output.reconfigure(errors=_HANDLER)
