"""What a computer types: from the reports of a USB keyboard, and from a virtual keyboard."""

from spots.outputs.devices import Keyboard
from spots.outputs.usages import MODIFIERS_FROM, USAGES, is_modifier, name_of

SHIFTED = dict(zip("1234567890-=[]\\;'`,./", '!@#$%^&*()_+{}|:"~<>?'))
_SHIFT = 0x22


def typed(page, usage, modifiers):
    """Return what a key types while modifiers are down; a shortcut or special key as its name."""
    character = (page == 7 and USAGES[page, usage].pynput) or ""
    if len(character) == 1 and not modifiers & ~_SHIFT:
        return SHIFTED.get(character, character.upper()) if modifiers else character
    return f"<{modifiers:02x} {name_of(page, usage)}>"


def text_of(reports):
    """Return what a computer types for keyboard reports, in their order."""
    before, text = set(), ""
    for report in reports:
        now = set(report[2:8]) - {0}
        text += "".join(
            typed(7, usage, report[0]) for usage in report[2:8] if usage in now - before
        )
        before = now
    return text


class Computer(Keyboard):
    """A virtual keyboard; `text` is what the computer types, `log` has the presses and releases."""

    def __init__(self):
        super().__init__()
        self.text = ""
        self.log = []
        self._typed = []

    def _set(self, one, pressed):
        self.log.append(("+" if pressed else "-") + one.name)
        if pressed and not is_modifier(one.page, one.usage):
            down = [each.usage for each in self._down if is_modifier(each.page, each.usage)]
            bits = sum(1 << usage - MODIFIERS_FROM for usage in down)
            self._typed.append((one.page, typed(one.page, one.usage, bits)))
            self.text += self._typed[-1][1]

    def typed_on(self, page):
        """Return what the keys of a HID usage page typed."""
        return [text for each, text in self._typed if each == page]

    @property
    def down(self):
        """Names of the keys that are down."""
        return [one.name for one in self._down]
