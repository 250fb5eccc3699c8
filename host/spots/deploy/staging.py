"""Collects the files of a board in a folder with the structure of the board's file system."""

import importlib.util
import shutil
from importlib import resources
from pathlib import Path
from typing import Literal

import msgspec

import spots_device
from spots_device.board.light import LEDS

from ..common import toml
from ..common.bounded import read_text
from ..errors import FileError, SettingError, did_you_mean, missing
from .board_config import check

# An installed package contains the folders boards and firmware; a checkout has them at its top.
_PACKAGED = Path(str(resources.files("spots"))) / "_device"
_FIRMWARE = Path(spots_device.__file__).resolve().parent
_CHECKOUT = _FIRMWARE.parents[1]
_ROOT = _PACKAGED if _PACKAGED.is_dir() else _CHECKOUT
BOARDS = _ROOT / "boards"

# The files that a runtime runs at its start, in this order; the last one runs the application.
ENTRIES = {"micropython": ("main.py",), "circuitpython": ("boot.py", "code.py")}
CONFIG = "board_config.py"
# code.py has a folder of its own: the folder `firmware` is on the path of the host's Python, where
# code.py would hide the standard module `code`.
_ENTRY_FOLDERS = {"micropython": "firmware", "circuitpython": "firmware/circuitpython"}
# Libraries that a runtime needs in `lib`, copied from the packages of the host's Python.
LIBRARIES = {
    "micropython": (),
    "circuitpython": ("adafruit_as7341", "adafruit_bus_device", "adafruit_register"),
}

# Modules for several strips, and modules for strips behind a multiplexer of the I2C bus. They are
# copied only to boards that use them.
_SEVERAL, _MULTIPLEXER = ("aligned.py",), "multiplexer*.py"
STRIPS_MAX = 4

# A module with this suffix contains the same functions as the module without the suffix, but
# MicroPython's viper compiles them to machine code. A board gets one of the two modules, under the
# name without the suffix.
VIPER = "_viper"
_RADIO = "radio"  # room of the firmware that needs a runtime with bonding


# Architectures by their number in the header of an .mpy file (MicroPython, py/persistentcode.h).
# Number 0 is bytecode, which runs on every chip.
ARCHITECTURES = (
    None, "x86", "x64", "armv6", "armv6m", "armv7m", "armv7em", "armv7emsp", "armv7emdp",
    "xtensa", "xtensawin", "rv32imc", "rv64imc",
)  # fmt: skip


class Device(toml.Strict, kw_only=True):
    """Content of a board file (board.toml), which describes a kind of board.

    - `port`: port of a board that is not on USB, such as ``virtual``.
    - `march`: architecture for ``mpy-cross -march``; None for bytecode only, and for CircuitPython.
    - `viper`: whether MicroPython's viper compiles the firmware's modules `burst`, `kernel`,
      `locate` and `sticking` to machine code; requires `march`.
    - `board_id`: CircuitPython's ID of the board, in boot_out.txt; None for MicroPython.
    - `download`: name of MicroPython's build for the board, as in
      micropython.org/download/RPI_PICO; None for CircuitPython and virtual boards.
    - `device`: names and values for board_config.py, including the board's ``NAME``.
    - `strips`: for each strip that the board has pins for, from sensor 0 on, the values that differ
      from those of `device`.
    - `wiring`: pin of each wire, as printed on the board; only for documents.
    """

    title: str
    runtime: Literal["micropython", "circuitpython"]
    port: str | None = None
    march: str | None = None
    viper: bool = False
    board_id: str | None = None
    download: str | None = None
    device: dict
    strips: tuple[dict, ...] = ({},)
    wiring: dict = {}

    def __post_init__(self):
        if self.viper and (self.runtime != "micropython" or self.march is None):
            raise ValueError("viper needs runtime = micropython, and the key march: add them")
        if self.march not in ARCHITECTURES:
            known = [one for one in ARCHITECTURES if one]
            raise ValueError(f"march cannot be '{self.march}': {did_you_mean(self.march, known)}")
        if not 1 <= len(self.strips) <= STRIPS_MAX:
            raise ValueError(
                f"write 1 to {STRIPS_MAX} [[strips]] tables, or leave them out for a board with "
                "one strip"
            )
        led = self.device.get("STRIP_LED", "ldr")
        if led not in LEDS or (led == "gpio" and "STRIP_LED_PIN" not in self.device):
            raise ValueError(
                f"STRIP_LED must be one of {', '.join(LEDS)}; gpio needs a STRIP_LED_PIN"
            )

    @property
    def name(self) -> str:
        """Name of the board in commands such as ``spots flash pico``."""
        return self.device["NAME"]


