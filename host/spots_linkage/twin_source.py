"""Sources of readings for a digital twin: boards, recordings, or a simulated linkage."""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple, Protocol

from spots.calibrate.calibration_file import CalibrationFile
from spots.errors import CalibrationError, RefusedError, SettingError, path_text
from spots.link.board import Board
from spots.link.connect import (
    find,
    of_id,
    open,
    prepare,
)
from spots.link.frames import Touch
from spots.link.lines import of_sensor
from spots.link.ports import offered, scheme_name
from spots.link.replies import Hello
from spots.recording.recorder import Recorder
from spots.recording.replay import open_recording
from spots_device.board.settings import checksum

from . import mounted
from .digital_twin import Terminal, Twin, readings
from .encoder import Encoder
from .fivebar import Linkage


class Source(NamedTuple):
    """A linkage's digital twin, and the one or two boards whose readings it follows.

    Attributes
    ----------
    twin : Twin
        The twin, which `follow` updates.
    boards : list of Board
        Board of joint 1 and board of joint 2; the same object twice if one board has both strips.
    sensors : sequence of int
        Number of each joint's strip on its board.
    restarted : callable
        Called with a board after it restarted, to upload its calibrations again.
    """

    twin: Twin
    boards: list[Board]
    sensors: Sequence[int]
    restarted: Callable[[Board], object] = lambda board: None

    def readings(self, seconds: float | None = None) -> Iterator[tuple[int, Touch]]:
        """Yield pairs of joint index (0 or 1) and reading; end after `seconds` if given."""
        return readings(self.boards, self.sensors, seconds, self.restarted)

    def follow(self, seconds: float | None = None) -> Iterator[Terminal]:
        """Yield the end point's position at each reading; end after `seconds` if given."""
        return self.twin.follow(self.readings(seconds))


@contextmanager
def opened(linkage: str | Path, ports: list[str] = (), record: list[str] = ()) -> Iterator[Source]:
    """Open the one or two boards of a linkage file, until the end of a ``with`` block.

    Each joint's calibration is uploaded to the joint's board. A calibration must have been made on
    the board to which it is uploaded.

    Parameters
    ----------
    linkage : str or Path
        Path of the linkage file.
    ports : list of str
        Port of joint 1 and port of joint 2, or the port of a board that has both strips;
        ``recording:FILE`` reads a recording as fast as possible. If empty, the boards are found on
        USB by the board ids in the calibration files.
    record : list of str
        Paths of recordings to write, one for each board; if empty, nothing is recorded.

    Yields
    ------
    Source

    Raises
    ------
    CalibrationError, SettingError
        If a file is invalid, a board is missing, or a calibration was made on another board.
    """
    twin, strips = loaded(linkage, ports)
    played = [is_recording(port) for port in ports]
    if any(played) and not all(played):
        raise SettingError("only one --port is a recording: name two recordings, or two boards")
    with ExitStack() as stack:
        if any(played):
            boards = [
                stack.enter_context(open_recording(port.partition(":")[2], math.inf))
                for port in ports
            ]
        elif ports:
            boards = [stack.enter_context(open(port)) for port in ports]
        else:
            boards = _found(stack, strips)
        if len(boards) == 1:
            boards *= 2

        def give_all(only: list[Board]) -> tuple[int, ...]:
            return tuple(
                give(board, strip, number)
                for number, (board, strip) in enumerate(zip(boards, strips), 1)
                if board in only
            )

        sensors = give_all(boards)
        if boards[0] is boards[1] and sensors[0] == sensors[1]:
            raise CalibrationError(
                f"both joints have the calibration of strip {sensors[0]} of the board on "
                f"{boards[0].port}: name the calibrations of two strips in the linkage file"
            )
        record_all(stack, list(dict.fromkeys(boards)), record)
        yield Source(twin, boards, sensors, lambda board: give_all([board]))


def loaded(linkage: str | Path, ports: list[str]) -> tuple[Twin, list[CalibrationFile]]:
    """Return the digital twin of a linkage file, and the calibrations of its strips.

    Parameters
    ----------
    linkage : str or Path
        Path of the linkage file.
    ports : list of str
        The ports that the user named. Only their number is checked, which must be at most 2.

    Returns
    -------
    twin : Twin
        Twin of the linkage.
    strips : list of CalibrationFile
        Calibration of joint 1 and calibration of joint 2.

    Raises
    ------
    SettingError
        If a file is invalid, or there are more than two ports.
    """
    path = Path(path_text(linkage, "the path of a linkage file"))
    arm = mounted.load(path)
    strips = arm.strips(path)
    if len(ports) > 2:
        raise SettingError(
            f"a linkage has two joints, but --port was given {len(ports)} times: name the port of "
            "joint 1, then the port of joint 2, or one port of a board with both strips"
        )
    return Twin(arm.linkage, arm.encoders(strips)), strips


class DrivenLinkage(Protocol):
    """A linkage that opens its joints' boards itself, such as a simulated linkage.

    Attributes
    ----------
    linkage : Linkage
        Geometry of the linkage.
    """

    linkage: Linkage

    def encoders(self) -> tuple[Encoder, Encoder]:
        """Return new encoders of both joints."""

    def open(self, joint: int) -> Board:
        """Open the board of a joint (0 or 1)."""


