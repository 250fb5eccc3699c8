"""What the keys, characters and texts of a layout file are on the computer of its user."""

from unicodedata import normalize

from spots_device.keys import layout as lines_of
from spots_device.usb.usages import KEYS_MAX

from ..errors import SettingError, SpotsError
from ..outputs.usages import (
    CONSUMER,
    KEYBOARD,
    MODIFIERS_FROM,
    modifier_bits,
    split_chord,
    usage_of,
)
from . import hosts

_LEFT_CONTROL, _LEFT_ALT, _LEFT_GUI = 0x01, 0x04, 0x08
# Modifiers that depend on the system: that of commands, and that of moves by a word.
_BY_SYSTEM = {
    "PRIMARY": {hosts.MAC: _LEFT_GUI, hosts.WINDOWS: _LEFT_CONTROL, hosts.LINUX: _LEFT_CONTROL},
    "WORD": {hosts.MAC: _LEFT_ALT, hosts.WINDOWS: _LEFT_CONTROL, hosts.LINUX: _LEFT_CONTROL},
}
# In the order of the firmware's table.
_CAPS_KEYS = (*range(0x04, 0x39), 0x64, 0x87, 0x89)
_KEPT = {"press": lines_of.PRESS, "release": lines_of.RELEASE}
_WAIT_UNIT_MS, _WAIT_MAX_MS = 10, 60_000
_UNITS_MAX = 0xFF  # of a step that waits