def board_names() -> list[str]:
    """Return the names of the boards that SPOTS has files for."""
    return sorted(path.parent.name for path in BOARDS.glob("*/board.toml"))


def device_of(board: str, strips: int = 1) -> Device:
    """Read the board file of a board that ``spots boards`` lists.

    For more than one strip, the dict `Device.device` has the key ``SENSORS``, with a list of one
    dict for each strip: the strip's pins and other configuration, by name. SettingError or
    FileError if the board is unknown or has no pins for this number of strips, or its board file is
    invalid.
    """
    known = board_names()
    if board not in known:
        raise SettingError(f"no board is called {board}: {did_you_mean(board, known)}")
    path = BOARDS / board / "board.toml"
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError):
        raise FileError(f"cannot read {path}: install spots again", path) from None
    found = toml.checked(text, Device, "board", path)
    try:
        for own in found.strips:
            check(found.device | own, found.runtime)
    except msgspec.ValidationError as error:
        raise FileError(
            f"board file {path}, table [device] or [[strips]]: {error}", path, "device"
        ) from None
    most = len(found.strips)
    if not 1 <= strips <= most:
        raise SettingError(f"{board} can have 1 to {most} strips, not {strips}: change --strips")
    several = [found.device | own for own in found.strips[:strips]]
    values = {"NAME": board} | found.device | ({"SENSORS": several} if strips > 1 else {})
    return msgspec.structs.replace(found, device=values)


def names(runtime: str) -> set[str]:
    """Return the paths of this version's files on a board, both as sources and compiled.

    The paths identify the firmware on a board without a manifest. Such a board got its files by
    MicroPython's ``mip``, or a person copied them.
    """
    modules = [path.relative_to(_FIRMWARE.parent) for path in _FIRMWARE.rglob("*.py")]
    forms = {path.with_suffix(end).as_posix() for path in modules for end in (".py", ".mpy")}
    return {*ENTRIES[runtime], CONFIG, *forms}


def stage(device: Device, folder: Path) -> None:
    """Copy a board's firmware, libraries and board_config.py as sources into an empty folder.

    RequirementError if a library is not installed on this computer.
    """
    sensors = device.device.get("SENSORS", ())
    for library in LIBRARIES[device.runtime]:
        _copy_library(library, folder / "lib")
    (others,) = set(ENTRIES) - {device.runtime}
    shutil.copytree(
        _FIRMWARE,
        folder / "spots_device",
        ignore=shutil.ignore_patterns(
            "__pycache__",
            f"*{others}.py",
            *([] if device.viper else [f"*{VIPER}.py"]),
            *([] if sensors else _SEVERAL),
            *([] if device.device.get("BLUETOOTH") else [_RADIO]),
            *([] if any("MUX_CHANNEL" in one for one in sensors) else [_MULTIPLEXER]),
        ),
        dirs_exist_ok=True,
    )
    use_viper(folder / "spots_device")
    for entry in ENTRIES[device.runtime]:
        shutil.copy(_ROOT / _ENTRY_FOLDERS[device.runtime] / entry, folder)
    config = "".join(f"{name} = {value!r}\n" for name, value in device.device.items())
    (folder / CONFIG).write_text(config, encoding="utf-8")


def use_viper(package: Path) -> None:
    """Replace modules in a copy of the firmware's package by their ``_viper`` versions."""
    for path in package.rglob(f"*{VIPER}.py"):
        path.replace(path.with_stem(path.stem.removesuffix(VIPER)))


def _copy_library(name: str, folder: Path) -> None:
    spec = importlib.util.find_spec(name)
    if spec is None:
        raise missing("a CircuitPython board needs", name, "flash")
    origin = Path(spec.origin)
    folder.mkdir(exist_ok=True)
    if spec.submodule_search_locations:
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(origin.parent, folder / name, ignore=ignored, dirs_exist_ok=True)
    else:
        shutil.copy(origin, folder)