def linkage_factory(ports: list[str]):
    """Return a function that makes a `DrivenLinkage`, or None if no port has such a function.

    It is the ability ``linkage(options)`` of a kind of port, see `link.ports`. The first port that
    has it is used.
    """
    return next(filter(None, (offered(port, "linkage") for port in ports)), None)


def has_boards(linkage: str, ports: list[str]) -> bool:
    """Return whether a linkage has real boards or recordings, and is not simulated.

    Parameters
    ----------
    linkage : str
        Path or name of the linkage file.
    ports : list of str
        The ports that the user named.

    Returns
    -------
    bool
    """
    return not linkage_factory(ports) and bool(ports or mounted.is_mounted(linkage))


def is_recording(port: str) -> bool:
    """Return whether a port is a recording (``recording:FILE``)."""
    return scheme_name(port) == "recording"


def paced(pairs: Iterator[tuple[int, Touch]]) -> Iterator[tuple[int, Touch]]:
    """Yield pairs of joint index and reading from recordings, at the original pace."""
    ahead_s = None
    for joint, touch in pairs:
        if ahead_s is None:
            ahead_s = touch.time_s - time.monotonic()
        time.sleep(max(touch.time_s - ahead_s - time.monotonic(), 0.0))
        yield joint, touch


def board_of(strip: CalibrationFile) -> str:
    """Return the id of the board on which a strip was calibrated.

    The id of a strip is that of its board, followed by the strip's number if this is not 0.
    """
    return strip.board.partition("-")[0]


def give(board: Board, strip: CalibrationFile, number: int) -> int:
    """Find a joint's strip on a board, and upload the strip's calibration.

    The calibration file contains the id of the strip. A recording or another read-only board
    accepts no upload; it must already use this calibration.

    Parameters
    ----------
    board : Board
        Board of the joint.
    strip : CalibrationFile
        Calibration file of the joint.
    number : int
        Number of the joint, 1 or 2, for the error message.

    Returns
    -------
    int
        Number of the strip on the board.

    Raises
    ------
    CalibrationError, RefusedError
        If the calibration was made on another board, the board refuses the calibration, or a
        read-only board uses another calibration.
    """
    infos: list[Hello] = [board.command(of_sensor("hello", sensor)) for sensor in board.sensors]
    ids = [str(info["id"]) for info in infos]
    if strip.board not in ids:
        raise RefusedError(
            f"joint {number}, {board.port}: this is board {' and '.join(ids)}, but the calibration "
            f"of the joint was made on board {strip.board}: name the port of that board, in the "
            "order of the joints"
        )
    sensor = ids.index(strip.board)
    info = infos[sensor]
    if not board.read_only:
        prepare(board, strip.lines, sensor)
        return sensor
    used, needed = info.get("calibration"), checksum(list(strip.lines))
    if used is None:
        raise CalibrationError(
            f"joint {number}, {board.port}: the board has no calibration: save calibration "
            f"{needed} on the board before you record or publish its readings"
        )
    if used != needed:
        raise CalibrationError(
            f"joint {number}, {board.port}: the board uses calibration {used}, but the linkage "
            f"file names calibration {needed}: name the file of calibration {used} in the linkage "
            "file"
        )
    return sensor


def _found(stack: ExitStack, strips: list[CalibrationFile]) -> list[Board]:
    """Find and open the boards of two calibrated strips on USB; `stack` closes the boards."""
    wanted = [strip.board for strip in strips]
    if wanted[0] == wanted[1]:
        raise CalibrationError(
            f"both joints have a calibration of the same strip ({wanted[0]}): name the "
            "calibrations of two strips in the linkage file"
        )
    wanted = list(dict.fromkeys(map(board_of, strips)))
    found = [stack.enter_context(board) for board in find()[0]]
    there = {board.info["id"]: board for board in found}
    missing = [name for name in wanted if name not in there]
    if missing:
        raise CalibrationError(
            f"the joints were calibrated with boards that are missing ({', '.join(missing)}): plug "
            "in each missing board, or name ports with --port; found: "
            f"{', '.join(there) or 'no board'}"
        )
    for name in there.keys() - set(wanted):
        there[name].close()
    return [board for name in wanted for board in of_id(found, name)]


def record_all(stack: ExitStack, boards: list[Board], paths: list[str]) -> None:
    """Record each board until a stack of context managers ends.

    Parameters
    ----------
    stack : ExitStack
        Stack whose exit ends the recordings.
    boards : list of Board
        Boards to record.
    paths : list of str
        Path of the recording of each board; if empty, nothing is recorded.

    Raises
    ------
    SettingError
        If there are not as many paths as boards, or a file cannot be written.
    """
    if paths and len(paths) != len(boards):
        raise SettingError(f"--record was given {len(paths)} times: give it once for each board")
    for board, path in zip(boards, paths):
        stack.enter_context(Recorder(board, path))
