"""One strip of a board with several strips, with the interface of a board with one strip."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from spots.link.board import Board
from spots.link.lines import addressed
from spots.link.readers import FrameIterator


class OneStrip:
    """One strip of a board with several strips.

    Attributes that this class does not define are those of the board. Before the first reply to
    ``hello`` for this strip, `info` is that for strip 0. `calibration` has the lines that were
    uploaded to this strip, if known.
    """

    def __init__(self, board: Board, sensor: int):
        self._board, self.sensor = board, sensor
        self.info: dict = dict(board.info)
        self.calibration = board.calibration if sensor == 0 else None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._board, name)

    def command(self, line: str, timeout_s: float | None = None) -> Mapping[str, Any]:
        """Send a command to this strip, and return its reply; see `Board.command`."""
        reply = self._board.command(addressed(line, self.sensor), timeout_s)
        if reply["re"] == "hello":
            self.info = dict(reply)
        return reply

    def learn(self, lines: Sequence[str] | None, info: Mapping[str, Any], sensor: int = 0) -> None:
        """Take the calibration of this strip; see `Board.learn`."""
        self._board.learn(lines, info, self.sensor)

    def set(self, **settings: Any) -> Mapping[str, Any]:
        """Change settings of this strip; see `Board.set`."""
        return self._board.set(**{**settings, "sensor": self.sensor})

    def frames(self, seconds: float | None = None) -> FrameIterator:
        """Iterate over all frames of this strip."""
        return self._only(self._board.frames(seconds))

    def spectra(self, seconds: float | None = None) -> FrameIterator:
        """Iterate over the spectra of this strip."""
        return self._only(self._board.spectra(seconds))

    def _only(self, frames: FrameIterator) -> FrameIterator:
        frames.sensor = self.sensor
        return frames