class Writing:
    """Translates what a layout file names into keys, for one host layout and system.

    If the file names no system, only what is equal on Linux and Windows can be typed. `host` is the
    host layout, or None. `shown` has the characters of the file by their actions, as encoded by
    `spots_device.keys.layout.action`.
    SettingError if there is no such host layout.
    """

    def __init__(self, host: str | None, system: str | None):
        self.host = hosts.host_of(host, system or hosts.BOTH) if host else None
        self._system = system
        self.shown: dict[int, str] = {}

    def actions(self, text: str) -> list[int]:
        """Return the actions that press a key or type a character, one after the other.

        Modifiers and ``+`` may come before it. Only a character that needs dead keys has several
        actions. SettingError if a name is unknown, or the host cannot type the character.
        """
        # ü may be u and a combining mark.
        modifiers, name = split_chord(self._composed(text))
        bits = self._bits(modifiers)
        if len(name) != 1 or (self.host is None and _is_key(name)):
            return [lines_of.action(*usage_of(name), bits)]
        key = self.host.key(name) if self.host else None
        strokes = (key,) if key else self._strokes(name)
        if bits and (len(strokes) > 1 or strokes[0].modifiers & bits):
            raise SettingError(
                f"'{name}' needs {'two keys' if len(strokes) > 1 else 'shift or AltGr'} on this "
                "host, so it cannot have these modifiers: name the character that you want"
            )
        actions = [_action(stroke, bits) for stroke in strokes]
        if len(actions) == 1:
            self.shown.setdefault(_action(strokes[0], 0), name)
        return actions

    def text(self, text: str) -> list[int]:
        """Return the steps that type a text, see `spots_device.keys.layout`.

        SettingError if the host cannot type a character.
        """
        text = self._composed(text)
        strokes = (stroke for character in text for stroke in self._strokes(character))
        return [stroke.modifiers << 8 | stroke.usage for stroke in strokes]

    def macro(self, parts: list[str]) -> list[int]:
        """Return the steps of a macro.

        Its parts are keys, characters, ``text TEXT``, ``wait MS``, ``press KEY`` and ``release
        KEY``. SettingError if a part is something else.
        """
        down: list[int] = []  # usages of `press`
        steps: list[int] = []
        for part in parts:
            verb, space, remainder = part.partition(" ")
            if verb == "text" and space:
                steps += self.text(remainder)
            elif verb == "wait":
                steps += _wait(remainder)
            elif verb in _KEPT and space:
                steps += self._kept(verb, remainder, down)
            else:
                for action in self.actions(part):
                    steps += _steps(action)
        return steps

    def _kept(self, verb: str, name: str, down: list[int]) -> list[int]:
        actions = self.actions(name)
        page, bits, usage = actions[0] >> 20, actions[0] >> 12 & 0xFF, actions[0] & 0xFFF
        if len(actions) > 1 or page != KEYBOARD:
            raise SettingError(
                f"'{verb} {name}' needs one key of the keyboard: name another, or write '{name}'"
            )
        usages = [MODIFIERS_FROM + bit for bit in range(8) if bits >> bit & 1] + [usage]
        for one in usages:
            if (one in down) == (verb == "press"):
                raise SettingError(
                    f"'{verb} {name}': the key is {'' if one in down else 'not '}down already: "
                    "write 'press' and 'release' of a key in turns"
                )
            down.append(one) if verb == "press" else down.remove(one)
        if len(down) > KEYS_MAX - 1:
            raise SettingError(f"'{verb} {name}': at most {KEYS_MAX - 1} keys are down at once")
        return [one << 8 | _KEPT[verb] for one in (usages if verb == "press" else usages[::-1])]

    def caps_word(self) -> list[int]:
        """Return the integers of a caps word, see `spots_device.keys.caps`."""
        host = self.host or hosts.host_of(hosts.AMERICAN)
        found = [0] * lines_of.CAPS_SIZE
        for i, usage in enumerate(_CAPS_KEYS):
            for level, modifiers in enumerate(hosts.LEVELS):
                what = _in_word(host, hosts.Stroke(modifiers, usage))
                found[i // 3] |= what << 8 * (i % 3) + 2 * level
        return found

    def _bits(self, modifiers: list[str]) -> int:
        bits = 0
        named = []
        for name in modifiers:
            by_system = _BY_SYSTEM.get(name.upper())
            if by_system is None:
                named.append(name)
            elif self._system is None:
                raise SettingError(
                    f"'{name}' depends on the computer: add os = 'linux', 'windows' or 'mac' to "
                    "the file, before its first table"
                )
            else:
                bits |= by_system[self._system]
        return bits | modifier_bits(named)

    def _composed(self, text: str) -> str:
        # In the form NFC, unless the host types the text as it is.
        types = self.host.strokes if self.host else str.isascii
        return text if all(map(types, text)) else normalize("NFC", text)

    def _strokes(self, character: str) -> tuple[hosts.Stroke, ...]:
        host = self.host
        if host is None:
            raise SettingError(
                f"the character '{character}' needs the keyboard layout of your computer, "
                f"{hosts.typing(character)}: add its host, such as host = "
                f"'{hosts.first(character)}', to the file, before its first table"
            )
        strokes = host.strokes(character)
        if strokes:
            return strokes
        having = [
            system
            for system in (hosts.LINUX, hosts.WINDOWS)
            if self._system is None and hosts.host_of(host.name, system).strokes(character)
        ]
        if len(having) == 1:
            raise SettingError(
                f"the host '{host.name}' has '{character}' only on {having[0].title()}: add os = "
                f"'{having[0]}' to the file, before its first table, or leave it out"
            )
        if having:
            raise SettingError(
                f"the host '{host.name}' has '{character}' on other keys on Windows than on Linux: "
                "add os = 'windows' or 'linux' to the file, before its first table"
            )
        system = self._system or hosts.BOTH
        on = f" on {system}" if self._system else ""
        raise SettingError(
            f"the host '{host.name}'{on} cannot type '{character}', "
            f"{hosts.typing(character, system)}: use another character or host"
        )


def _in_word(host: hosts.Host, stroke: hosts.Stroke) -> int:
    # Returns what caps word does with a key: 0 ends it, 1 leaves the key as it is, 2 adds shift.
    text = host.typed(stroke)
    capital = host.typed(stroke._replace(modifiers=stroke.modifiers | hosts.SHIFT))
    # Of a dotted i, the capital is one character only in Turkish.
    if (
        text.islower()
        and len(text) == 1
        and (text.upper() == capital or capital.lower()[:1] == text)
    ):
        return 2
    return int(len(text) > 1 or text.isalpha() or text.isdecimal() or text == "_")


def _is_key(name: str) -> bool:
    try:
        usage_of(name)
    except SpotsError:
        return False
    return True


def _action(stroke: hosts.Stroke, bits: int) -> int:
    return lines_of.action(KEYBOARD, stroke.usage, stroke.modifiers | bits)


def _steps(action: int) -> list[int]:
    page, bits, usage = action >> 20, action >> 12 & 0xFF, action & 0xFFF
    if page == KEYBOARD:
        return [bits << 8 | usage]
    assert page == CONSUMER
    step = (usage & 0xFF) << 8 | lines_of.MEDIA_FROM + (usage >> 8)
    return [bits << 8 | lines_of.NEXT_BITS, step] if bits else [step]


def _wait(text: str) -> list[int]:
    if not text.isdecimal() or not 0 < int(text) <= _WAIT_MAX_MS:
        raise SettingError(f"'wait {text}': write 'wait MS', from 1 to {_WAIT_MAX_MS}")
    units = -(-int(text) // _WAIT_UNIT_MS)
    whole, remainder = divmod(units, _UNITS_MAX)
    return [_UNITS_MAX << 8] * whole + ([remainder << 8] if remainder else [])
