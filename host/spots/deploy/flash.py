"""Copies the firmware to a board; what is half-copied never starts."""

from __future__ import annotations

import hashlib
import sys
import tempfile
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from rich.progress import track

from spots_device import __version__

from ..errors import SpotsError, printable
from ..link.connect import open as open_board
from . import manifest
from .build import ARCHITECTURES, build, files_of, mpy_header
from .drive import Drive
from .manifest import MANIFEST
from .place import Place, place
from .prompt import Prompt
from .released import FILES
from .staging import ENTRIES, Device, device_of, names

# USB devices, and a clock of the RP2040 that counts finer than milliseconds, came with these.
_OLDEST = {"micropython": (1, 23), "circuitpython": (9, 1)}
_NAMES = {"micropython": "MicroPython", "circuitpython": "CircuitPython"}
_RETURN_S = 20.0
_POLL_S = 0.2
_PART = ".part"  # the end of a file's name while it is written
# What a user stored on the board; `flash` never touches files that are not the firmware's.
USER_FILES = tuple(
    name + end
    for name in ("settings.txt", "calibration.txt", "layout.txt")
    for end in ("", ".old", ".new")
)


@dataclass(frozen=True)
class Plan:
    """What has to be done to a board.

    Attributes
    ----------
    remove : list of str
        Files to remove, in this order; the entry first, if it is among them.
    copy : list of str
        Files to copy, in this order; the entry last.
    need : int
        Free bytes that this needs.
    claim : bytes
        The manifest during the copy: old and new files. So a later flash recognises what an
        interrupted one left.
    """

    remove: list[str]
    copy: list[str]
    need: int
    claim: bytes


def flash(board: str, port: str | None = None, dry_run: bool = False) -> None:
    """Copy the firmware to a board, start it, and check that it answers.

    Parameters
    ----------
    board : str
        A name that ``spots boards`` lists.
    port : str, optional
        A serial port, or the folder of a CircuitPython drive; found if not given.
    dry_run : bool
        Only print what would be copied and removed.

    Raises
    ------
    SpotsError
        If no board or more than one is found, it is the wrong one, it has no room, or it was
        disconnected; flashing again completes the copy.
    """
    device = device_of(board)
    with place(device, port) as there, tempfile.TemporaryDirectory() as folder:
        files = files_of(build(board, Path(folder)))
        with there.open() as target:
            refuse(target.facts, device, files, there.name)
            plan = make_plan(files, target, device.runtime)
            if dry_run:
                _show(plan, files, there.name)
                return
            carry_out(plan, files, target)
            _report_library(device, target)
            target.reset()
        _greet(there)


def refuse(facts: dict, device: Device, files: dict[str, bytes], port: str) -> None:
    """Check that a board can run the files that were built for it.

    Parameters
    ----------
    facts : dict
        Of the board, see `Prompt` and `Drive`.
    device : staging.Device
    files : dict of str to bytes
        By their path on the board.
    port : str
        Where the board is, for the sentence.

    Raises
    ------
    SpotsError
        If its runtime, version, chip or board is another one.
    """
    runs = f"the board on {port} runs {facts['runtime']}"
    if facts["runtime"] != device.runtime:
        raise SpotsError(f"{runs}, but {device.name} needs {device.runtime}: install that on it")
    oldest = _OLDEST[device.runtime]
    if facts["version"] < oldest:
        version, needed = ".".join(map(str, facts["version"])), ".".join(map(str, oldest))
        name = _NAMES[device.runtime]
        raise SpotsError(f"{runs} {version}: install {name} {needed} or newer on it")
    if device.runtime == "circuitpython":
        _check_same(port, device, facts["board_id"], device.board_id)
    else:
        _refuse_chip(facts, device, files, port)


def _check_same(port: str, device: Device, found: str, wanted: str) -> None:
    if found != wanted:
        raise SpotsError(
            f"the board on {port} is {found}, but {device.name} needs {wanted}: name the "
            "board that is plugged in"
        )


def _refuse_chip(facts: dict, device: Device, files: dict[str, bytes], port: str) -> None:
    runs = f"the board on {port} runs {facts['runtime']}"
    version, arch = facts["mpy"]
    for path, data in files.items():
        if not path.endswith(".mpy"):
            continue
        header = mpy_header(data)
        if header.version != version:
            raise SpotsError(
                f"{runs} that takes .mpy version {version}, and mpy-cross makes {header.version}: "
                "install the newest MicroPython on it"
            )
        if header.arch:
            _check_same(port, device, _arch(arch), _arch(header.arch))
    # Bytecode runs anywhere, but the pins would be another board's.
    if device.march and arch:
        _check_same(port, device, _arch(arch), device.march)


def make_plan(files: dict[str, bytes], target: Prompt | Drive, runtime: str) -> Plan:
    """Compare the files on a board with those it should have.

    Parameters
    ----------
    files : dict of str to bytes
        Those it should have, by their path on the board.
    target : Prompt or Drive
    runtime : str
        ``micropython`` or ``circuitpython``.

    Returns
    -------
    Plan
    """
    entry = ENTRIES[runtime][-1]
    known = Known(target, runtime, files)
    there = known.sizes
    copy = [
        path
        for path, data in files.items()
        if there.get(path) != len(data) or target.sha256(path) != hashlib.sha256(data).hexdigest()
    ]
    remove = [path for path in sorted(there) if path not in files and known.is_ours(path)]
    if not copy and not remove:
        return Plan([], [], 0, b"")
    claim = b""
    if MANIFEST in copy:
        claim = manifest.write(known.entries | manifest.read(files[MANIFEST]))
    # Without its entry file the board starts nothing until the copy is complete.
    if entry in there:
        remove.insert(0, entry)
    # Libraries first: the other modules need them.
    copy = sorted(
        {*copy, entry}, key=lambda path: (path == entry, path == MANIFEST, path[:4] != "lib/", path)
    )
    block = target.facts["block"] or 1
    taken = sum(_on_disk(len(files[path]), block) for path in copy)
    gone = sum(_on_disk(there[path], block) for path in {*remove, *copy} if path in there)
    # The old file is kept until the hash of the new one is verified.
    most = max(_on_disk(len(files[path]), block) for path in copy)
    most += _on_disk(len(claim), block)
    return Plan(remove, copy, max(taken - gone + most, most), claim)


