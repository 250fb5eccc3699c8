"""ASCII characters for the glyphs of pictures, for terminals without Unicode."""

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
    """Replace characters that cannot be encoded; an error handler of `codecs.register_error`."""
    text = error.object[error.start : error.end]
    return "".join(PLAIN.get(character, "?") for character in text), error.end


def never_fail(output: TextIO) -> None:
    """Let a stream replace characters that its encoding does not have, instead of failing."""
    codecs.register_error(_HANDLER, plain)
    if isinstance(output, TextIOWrapper):  # other streams encode nothing
        output.reconfigure(errors=_HANDLER)
