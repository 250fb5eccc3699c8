"""The firmware onto a board, so that at no moment anything half-copied can start."""

from __future__ import annotations

import contextlib
import hashlib
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rich.progress import track

from .build import ARCHITECTURES, build, files_of, mpy_header
from .connect import VIRTUAL, start_simulator
from .connect import open as open_board
from .errors import SpotsError
from .link import usb_ports
from .prompt import Prompt
from .stage import Device, device_of

ENTRY = "main.py"
_OLDEST = (1, 23)
_RETURN_S = 20.0
_POLL_S = 0.2
# What a user made on the board: other files than ours are never touched by `flash`.
USER_FILES = tuple(
    name + end for name in ("settings.txt", "calibration.txt") for end in ("", ".old", ".new")
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
        Bytes that this takes of what is free.
    """

    remove: list[str]
    copy: list[str]
    need: int


def flash(board: str, port: str | None = None, dry_run: bool = False) -> None:
    """Put the firmware on a board, start it, and see that it answers.

    Raises
    ------
    SpotsError
        If there is no board, or more than one, it is not the right one, it has no room, or it
        was disconnected; flashing again completes what was begun.
    """
    device = device_of(board)
    with at_port(board, port) as name, tempfile.TemporaryDirectory() as folder:
        files = files_of(build(board, Path(folder)))
        serial_number = _serial_number(name)
        with Prompt(name) as prompt:
            try:
                refuse(prompt.facts, device, files, name)
                plan = make_plan(files, prompt)
                if dry_run:
                    _show(plan, files, name)
                else:
                    carry_out(plan, files, prompt)
                    if device.config["USB_HID"] and not prompt.has("usb.device.hid"):
                        print(
                            "to be a USB keyboard or gamepad, this board also needs: "
                            f"mpremote connect {name} mip install usb-device-hid"
                        )
            finally:
                prompt.reset()  # also what was refused goes on with what it did before
        if not dry_run:
            _greet(name, serial_number)


@contextlib.contextmanager
def at_port(board: str, port: str | None) -> Iterator[str]:
    """Give the one port to use; a virtual board, with an empty file system, lives as long."""
    if VIRTUAL in (port, board) and port in (None, VIRTUAL):
        with tempfile.TemporaryDirectory() as folder, virtual_board(Path(folder)) as name:
            yield name
    else:
        yield port or the_port()


def the_port() -> str:
    """Return the one USB serial port that there is.

    Raises
    ------
    SpotsError
        If there is none, or more than one.
    """
    ports = [port.device for port in usb_ports()]
    if not ports:
        raise SpotsError("no board found: plug one in with a cable that carries data")
    if len(ports) > 1:
        raise SpotsError(f"more than one board found, name one with --port: {', '.join(ports)}")
    return ports[0]


@contextlib.contextmanager
def virtual_board(folder: Path, sensor: str = "default", scenario: str = "demo") -> Iterator[str]:
    """Start a virtual board on a file system folder as it is, and give its port."""
    start, end = start_simulator(sensor, scenario, 0, str(folder))
    try:
        yield start["port"]
    finally:
        end()


def refuse(facts: dict, device: Device, files: dict[str, bytes], port: str) -> None:
    """Raise SpotsError if a board with these facts cannot run these files."""
    runs = f"the board on {port} runs {facts['runtime']}"
    if facts["runtime"] != device.runtime:
        raise SpotsError(f"{runs}, but {device.name} needs {device.runtime}: install that on it")
    if device.runtime != "micropython":
        raise SpotsError(
            f"{device.name} runs CircuitPython: copy the files of build/{device.name} "
            "onto its CIRCUITPY drive"
        )
    if facts["version"] < _OLDEST:
        version = ".".join(map(str, facts["version"]))
        raise SpotsError(f"{runs} {version}: install MicroPython 1.23 or newer on it")
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
        if header.arch not in (0, arch):
            raise SpotsError(
                f"the board on {port} is {_arch(arch)}, and {device.name} is "
                f"{_arch(header.arch)}: name the right board"
            )
    # Bytecode runs anywhere, but the pins would be another board's.
    if device.march and arch and _arch(arch) != device.march:
        raise SpotsError(
            f"the board on {port} is {_arch(arch)}, and {device.name} is {device.march}: "
            "name the right board"
        )


def make_plan(files: dict[str, bytes], prompt: Prompt) -> Plan:
    """Compare what there is with what is wanted."""
    there = prompt.files()
    copy = [
        path
        for path, data in files.items()
        if there.get(path) != len(data) or prompt.sha256(path) != hashlib.sha256(data).hexdigest()
    ]
    remove = [path for path in sorted(there) if is_ours(path) and path not in files]
    if not copy and not remove:
        return Plan([], [], 0)
    # Without an entry nothing starts, until all is there.
    if ENTRY in there:
        remove.insert(0, ENTRY)
    copy = [path for path in copy if path != ENTRY] + [ENTRY]
    block = prompt.facts["block"] or 1
    taken = sum(_on_disk(len(files[path]), block) for path in copy)
    gone = sum(_on_disk(there[path], block) for path in {*remove, *copy} if path in there)
    # A new file lies beside the old one until its hash was compared.
    most = max(_on_disk(len(files[path]), block) for path in copy)
    return Plan(remove, copy, max(taken - gone + most, most))


def is_ours(path: str) -> bool:
    """Whether a file on a board is the firmware's: not a user's, and not of a user's making."""
    name = path[:-5] if path.endswith(".part") else path
    return name.startswith("tactile/") or name in ("board_config.py", ENTRY)


def carry_out(plan: Plan, files: dict[str, bytes], prompt: Prompt) -> None:
    """Do what a plan says; SpotsError if there is no room for it."""
    free = prompt.facts["free"]
    if free is not None and plan.need > free:
        raise SpotsError(
            f"the board on {prompt.port} has {free} bytes free and this takes {plan.need}: "
            "remove files of yours from it"
        )
    for path in plan.remove:
        prompt.remove(path)
    hidden = not sys.stdout.isatty()
    for path in track(plan.copy, "copying", disable=hidden, transient=True):
        prompt.write(path, files[path])
    print(f"{len(plan.copy)} files copied" if plan.copy else "nothing to copy")


def _show(plan: Plan, files: dict[str, bytes], port: str) -> None:
    for path in plan.remove:
        print(f"remove {path}")
    for path in plan.copy:
        print(f"copy {path}  {len(files[path])} bytes")
    print(f"{len(plan.copy)} files to copy to {port}" if plan.copy else "nothing to copy")


def _greet(port: str, serial_number: str | None) -> None:
    deadline_s = time.monotonic() + _RETURN_S
    while True:
        time.sleep(_POLL_S)
        try:
            with open_board(_port_again(port, serial_number)) as board:
                print("{board}, firmware {firmware}, {runtime}".format(**board.info), board.port)
                return
        except SpotsError as error:
            if time.monotonic() > deadline_s:
                raise SpotsError(
                    f"the files are on the board, but it does not come back: replug it ({error})"
                ) from None


def _serial_number(port: str) -> str | None:
    return next((usb.serial_number for usb in usb_ports() if usb.device == port), None)


def _port_again(port: str, serial_number: str | None) -> str:
    """Return the port of the same device: after a reset it may have another name."""
    same = [usb.device for usb in usb_ports() if serial_number == usb.serial_number]
    return same[0] if serial_number and len(same) == 1 else port


def _on_disk(size: int, block: int) -> int:
    return -(-size // block) * block


def _arch(number: int) -> str:
    return ARCHITECTURES[number] if 0 < number < len(ARCHITECTURES) else f"architecture {number}"