class Known:
    """The files of the firmware on a board, separated from the user's by path and hash.

    Ours is each file that the manifest on the board lists with its hash. Of other files, ours are
    those of this version, and of version 0.1.0, which wrote no manifest.

    Parameters
    ----------
    target : Prompt or Drive
    runtime : str
    more : iterable of str
        Other paths to look for.

    Attributes
    ----------
    sizes : dict
        Bytes of those that exist, by path.
    entries : set of (str, str)
        Path and hash, from the manifest on the board.
    listed : set of str
        The paths in the manifest.
    claimed : bool
        Whether the board has our firmware, or a part of it.
    """

    def __init__(self, target: Prompt | Drive, runtime: str, more: Iterable[str] = ()):
        self._target = target
        self.entries = set()
        if MANIFEST in target.files([MANIFEST]):
            self.entries = manifest.read(target.read(MANIFEST, manifest.LARGEST_BYTES))
        self.listed = {path for path, _ in self.entries}
        self._names = {MANIFEST, *FILES[runtime], *names(runtime)}
        every = self._names | self.listed | set(more)
        self.sizes = target.files(sorted(every | {path + _PART for path in every}))
        # Other programs have a main.py or a lib, too. Without a manifest such a file counts as ours
        # only if files of our packages are there.
        in_packages = ("/" in path and not path.startswith("lib/") for path in self.sizes)
        self.claimed = bool(self.entries) or any(in_packages)

    def is_ours(self, path: str) -> bool:
        """Whether a file of `sizes` may be removed."""
        if path in self.listed:
            return (path, self._target.sha256(path)) in self.entries
        whole = path.removesuffix(_PART)
        if whole != path:  # what an interrupted copy leaves
            return whole in self._names or whole in self.listed
        return path == MANIFEST or (self.claimed and path in self._names)


def carry_out(plan: Plan, files: dict[str, bytes], target: Prompt | Drive) -> None:
    """Carry out a plan.

    Parameters
    ----------
    plan : Plan
    files : dict of str to bytes
        By their path on the board.
    target : Prompt or Drive

    Raises
    ------
    SpotsError
        If the board has no room for it; the board is then unchanged.
    """
    free = target.facts["free"]
    if free is not None and plan.need > free:
        raise SpotsError(
            f"the board on {target.port} has {free} bytes free and this takes {plan.need}: "
            "remove files of yours from it"
        )
    for path in plan.remove:
        target.remove(path)
    remove_folders(target, plan.remove)
    if plan.claim:
        target.write(MANIFEST, plan.claim)
    hidden = not sys.stdout.isatty()
    for path in track(plan.copy, "copying", disable=hidden, transient=True):
        target.write(path, files[path])
    print(f"{len(plan.copy)} files copied" if plan.copy else "nothing to copy")


def remove_folders(target: Prompt | Drive, removed: Iterable[str]) -> None:
    """Remove the folders of removed files, as far as nothing else is in them.

    Parameters
    ----------
    target : Prompt or Drive
        The board's file system.
    removed : iterable of str
        Paths of the removed files.
    """
    folders = {str(parent) for path in removed for parent in PurePosixPath(path).parents} - {"."}
    for folder in sorted(folders, reverse=True):  # what is inside a folder sorts after it
        target.remove_folder(folder)


def _show(plan: Plan, files: dict[str, bytes], port: str) -> None:
    for path in plan.remove:
        print(f"remove {printable(path)}")
    for path in plan.copy:
        print(f"copy {path}  {len(files[path])} bytes")
    print(
        f"{len(plan.copy)} files to copy to {printable(port)}" if plan.copy else "nothing to copy"
    )


def _report_library(device: Device, target: Prompt | Drive) -> None:
    built_in = device.runtime == "circuitpython"
    if device.device["USB_HID"] and not built_in and not target.has("usb.device.hid"):
        print(
            "to be a USB keyboard or gamepad, this board also needs: "
            f"mpremote connect {printable(target.port)} mip install usb-device-hid"
        )


def _greet(there: Place) -> None:
    deadline_s = time.monotonic() + _RETURN_S
    reason = "it is not on USB"
    while time.monotonic() < deadline_s:
        time.sleep(_POLL_S)
        for port in there.ports():
            try:
                with open_board(port) as board:
                    # The firmware of before runs until the reset, and may still answer.
                    if board.info["firmware"] == __version__:
                        print(
                            "{board}, firmware {firmware}, {runtime}".format(**board.info),
                            printable(port),
                        )
                        return
                    reason = f"it still runs firmware {board.info['firmware']}"
            except SpotsError as error:
                reason = str(error)
    raise SpotsError(
        "the files are on the board, but it does not answer after its restart: replug it "
        f"({reason})"
    )


def _on_disk(size: int, block: int) -> int:
    return -(-size // block) * block


def _arch(number: int) -> str:
    return ARCHITECTURES[number] if 0 < number < len(ARCHITECTURES) else f"architecture {number}"
