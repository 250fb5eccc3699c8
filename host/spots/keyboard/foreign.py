"""The notations of QMK and ZMK for what is an action here: ``MO(1)``, ``&mt LCTRL A``, ``HYPR``."""

import re
from typing import NamedTuple

from ..errors import SettingError

PAGE = "docs/type/coming-from.md"
_ALL_FOUR = "LEFT_CONTROL+LEFT_SHIFT+LEFT_ALT+LEFT_GUI"
_MEH = "LEFT_CONTROL+LEFT_SHIFT+LEFT_ALT"
_SIDES = {"L": "LEFT_", "R": "RIGHT_"}
_MODIFIERS = {
    **{f"{side}{short}": f"{_SIDES[side]}{name}"
       for side in _SIDES
       for name, shorts in {
           "CONTROL": ("CTL", "C", "CTRL"), "SHIFT": ("SFT", "S", "SHFT"),
           "ALT": ("ALT", "A"), "GUI": ("GUI", "G", "CMD", "WIN"),
       }.items()
       for short in shorts},
    "C": "LEFT_CONTROL", "S": "LEFT_SHIFT", "A": "LEFT_ALT", "G": "LEFT_GUI",
    "HYPR": _ALL_FOUR, "HYPER": _ALL_FOUR, "MEH": _MEH, "ALGR": "RIGHT_ALT",
    "LCA": "LEFT_CONTROL+LEFT_ALT", "LSA": "LEFT_SHIFT+LEFT_ALT", "LCS": "LEFT_CONTROL+LEFT_SHIFT",
    "C_S": "LEFT_CONTROL+LEFT_SHIFT", "LSG": "LEFT_SHIFT+LEFT_GUI", "SGUI": "LEFT_SHIFT+LEFT_GUI",
    "LAG": "LEFT_ALT+LEFT_GUI", "LCAG": "LEFT_CONTROL+LEFT_ALT+LEFT_GUI",
}  # fmt: skip
# Characters of American keyboards by names of QMK and ZMK.
_SHIFTED = {
    name: f"LEFT_SHIFT+{key}"
    for key, names in {
        "1": "EXLM EXCL", "2": "AT", "3": "HASH", "4": "DLR DLLR", "5": "PERC PRCNT",
        "6": "CIRC CARET", "7": "AMPR AMPS", "8": "ASTR ASTRK STAR", "9": "LPRN LPAR",
        "0": "RPRN RPAR",
        "-": "UNDS UNDER", "=": "PLUS", "[": "LCBR", "]": "RCBR", "\\": "PIPE",
        ";": "COLN COLON", "'": "DQUO DQT DOUBLE_QUOTES", ",": "LABK LT", ".": "RABK GT",
        "/": "QUES QMARK", "`": "TILD TILDE",
    }.items()
    for name in names.split()
}  # fmt: skip
_LAYERS = {"MO": "momentary", "TG": "toggle", "TO": "to", "OSL": "sticky", "TOG": "toggle",
           "SL": "sticky"}  # fmt: skip
_WORDS = {"CW_TOGG": "caps_word", "CAPS_WORD": "caps_word", "QK_REP": "key_repeat",
          "QK_REPEAT_KEY": "key_repeat", "KEY_REPEAT": "key_repeat"}  # fmt: skip
_NOTHING = ("NO", "XXXXXXX", "NONE")
_BUTTONS = {"LCLK": "MOUSE_LEFT", "RCLK": "MOUSE_RIGHT", "MCLK": "MOUSE_MIDDLE",
            "MB1": "MOUSE_LEFT", "MB2": "MOUSE_RIGHT", "MB3": "MOUSE_MIDDLE"}  # fmt: skip
# What has no meaning here, or another one.
_ABSENT = ("TRNS", "_______", "TRANS", "TRANSPARENT", "FN", "GLOBE", "LOWER", "RAISE", "LEAD",
           "LEADER", "QK_BOOT", "RESET", "REBOOT", "BOOTLOADER", "SYS_RESET")  # fmt: skip
