"""Advice for the user: why readings are untrusted or probably wrong, and what to do."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

from ..link.board import Board
from ..link.frames import Reading, Spectrum, Touch
from ..link.stored import stored_calibration
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
