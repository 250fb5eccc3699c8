"""What a board stores: reads its calibration and its key layout back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, cast

from spots_device.board.settings import checksum  # pyright: ignore[reportUnknownVariableType]

from ..errors import SpotsError
from .board import Board
from .lines import of_sensor


def stored_calibration(
    board: Board, info: Mapping[str, Any], sensor: int = 0
) -> Sequence[str] | None:
    """Return the lines of the calibration that a board uses; None if they are unknown.

    They give `Touch.sigma_um` of the next readings. `info` is the strip's reply to ``hello``.
    """
    name = info.get("calibration")
    if name is None:
        return None
    known = board.calibration if sensor == 0 else None
    if known is None or checksum(known) != name:
        known = _stored(board, "cal", name, sensor)
        board.learn(known, info, sensor)
    return known


def learn_calibrations(board: Board) -> None:
    """Read the calibrations of a board's strips for `Touch.sigma_um`, as far as they are known."""
    with suppress(SpotsError):
        for sensor in board.sensors:
            info = board.command(of_sensor("hello", sensor)) if sensor else board.info
            stored_calibration(board, info, sensor)


def stored_layout(board: Board, info: Mapping[str, Any], sensor: int = 0) -> Sequence[str] | None:
    """Return the lines of the key layout that a board uses; empty for the default layout.

    Parameters and return value are those of `stored_calibration`.
    """
    name = info.get("layout")
    return _stored(board, "layout", name, sensor) if name else []


def _stored(board: Board, command: str, name: str, sensor: int) -> Sequence[str] | None:
    lines: list[str] = []
    try:
        while not board.read_only:
            reply = board.command(of_sensor(f"{command} lines {len(lines)}", sensor))
            part: Any = reply.get("lines")
            if not isinstance(part, list) or not part:
                break
            lines += map(str, cast(list[Any], part))
    except SpotsError:
        return None
    found: str = checksum(lines)
    return lines if found == name else None
