"""The table of key names and HID usages, compared with the tables of other projects."""

import runpy
from importlib.util import find_spec
from pathlib import Path

import pytest
from support.refusals import refusal

from spots import SpotsError
from spots.errors import SettingError
from spots.outputs.usages import (
    ALIASES,
    CONSUMER,
    KEYBOARD,
    USAGES,
    chord_of,
    name_of,
    usage_of,
)


def test_every_key_is_found_by_its_name_in_any_case():
    for (page, usage), one in USAGES.items():
        assert usage_of(one.name) == usage_of(one.name.lower()) == (page, usage)
        assert name_of(page, usage) == one.name
        assert one.name.isidentifier()
    assert len({one.name for one in USAGES.values()}) == len(USAGES)


def test_the_keyboard_is_complete():
    there = {usage for page, usage in USAGES if page == KEYBOARD}
    assert there >= {*range(0x04, 0x66), *range(0xE0, 0xE8)}


def adafruit(module, table):
    # Executed by its path, because an import of the package needs CircuitPython's usb_hid.
    path = Path(find_spec("adafruit_hid").origin).with_name(module)
    return {k: v for k, v in vars(runpy.run_path(str(path))[table]).items() if k.isupper()}


def test_names_that_adafruit_has_too_mean_the_same():
    theirs = {name: (KEYBOARD, code) for name, code in adafruit("keycode.py", "Keycode").items()}
    for name, code in adafruit("consumer_control_code.py", "ConsumerControlCode").items():
        theirs[name] = (CONSUMER, code)
    both = theirs.keys() & {one.name for one in USAGES.values()}
    assert len(both) >= 100
    for name in theirs:  # those that are other names here, too
        assert usage_of(name) == theirs[name], name


def test_linux_has_a_code_for_every_key():
    ecodes = pytest.importorskip("evdev", reason="evdev is for Linux").ecodes
    for one in USAGES.values():
        assert one.linux in ecodes.ecodes, one


def test_what_a_key_types_is_a_name_of_it():
    assert usage_of("a") == usage_of("A") == (KEYBOARD, 0x04)
    assert usage_of("1") == usage_of("ONE")
    assert usage_of("/") == usage_of("FORWARD_SLASH")
    assert usage_of("-") == usage_of("MINUS")


def test_a_key_that_is_none_is_one_sentence_with_its_neighbours():
    with refusal(SettingError):
        usage_of("VOLUM_UP")
    with refusal(SettingError):
        usage_of("qqqq")
    with pytest.raises(SpotsError):
        usage_of("")
    with refusal(SettingError):
        usage_of(55)
    assert usage_of(5) == usage_of("5")


def test_a_key_without_a_name_is_its_numbers():
    assert name_of(KEYBOARD, 0xA5) == "usage 7:0xA5"
    assert usage_of("usage 7:0xA5") == usage_of("USAGE 7:165") == (KEYBOARD, 0xA5)
    assert chord_of("LEFT_SHIFT+usage 12:0x6F") == (CONSUMER, 0x6F, 2)
    for wrong in ("usage 7:0", "usage 7:0xDE", "usage 12:0x400", "usage 1:0x81", "usage 7:0xA5B"):
        with refusal(SettingError):
            usage_of(wrong)


# What people write, in QMK, ZMK, KMK, Ducky Script and on keycaps, and the keys that they mean.
WRITTEN = """
CTRL LEFT_CONTROL | CONTROL LEFT_CONTROL | LCTL LEFT_CONTROL | RCTRL RIGHT_CONTROL
SHIFT LEFT_SHIFT | LSFT LEFT_SHIFT | ALT LEFT_ALT | OPTION LEFT_ALT | ALTGR RIGHT_ALT
RALT RIGHT_ALT | GUI LEFT_GUI | CMD LEFT_GUI | COMMAND LEFT_GUI | WIN LEFT_GUI
WINDOWS LEFT_GUI | SUPER LEFT_GUI | META LEFT_GUI | RGUI RIGHT_GUI
DEL DELETE | INS INSERT | ESC ESCAPE | RETURN ENTER | RET ENTER | ENT ENTER
BSPC BACKSPACE | BKSP BACKSPACE | SPACE SPACEBAR | SPC SPACEBAR
PGUP PAGE_UP | PGDN PAGE_DOWN | PG_UP PAGE_UP | PAGEDOWN PAGE_DOWN
UP UP_ARROW | DOWN DOWN_ARROW | LEFT LEFT_ARROW | RGHT RIGHT_ARROW | UPARROW UP_ARROW
CAPS CAPS_LOCK | CAPSLOCK CAPS_LOCK | NUMLOCK KEYPAD_NUM_LOCK | SCROLLLOCK SCROLL_LOCK
PSCR PRINT_SCREEN | PRTSC PRINT_SCREEN | PRINTSCREEN PRINT_SCREEN | BREAK PAUSE
KP_0 KEYPAD_ZERO | KP_N1 KEYPAD_ONE | KP_PLUS KEYPAD_PLUS | KP_ENTER KEYPAD_ENTER
KP_DOT KEYPAD_PERIOD | KP_ASTERISK KEYPAD_ASTERISK | KP_SLASH KEYPAD_FORWARD_SLASH
MINS MINUS | EQL EQUALS | LBRC LEFT_BRACKET | RBKT RIGHT_BRACKET | BSLS BACKSLASH
SCLN SEMICOLON | SEMI SEMICOLON | QUOT APOSTROPHE | QUOTE APOSTROPHE | GRV GRAVE_ACCENT
GRAVE GRAVE_ACCENT | COMM COMMA | DOT PERIOD | SLSH FORWARD_SLASH | SLASH FORWARD_SLASH
NUHS NON_US_HASH | NUBS NON_US_BACKSLASH | MENU APPLICATION | APP APPLICATION
N1 ONE | NUMBER_0 ZERO | INT1 INTERNATIONAL1 | JYEN INTERNATIONAL3 | LANG_HANGEUL LANG1
VOLU VOLUME_INCREMENT | VOLD VOLUME_DECREMENT | VOL_UP VOLUME_INCREMENT
VOLUME_DOWN VOLUME_DECREMENT | C_MUTE MUTE | MPLY PLAY_PAUSE | C_PP PLAY_PAUSE
MNXT SCAN_NEXT_TRACK | C_PREV SCAN_PREVIOUS_TRACK | BRIU DISPLAY_BRIGHTNESS_INCREMENT
KC_BSPC BACKSPACE | KC_1 ONE | KEY_VOLUMEUP VOLUME_INCREMENT | KEY_LEFTMETA LEFT_GUI
"""
PAIRS = [pair.split() for line in WRITTEN.splitlines() for pair in line.split("|") if pair]


@pytest.mark.parametrize(("written", "name"), PAIRS)
def test_names_that_people_write_are_accepted(written, name):
    assert name_of(*usage_of(written)) == name_of(*usage_of(written.lower())) == name


def test_names_are_not_given_twice():
    every = [*ALIASES, *(one for aliases in ALIASES.values() for one in aliases)]
    assert len(set(every)) == len(every)
    assert ALIASES.keys() <= {one.name for one in USAGES.values()}
    assert len(PAIRS) >= 90


@pytest.mark.parametrize(
    "name", ["SLEEP", "WAKE", "RESET", "HYPER", "MEH", "LOWER", "FN", "MS_UP", "BTN1", "NO", "TRNS"]
)
def test_what_is_a_key_elsewhere_is_not_answered_with_another_key(name):
    with refusal(SettingError):
        usage_of(name)
