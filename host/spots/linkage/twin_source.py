"""Where a twin's readings come from: boards, or recordings of boards."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Protocol

from spots_device.settings import checksum

from ..calibrate.calibration_file import CalibrationFile
from ..errors import SpotsError
from ..link.board import Board
from ..link.connect import find, open, prepare
from ..link.frames import LinkStats, Touch
from ..link.ports import offered, scheme, scheme_name
from ..recording.recording import Recording
from . import mounted
from .digital_twin import Terminal, Twin, merged, readings
from .encoder import Encoder
from .fivebar import Linkage

_Readings = Iterator[tuple[int, Touch]]


@dataclass(frozen=True)
class Source:
    """A twin with what it follows.

    Attributes
    ----------
    twin : Twin
    names : list of str
        Of the ports or files.
    stats : callable
        Returns the health of each link.
    now_s : callable
        Returns the time by the clock of the readings; of recordings, that when they began.
    readings : callable
        Given for how many seconds (None for no end), yields (joint, reading) for `Twin.follow`.
    """

    twin: Twin
    names: list[str]
    stats: Callable[[], list[LinkStats]]
    now_s: Callable[[], float]
    readings: Callable[[float | None], _Readings]

    def follow(self, seconds: float | None = None) -> Iterator[Terminal]:
        """Yield the terminals, for so long if that is given."""
        return self.twin.follow(self.readings(seconds))


@contextmanager
def opened(linkage: str | Path, ports: list[str] = (), record: list[str] = ()) -> Iterator[Source]:
    """Open what a linkage file names; in a ``with`` block.

    Parameters
    ----------
    linkage : str or Path
        A linkage file; its strips' calibrations are given to the boards.
    ports : list of str
        Of joint 1 and joint 2, or of one board with two sensors; ``recording:FILE`` plays back.
        Boards on USB are found by their ids, if not given.
    record : list of str
        Recordings to make, one for each board.

    Yields
    ------
    Source

    Raises
    ------
    SpotsError
        If a file is wrong, or a board is not there or not that of its calibration.
    """
    twin, strips = loaded(linkage, ports)
    played = [is_recording(port) for port in ports]
    if any(played):
        if not all(played) or record:
            raise SpotsError("recordings are played with recordings, and not recorded again")
        yield _recorded(twin, strips, [scheme(port)[1] for port in ports])
        return
    with ExitStack() as stack:
        boards = _boards(stack, strips, ports)
        _prepare(boards, strips)
        _record(stack, boards, record)
        yield _live(twin, boards, lambda board: _prepare(boards, strips, board))


def loaded(linkage: str | Path, ports: list[str]) -> tuple[Twin, list[CalibrationFile]]:
    """Return the twin of a linkage file, and the calibrations of its strips.

    Parameters
    ----------
    linkage : str or Path
    ports : list of str
        Two, or one of a board with two sensors, or none.

    Returns
    -------
    twin : Twin
    strips : list of CalibrationFile
        Of joint 1 and joint 2.

    Raises
    ------
    SpotsError
        If a file is wrong, or there are more than two ports.
    """
    path = Path(linkage)
    arm = mounted.load(path)
    strips = arm.strips(path)
    if len(ports) > 2:
        raise SpotsError("a linkage has two joints: name two ports, or one of a board with both")
    return Twin(arm.linkage, arm.encoders(strips)), strips


class DrivenLinkage(Protocol):
    """A linkage that opens the boards of its joints itself, such as a simulated one.

    Attributes
    ----------
    linkage : Linkage
    """

    linkage: Linkage

    def encoders(self) -> tuple[Encoder, Encoder]:
        """Return new encoders of both joints."""

    def open(self, joint: int) -> Board:
        """Open the board of a joint, 0 or 1."""


@contextmanager
def driven(machine: DrivenLinkage, record: list[str] = ()) -> Iterator[Source]:
    """Open both boards of a linkage that opens them itself; in a ``with`` block.

    Parameters
    ----------
    machine : DrivenLinkage
    record : list of str
        Recordings to make, one for each board.

    Yields
    ------
    Source

    Raises
    ------
    SpotsError
        If a board cannot be opened.
    """
    with ExitStack() as stack:
        boards = [stack.enter_context(machine.open(joint)) for joint in (0, 1)]
        _record(stack, boards, record)
        yield _live(Twin(machine.linkage, machine.encoders()), boards)


def linkage_of(ports: list[str]):
    """Return what makes the `DrivenLinkage` of ports one of which is a whole linkage, or None."""
    return next(filter(None, (offered(port, "linkage") for port in ports)), None)


def is_recording(port: str) -> bool:
    """Return whether a port is a recording, which a twin reads as fast as it can."""
    return scheme_name(port) == "recording"


def paced(pairs: _Readings) -> _Readings:
    """Yield readings at the pace at which they were taken."""
    ahead_s = None
    for joint, touch in pairs:
        if ahead_s is None:
            ahead_s = touch.time_s - time.monotonic()
        time.sleep(max(touch.time_s - ahead_s - time.monotonic(), 0.0))
        yield joint, touch


def check(strip: CalibrationFile, info: dict, number: int, name: str) -> None:
    """Check that a board is that of a joint's calibration.

    Parameters
    ----------
    strip : CalibrationFile
        Of the joint.
    info : dict
        The board's ``hello``.
    number : int
        Of the joint, 1 or 2.
    name : str
        Of the port, for the message.

    Raises
    ------
    SpotsError
        If it is another board.
    """
    if info["id"] != strip.board:
        raise SpotsError(
            f"joint {number}, {name}: this is board {info['id']}, and the calibration of the joint "
            f"was made on {strip.board}: name the ports in the order of the joints"
        )


def give(board: Board, strip: CalibrationFile) -> None:
    """Upload a joint's calibration to its board.

    Parameters
    ----------
    board : Board
        The joint's board.
    strip : CalibrationFile
        Of the joint.

    Raises
    ------
    SpotsError
        If it does not take it, or can only be read and has another.
    """
    if not board.read_only:
        prepare(board, strip.lines)
        return
    used, needed = board.info.get("calibration"), checksum(list(strip.lines))
    if used != needed:
        raise SpotsError(
            f"{board.port} can only be read and uses calibration {used}, its joint has {needed}: "
            "upload that where the board is plugged in"
        )


def _live(twin: Twin, boards: list[Board], restarted=lambda board: None) -> Source:
    return Source(
        twin,
        [board.port for board in boards],
        lambda: [board.stats for board in boards],
        boards[0].now_s,
        lambda seconds: readings(boards, seconds, restarted),
    )


def _boards(stack: ExitStack, strips: list[CalibrationFile], ports: list[str]) -> list[Board]:
    if ports:
        return [stack.enter_context(open(port)) for port in ports]
    wanted = list(dict.fromkeys(strip.board for strip in strips))
    there = {board.info["id"]: stack.enter_context(board) for board in find()[0]}
    missing = [name for name in wanted if name not in there]
    if missing:
        raise SpotsError(
            f"no board {' and no board '.join(missing)}, with which the joints were calibrated: "
            f"plug it in, or name ports with --port; there is {', '.join(there) or 'none'}"
        )
    for name in there.keys() - set(wanted):
        there[name].close()
    return [there[name] for name in wanted]


def _prepare(boards: list[Board], strips: list[CalibrationFile], only: Board | None = None) -> None:
    if len(boards) == 1:
        return  # a board with two sensors holds both calibrations itself
    for number, (board, strip) in enumerate(zip(boards, strips), 1):
        if only in (None, board):
            check(strip, board.command("hello"), number, board.port)
            give(board, strip)


def _record(stack: ExitStack, boards: list[Board], paths: list[str]) -> None:
    if paths and len(paths) != len(boards):
        raise SpotsError(f"there are {len(boards)} boards: name as many files with --record")
    for board, path in zip(boards, paths):
        stack.enter_context(board.record(path))


def _recorded(twin: Twin, strips: list[CalibrationFile], paths: list[str]) -> Source:
    recordings = [Recording(path) for path in paths]
    for recording in recordings:
        if recording.header.clock is None:
            raise SpotsError(f"{recording.path} does not hold when its readings were taken")
    if len(recordings) == 2:
        for number, (recording, strip) in enumerate(zip(recordings, strips), 1):
            info, named = recording.header.info, checksum(list(strip.lines))
            check(strip, info, number, str(recording.path))
            if info["calibration"] != named:
                raise SpotsError(
                    f"joint {number}, {recording.path}: recorded with calibration "
                    f"{info['calibration']}, and the linkage file names {named}: name the one that "
                    "it was recorded with"
                )

    begun_s = max(recording.header.host_s for recording in recordings)

    def both(seconds: float | None) -> _Readings:
        touches = [(one for _, one in file if isinstance(one, Touch)) for file in recordings]
        pairs = merged(*touches) if len(touches) == 2 else ((t.sensor, t) for t in touches[0])
        end_s = math.inf if seconds is None else begun_s + seconds
        return takewhile(lambda pair: pair[1].time_s <= end_s, pairs)

    return Source(
        twin,
        [str(recording.path) for recording in recordings],
        lambda: [recording.stats for recording in recordings],
        lambda: begun_s,
        both,
    )
