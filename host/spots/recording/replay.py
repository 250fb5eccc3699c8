"""A recording as a board that one can listen to."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

from ..errors import SpotsError
from ..link.board import Board
from ..link.frames import LinkStats
from .recorder import Recorder
from .recording import Recording

# So many at once: a board's queue holds them, however far behind its reader is.
_PUMPED_FRAMES = 1000


class _Player:
    """Stands in for the link: its clock shows the time of the recording, at a speed."""

    def __init__(self, recording: Recording, speed: float):
        self.name = str(recording.path)
        self._speed = speed
        self._recorded_s = recording.header.host_s
        self._begun_s = time.monotonic()

    def now_s(self) -> float:
        if math.isinf(self._speed):
            return self._recorded_s
        return self._recorded_s + (time.monotonic() - self._begun_s) * self._speed

    def wait_until(self, recorded_s: float) -> None:
        if math.isinf(self._speed):
            self._recorded_s = max(self._recorded_s, recorded_s)
        else:
            time.sleep(max(0.0, recorded_s - self.now_s()) / self._speed)

    def write(self, data: bytes) -> None:
        raise SpotsError(f"{self.name} is a recording: there is no board behind it")

    def close(self) -> None:
        pass


class Replay(Board):
    """A board whose frames come out of a recording, at the times at which they came in.

    It is read as any other board, except that `frames` and `touches` end with the recording, and
    commands other than ``hello`` and ``stream`` are refused. All that was streamed comes again.
    `now_s` is the time of the recording.

    Parameters
    ----------
    recording : Recording
    speed : float
        1 for the original pace, infinity for as fast as it can be read.
    """

    read_only = True

    def __init__(self, recording: Recording, speed: float = 1.0):
        self._recording = recording
        if math.isinf(speed):
            self._poll_s = math.inf  # straight to the next frame, however long it took to come
        super().__init__(_Player(recording, speed))

    @property
    def stats(self) -> LinkStats:
        """What the recorded link lost, up to here."""
        return self._recording.stats

    @property
    def ended(self) -> bool:
        """Whether all that was recorded has come."""
        return self._next is None and not len(self._frames)

    def _command(self, line: str, timeout_s: float | None = None) -> dict[str, Any]:
        self._check_open()
        name = line.split()[:1]
        if name == ["hello"]:
            return {**self.info}
        if name == ["stream"]:
            self._loss.expect(self.now_s())
            return {"re": "stream"}
        raise SpotsError(f"{self.port} is a recording: '{line}' is for a board")

    def record(self, path: str | Path, *, rotate_bytes: int | None = None) -> Recorder:
        """Raises SpotsError: it is one already."""
        raise SpotsError(f"{self.port} is a recording already: copy the file")

    def close(self) -> None:
        """Let the file go."""
        super().close()
        self._entries.close()

    def _connect(self) -> None:
        self.info = self._recording.header.info
        self.calibration = self._recording.header.calibration
        self._entries = iter(self._recording)
        self._next = next(self._entries, None)

    def _pump(self, timeout_s: float) -> None:
        self._check_open()
        if self._next is None:
            raise SpotsError(f"the recording {self.port} has ended")
        self._link.wait_until(min(self._next[0], self.now_s() + timeout_s))
        now_s = self.now_s()
        for _ in range(_PUMPED_FRAMES):
            if self._next is None or self._next[0] > now_s:
                return
            self._take(self._next[1])
            self._next = next(self._entries, None)


def open_port(rest: str, **simulated) -> Replay:
    """Open the port ``recording:FILE``, see `link.ports`.

    Parameters
    ----------
    rest : str
        The file.
    **simulated
        What only a simulated board takes.

    Returns
    -------
    Replay
        At the original pace.

    Raises
    ------
    SpotsError
        If `rest` is empty, or the file cannot be read.
    """
    if not rest:
        raise SpotsError("the port recording: names no file: write recording:FILE.spots")
    return open_recording(rest)


def open_recording(path: str | Path, speed: float = 1.0) -> Replay:
    """Open a recording as a board.

    Parameters
    ----------
    path : str or Path
        A file that `Board.record` or ``spots record`` made; with the first of a set come all.
    speed : float
        1 for the original pace, 2 for twice as fast, ``math.inf`` for as fast as it can be read.

    Returns
    -------
    Replay
        A board that takes no commands but ``hello`` and ``stream``.

    Raises
    ------
    SpotsError
        If it is no recording, or of a later version, or a file of its set is missing.
    """
    if not speed > 0:
        raise SpotsError(f"a speed is more than 0, not {speed:g}")
    return Replay(Recording(path), speed)
