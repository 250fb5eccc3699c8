"""The table of key names and HID usages, compared with the tables of other projects."""

import runpy
from importlib.util import find_spec
from pathlib import Path

import pytest

from spots import SpotsError
from spots.outputs.usages import CONSUMER, KEYBOARD, USAGES, name_of, usage_of


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
    for name in both:
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
    with pytest.raises(SpotsError, match=r"no key 'VOLUME_UP'.*VOLUME_INCREMENT"):
        usage_of("VOLUME_UP")
    with pytest.raises(SpotsError, match="no key 'qqqq'"):
        usage_of("qqqq")
    with pytest.raises(SpotsError):
        usage_of("")


def test_a_key_without_a_name_is_its_numbers():
    assert name_of(KEYBOARD, 0xA5) == "0x07:0xa5"
