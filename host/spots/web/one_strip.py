"""One strip of a board with several strips: what reads a board with one strip also reads this."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..link.board import Board, addressed
from ..link.frames import Reading


class OneStrip:
    """One strip of a board; attributes that are not listed here are those of the board.

    Parameters
    ----------
    board : Board
        Board with several strips.
    sensor : int
        Number of the strip.

    Attributes
    ----------
    info : dict
        The latest reply to ``hello`` for this strip.
    calibration : list of str or None
        Lines of the calibration that was uploaded to this strip, if known.
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

    def set(self, **settings: Any) -> Mapping[str, Any]:
        """Change settings of this strip; see `Board.set`."""
        return self._board.set(**{**settings, "sensor": self.sensor})

    def frames(self, seconds: float | None = None) -> _Only:
        """Iterate over all frames of this strip."""
        return _Only(self._board.frames(seconds), self.sensor)

    def spectra(self, seconds: float | None = None) -> _Only:
        """Iterate over the spectra of this strip."""
        return _Only(self._board.spectra(seconds), self.sensor)


class _Only:
    """The frames of one strip, as the methods of `Board` iterate over the frames of all strips."""

    def __init__(self, frames: Any, sensor: int):
        self._frames, self._sensor = frames, sensor
        self._next: Reading | None = None
        self.close = frames.close

    def __iter__(self) -> _Only:
        return self

    def __next__(self) -> Reading:
        while not self.unread:
            if not self._frames.wait():
                raise StopIteration
        found, self._next = self._next, None
        return found

    @property
    def unread(self) -> bool:
        """Whether a frame of the strip has already arrived."""
        while self._next is None and self._frames.unread:
            frame = next(self._frames)
            if frame.sensor == self._sensor:
                self._next = frame
        return self._next is not None

    def wait(self) -> bool:
        """Wait up to 0.1 s for a frame; return False if the iteration has ended."""
        return self.unread or self._frames.wait()
