"""Records a board: a listener that writes all bytes of the board to a file."""

from pathlib import Path
from typing import Any

from ..errors import SettingError
from ..link.board import Board
from ..link.lines import of_sensor
from ..link.readers import Handle
from ..link.stored import stored_calibration
from .writer import Writer


class Recorder(Writer):
    """Records all bytes that arrive from a board from now on.

    The recording ends when you call `stop`, at the end of a ``with`` block, or when the board is
    closed. Frames that have already arrived are not recorded, even if they are still unread.

    Parameters
    ----------
    board : Board
        The board.
    path : str or Path
        Name of the new file.
    rotate_bytes : int, optional
        Largest size of a file, in bytes; a longer recording continues in another file. No limit if
        not given.

    Raises
    ------
    FileError
        If the file exists or cannot be written.
    SettingError
        If the board is a recording.

    Examples
    --------
    >>> with spots.open("virtual") as board:  # doctest: +SKIP
    ...     with spots.Recorder(board, "run.spots"):
    ...         board.stream("touch", "spectrum")
    """

    def __init__(self, board: Board, path: str | Path, *, rotate_bytes: int | None = None):
        self._handles: list[Handle] = []
        channel = board.channel
        if channel.player is not None:
            raise SettingError(f"{board.port} is already a recording: copy its file")
        info: dict[str, Any] = dict(board.command("hello"))
        if others := [board.command(of_sensor("hello", i)) for i in board.sensors[1:]]:
            info["strips"] = [dict(info), *others]
        dark = calibrations = None
        if not board.read_only:
            dark = [board.command(of_sensor("get", i))["dark"] for i in board.sensors]
            strips = info, *others
            calibrations = [stored_calibration(board, strips[i], i) for i in board.sensors]

        def describe() -> dict[str, Any]:
            return {
                "info": info,
                "calibration": board.calibration or (calibrations and calibrations[0]),
                "calibrations": (calibrations and calibrations[1:]) or None,
                "dark": dark,
                "clock": channel.clocks.clock.state(),
                "restarts": channel.stats.restarts,
                "sequence": channel.decoder.expected,
            }

        with channel.turn:  # no other thread reads from the board
            begun = channel.decoder.pending
            super().__init__(board.now_s, path, describe, begun=begun, rotate_bytes=rotate_bytes)
            self._handles = [
                Handle(channel.taps, self.take),
                board.when_closed(self.stop),
                board.when_marked(self.mark),
            ]

    def _release(self) -> None:
        for handle in self._handles:
            handle.cancel()
        super()._release()