_CALL = re.compile(r"(\w+)\((.*)\)")


class Foreign(NamedTuple):
    """Actions in the notation of layout files; `hold` is empty but for a hold-tap."""

    tap: str
    hold: str = ""


def translated(text: str, layers: list[str]) -> Foreign | None:
    """Return what a text of QMK or ZMK means; None if it is none.

    `layers` has the names of the layers, which QMK and ZMK number. SettingError if it has no
    meaning here, with the page that shows what to write.
    """
    if text.startswith("&"):
        name, *rest = text[1:].split()
        return _behaviour(text, name.upper(), rest, layers)
    call = _CALL.fullmatch(text)
    if call:
        rest = _split(call[2])
        return _behaviour(text, call[1].upper(), rest, layers)
    name = text.upper().removeprefix("KC_")
    is_kc = name != text.upper()
    if name in _NOTHING and (is_kc or name == "XXXXXXX"):
        return Foreign("")
    if name in ("HYPR", "HYPER", "MEH"):
        return Foreign(_MODIFIERS[name])
    if name in _SHIFTED:
        return Foreign(_SHIFTED[name])
    if text in _WORDS and text not in _WORDS.values():
        return Foreign(_WORDS[text])
    if name in _ABSENT or name in _NOTHING:
        raise _none(text)
    return None


def _behaviour(text: str, name: str, rest: list[str], layers: list[str]) -> Foreign:
    many = len(rest)
    if name in ("NONE",) and not many:
        return Foreign("")
    if name in _WORDS and not many:
        return Foreign(_WORDS[name])
    if name == "KP" and many == 1:
        return Foreign(_key(rest[0], layers))
    if name == "MKP" and many == 1 and rest[0].upper() in _BUTTONS:
        return Foreign(_BUTTONS[rest[0].upper()])
    if name in _LAYERS and many == 1:
        return Foreign(_layer(text, _LAYERS[name], rest[0], layers))
    if name in ("OSM", "SK") and many == 1:
        return Foreign(f"sticky {_modifiers(text, rest[0])}")
    if name == "LT" and many == 2:
        return Foreign(_key(rest[1], layers), _layer(text, "momentary", rest[0], layers))
    if name == "MT" and many == 2:
        return Foreign(_key(rest[1], layers), _modifiers(text, rest[0]))
    if name in _MODIFIERS and many == 1:
        return Foreign(f"{_MODIFIERS[name]}+{_key(rest[0], layers)}")
    if name.endswith("_T") and name[:-2] in _MODIFIERS and many == 1:
        return Foreign(_key(rest[0], layers), _MODIFIERS[name[:-2]])
    raise _none(text)


def _key(text: str, layers: list[str]) -> str:
    found = translated(text, layers)
    if found is None:
        return text
    if found.hold:
        raise _none(text)
    return found.tap


def _layer(text: str, verb: str, number: str, layers: list[str]) -> str:
    name = number
    if number.isdecimal():
        if int(number) >= len(layers):
            raise SettingError(
                f"'{text}' names layer {number}, and the layers are 0 to {len(layers) - 1}: "
                f"write '{verb} NAME' with the name of a layer"
            )
        name = layers[int(number)]
    return f"{verb} {name}"


def _modifiers(text: str, words: str) -> str:
    names = [one.strip().upper().removeprefix("MOD_") for one in words.split("|")]
    names = [_MODIFIERS.get(one, one) for one in names]
    if not all(one in _MODIFIERS.values() for one in names):
        raise _none(text)
    return "+".join(names)


def _split(text: str) -> list[str]:
    # Splits at the commas that are in no parentheses.
    parts, depth = [""], 0
    for one in text:
        depth += (one == "(") - (one == ")")
        if one == "," and not depth:
            parts.append("")
        else:
            parts[-1] += one
    return [part.strip() for part in parts]


def _none(text: str) -> SettingError:
    return SettingError(f"'{text}' has no meaning here: {PAGE} shows what to write for it")
