"""Validates the tables ``[device]`` and ``[[strips]]`` of a board file before a board gets them."""

from typing import Annotated, Literal, Union

import msgspec

from spots_device.sensor.exposure import LED_MAX_MA, LED_MIN_MA

from ..common import schema, toml

_Number = Annotated[int, msgspec.Meta(ge=0, le=63)]  # no chip of the supported runtimes has more
_Name = Annotated[str, msgspec.Meta(min_length=1)]
_Pin = Union[_Number, _Name]
_PINS = "SCL_PIN", "SDA_PIN", "STRIP_LED_PIN", "LED_PIN", "SAFE_BOOT"


class _Config(toml.Strict, kw_only=True):
    """Names and values of board_config.py for one strip; docs/extend/new-board.md."""

    NAME: str = ""
    I2C_ID: Annotated[int, msgspec.Meta(ge=0, le=3)] | None = None
    SCL_PIN: _Pin
    SDA_PIN: _Pin
    I2C_HZ: Annotated[int, msgspec.Meta(ge=10_000, le=400_000)]  # AS7341: at most 400 kHz
    LED_MAX_MA: Annotated[int, msgspec.Meta(ge=LED_MIN_MA, le=LED_MAX_MA)]
    STRIP_LED: str = "ldr"
    STRIP_LED_PIN: _Pin | None = None
    USB_HID: bool
    BLUETOOTH: bool = False
    USB_HID_MAX: Annotated[int, msgspec.Meta(ge=1, le=8)] | None = None
    LED_PIN: _Pin | None = None
    LED_ON: Literal[0, 1] | None = None
    SAFE_BOOT: _Pin | None = None
    MUX_CHANNEL: Annotated[int, msgspec.Meta(ge=0, le=7)] | None = None


def check(values: dict, runtime: str) -> None:
    """Validate the configuration of a strip: ``[device]``, with the values of the strip.

    msgspec.ValidationError if a key is unknown or missing, or a board could not use its value.
    """
    config = schema.convert(values, _Config)
    pins = {name: pin for name in _PINS if (pin := getattr(config, name)) is not None}
    for name, pin in pins.items():
        same = next(other for other in pins if pins[other] == pin)
        if same != name:
            raise msgspec.ValidationError(f"{same} and {name} are both {pin!r}: name two pins")
    if (config.LED_PIN is None) != (config.LED_ON is None):
        raise msgspec.ValidationError("LED_PIN and LED_ON belong together: give both or none")
    if runtime == "circuitpython":
        if numbers := [name for name, pin in pins.items() if isinstance(pin, int)]:
            raise msgspec.ValidationError(
                f'{numbers[0]} must be a name in CircuitPython\'s module board, such as "D5"'
            )
        return
    if config.I2C_ID is None:
        raise msgspec.ValidationError("the key 'I2C_ID' is missing: add it")
    if isinstance(config.SAFE_BOOT, str) and config.SAFE_BOOT != "BOOTSEL":
        raise msgspec.ValidationError(
            f"SAFE_BOOT must be the number of a pin or \"BOOTSEL\", not '{config.SAFE_BOOT}'"
        )
