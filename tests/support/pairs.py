"""Pairs of actions at once, and a model of what a computer types for them."""

from typing import NamedTuple

from spots.outputs.usages import MODIFIERS_FROM, chord_of, is_modifier
from support.computer import typed

ACTIONS = [
    "A", "B", "Z", "1", "=", "/", "BACKSLASH", "SPACEBAR", "ENTER", "TAB", "BACKSPACE", "F5",
    "LEFT_SHIFT+A", "RIGHT_SHIFT+B", "LEFT_SHIFT+1", "LEFT_SHIFT+=", "LEFT_SHIFT+BACKSLASH",
    "LEFT_CONTROL+C", "V", "LEFT_ALT+TAB", "LEFT_CONTROL+LEFT_SHIFT+T", "LEFT_GUI+L",
    "LEFT_SHIFT", "RIGHT_SHIFT", "LEFT_CONTROL", "LEFT_ALT+LEFT_SHIFT",
    "LEFT_CONTROL+LEFT_SHIFT+LEFT_ALT+LEFT_GUI", "VOLUME_INCREMENT", "MUTE", "KEYPAD_PLUS",
]  # fmt: skip
HOW = {  # order of presses (+) and releases (-) of the keys a and b
    "rolled": ("+a", "+b", "-a", "-b"),
    "nested": ("+a", "+b", "-b", "-a"),
    "repeated": ("+a", "+b", "-b", "+b", "-a", "-b"),
}


class Pair(NamedTuple):
    """Two actions, and how they are pressed."""

    a: str
    b: str
    how: str

    @property
    def events(self):
        """(is a press, name of the key)."""
        return [(word[0] == "+", word[1]) for word in HOW[self.how]]

    def text(self):
        """Return what a computer types: a key types with its modifiers and with modifier keys."""
        text, held = "", {"a": 0, "b": 0}
        for is_press, name in self.events:
            page, usage, bits = chord_of(getattr(self, name))
            if is_modifier(page, usage):
                held[name] = is_press * (bits | 1 << usage - MODIFIERS_FROM)
            elif is_press:
                text += typed(page, usage, bits | held["a"] | held["b"])
        return text


def some(rng, count, actions=None):
    """Return random pairs, all of them different actions or twice the same one."""
    chosen = actions or ACTIONS
    return [Pair(*rng.choice(chosen, 2), rng.choice(list(HOW))) for _ in range(count)]
