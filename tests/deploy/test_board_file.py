"""A board file with a wrong value is refused before anything is built from it."""

import re

import pytest
from support.refusals import refusal

from spots.deploy import staging
from spots.errors import FileError

BEFORE = """title = "Odd"
runtime = "micropython"
march = "armv6m"

[device]
I2C_ID = 0
SCL_PIN = 5
SDA_PIN = 4
I2C_HZ = 400_000
LED_MAX_MA = 100
STRIP_LED_PIN = 6
USB_HID = true
LED_PIN = "LED"
LED_ON = 1
SAFE_BOOT = "BOOTSEL"
"""


def device(folder, monkeypatch, text):
    (folder / "odd").mkdir()
    (folder / "odd" / "board.toml").write_text(text)
    monkeypatch.setattr(staging, "BOARDS", folder)
    return staging.device_of("odd")


def test_a_right_board_file_is_taken(tmp_path, monkeypatch):
    assert device(tmp_path, monkeypatch, BEFORE).device["SCL_PIN"] == 5


@pytest.mark.parametrize(
    ("key", "line", "says"),
    [
        ("SCL_PIN", "SLC_PIN = 5", "unknown key 'SLC_PIN': did you mean SCL_PIN"),
        ("SCL_PIN", "", "the key 'SCL_PIN' is missing: add it"),
        ("SCL_PIN", "SCL_PIN = 4", "SCL_PIN and SDA_PIN are both 4: name two pins"),
        ("SCL_PIN", "SCL_PIN = 6", "SCL_PIN and STRIP_LED_PIN are both 6: name two pins"),
        ("SDA_PIN", "SDA_PIN = 400", "SDA_PIN must be a whole number of at most 63"),
        ("SDA_PIN", "SDA_PIN = -1", "SDA_PIN must be a whole number of at least 0"),
        ("I2C_HZ", "I2C_HZ = -1", "I2C_HZ must be a whole number of at least 10000"),
        ("I2C_HZ", "I2C_HZ = 1_000_000", "I2C_HZ must be a whole number of at most 400000"),
        ("I2C_ID", "", "the key 'I2C_ID' is missing: add it"),
        ("LED_MAX_MA", "LED_MAX_MA = 9999", "LED_MAX_MA must be a whole number of at most 258"),
        ("LED_MAX_MA", "LED_MAX_MA = 0", "LED_MAX_MA must be a whole number of at least 4"),
        ("USB_HID", "USB_HID = 1", "USB_HID must be true or false"),
        ("LED_ON", "LED_ON = 2", "LED_ON"),
        ("LED_ON", "", "LED_PIN and LED_ON belong together: give both or none"),
        ("SAFE_BOOT", 'SAFE_BOOT = "X"', 'SAFE_BOOT must be the number of a pin or "BOOTSEL"'),
        ("SAFE_BOOT", "SAFE_BOOT = 5", "SCL_PIN and SAFE_BOOT are both 5: name two pins"),
        ("march", 'march = "armv9"', "march cannot be 'armv9': did you mean armv"),
        ("march", 'march = "z80"', "march cannot be 'z80': valid names are x86, x64"),
        ("runtime", 'runtime = "circuitpython"', "must be a name in CircuitPython's module board"),
        ("SAFE_BOOT", "[[strips]]\nSCL_PIN = 4", "SCL_PIN and SDA_PIN are both 4: name two pins"),
        ("SAFE_BOOT", "[[strips]]\nMUX_CHANNEL = 8", "MUX_CHANNEL must be a whole number of at"),
    ],
)
def test_a_wrong_value_of_a_board_file_is_named(key, line, says, tmp_path, monkeypatch):
    text = re.sub(rf"^{key} = .*$", line, BEFORE, flags=re.MULTILINE)
    assert text != BEFORE
    with refusal(FileError, file="board.toml") as error:
        device(tmp_path, monkeypatch, text)
    assert says in str(error.value)
