"""Words that the page shows: of flags, of untrusted readings, and of keys."""

from __future__ import annotations

from spots.advice.untrusted import CAUSES
from spots.keyboard.hosts import host_of
from spots.keyboard.key_layout import KeyLayout, parts_of
from spots.keyboard.reach import causes
from spots.outputs.usages import USAGES
from spots.terminal.view import FLAG_WORDS
from spots_device.board.settings import checksum
from spots_web.strip_feed import key_name, layout_shown

_HOST = "us"  # the keyboard layout of the page's text field


def words() -> dict:
    """Return the words for JSON; flags are numbers, keys ``page/usage``."""
    host = host_of(_HOST)
    strokes = {character: host.strokes(character) for character in (*host.characters, "\n", "\t")}
    return {
        "words": {"flags": list(FLAG_WORDS.items()), "causes": list(CAUSES.items())},
        "names": {f"{page}/{usage}": key_name(page, usage) for page, usage in USAGES},
        "characters": {
            f"{keys[0].modifiers}/{keys[0].usage}": character
            for character, keys in strokes.items()
            if len(keys) == 1
        },
    }


def layout(made: KeyLayout) -> dict:
    """Return a layout for JSON: its lines, what the page draws, and which key presses a usage.

    Each of the ``places`` has page, usage and modifiers, then layer and number of the key.
    """
    places = [
        (*parts_of(action), name, index)
        for name, keys in made.layers.items()
        for index, key in enumerate(keys)
        for slot in key.actions.values()
        for action in causes(slot, made.behaviours)
    ]
    return {
        "shown": layout_shown(made),
        "lines": made.lines,
        "checksum": checksum(made.lines),
        "places": places,
    }
