"""File names of version 0.1.0, the only one that left no manifest on its boards.

Data, and never changed: the files of this version are those of `staging.names`.
"""

_MODULES = (
    "__init__",
    "app",
    "as7341",
    "calibration",
    "command",
    "contact",
    "decode",
    "exposure",
    "frame",
    "gamepad",
    "hid",
    "kernel",
    "kernel_viper",
    "keypad",
    "layout",
    "log2",
    "pacing",
    "settings",
    "smux",
    "strip",
    "upload",
    "uses",
    "runtime/__init__",
    "runtime/circuitpython",
    "runtime/micropython",
    "runtime/stay",
    "runtime/usb_circuitpython",
    "runtime/usb_micropython",
)
# Compiled by `spots flash`, in sources by mpremote's `mip`.
_FIRMWARE = [f"tactile/{module}{end}" for module in _MODULES for end in (".py", ".mpy")]
_LIBRARIES = (
    "adafruit_as7341",
    "adafruit_bus_device/__init__",
    "adafruit_bus_device/i2c_device",
    "adafruit_bus_device/spi_device",
    "adafruit_register/__init__",
    "adafruit_register/i2c_bcd_alarm",
    "adafruit_register/i2c_bcd_datetime",
    "adafruit_register/i2c_bit",
    "adafruit_register/i2c_bits",
    "adafruit_register/i2c_struct",
    "adafruit_register/i2c_struct_array",
    "adafruit_register/register_accessor",
    "adafruit_register/register_bit",
    "adafruit_register/register_bits",
    "adafruit_register/register_struct",
)

FILES = {
    "micropython": {"main.py", "board_config.py", *_FIRMWARE},
    "circuitpython": {
        "boot.py",
        "code.py",
        "board_config.py",
        *_FIRMWARE,
        *(f"lib/{module}.py" for module in _LIBRARIES),
    },
}
