"""Advice for the user: why readings are untrusted or probably wrong, and what to do."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, cast

from spots_device.board.settings import checksum  # pyright: ignore[reportUnknownVariableType]

from ..errors import SpotsError
from .board import Board
from .frames import Reading, Spectrum, Touch
from .lines import of_sensor
from .notice import Floor, Notice, notice_for
from .untrusted import Untrusted

# Spectra of shorter readings would cost a board too much time.
_READING_US_MIN = 5000


class Advice:
    """Watches the readings of a strip; `sentence` has cause and remedy, empty if all is well.

    Without `notice`, which looks for a drift, only untrusted readings are reported.
    """

    def __init__(self, notice: Notice | None = None):
        self.sentence = ""
        self.notice = notice
        self._untrusted = Untrusted()
        self._floor = notice.floor if notice else Floor()

    def take(self, frame: Reading, now_s: float) -> None:
        """Take a frame of the strip and update `sentence`; only touches and spectra are used.

        The frame arrived at `now_s` by `Board.now_s`.
        """
        notice = self.notice
        if isinstance(frame, Touch):
            self._untrusted.take(frame, now_s, self._floor.moving)
        elif not isinstance(frame, Spectrum):
            return
        if notice is None:
            self._floor.follow(frame)
        else:
            notice.take(frame)
        size = notice.sentence if notice else ""
        self.sentence = self._untrusted.sentence
        if size and (self._untrusted.drifted or not self.sentence):
            self.sentence = size

    def warn(self, frame: Reading, now_s: float) -> None:
        """Take a frame, and print `sentence` on stderr when there is something to report."""
        before = self.sentence
        self.take(frame, now_s)
        if self.sentence and not before:
            print(f"spots: {self.sentence}", file=sys.stderr, flush=True)


def streams(settings: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the kinds of frames that an application streams for `Advice`."""
    reading_us = settings.get("exposure_us", 0) * settings.get("average", 1)
    return ("touch", "spectrum") if reading_us >= _READING_US_MIN else ("touch",)


def advice_for(board: Board, info: Mapping[str, Any], sensor: int = 0) -> Advice:
    """Return the `Advice` for a strip of a board; its calibration is read if it is not known.

    `info` is the reply to ``hello`` for this strip.
    """
    return Advice(notice_for(stored_calibration(board, info, sensor), info))


def stored_calibration(
    board: Board, info: Mapping[str, Any], sensor: int = 0
) -> Sequence[str] | None:
    """Return the lines of the calibration that a board uses; None if they are unknown.

    They give `Touch.sigma_um` of the next readings. They are unknown, too, if the firmware of the
    board cannot return its calibration. `info` is the
    reply to ``hello`` for this strip.
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
