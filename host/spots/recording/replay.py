"""Replays a recording as if it were a connected board."""

import math
import time
from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from spots_device import PROTOCOL

from ..errors import BoardError, SettingError, StateError
from ..link.board import Board
from ..link.frames import LinkStats, Reading, Text
from ..link.link import POLL_S, FrameLink
from .recording import Recording

_READ = {"protocol": PROTOCOL}  # the frames are those of this program
# Frames to read in one call; the log of a board has room for more, so no frame is dropped.
_PUMPED_FRAMES = 1000


class RecordedLink(FrameLink):
    """Delivers the frames of a recording at their original times of arrival.

    Its clock is that of the playback, on the time scale of the recording. All commands except
    ``hello`` and ``stream`` are refused, and ``stream`` has no effect: all recorded frames are
    delivered. `speed` is 1 for the original pace, infinity for no pauses.
    """

    def __init__(self, recording: Recording, speed: float = 1.0):
        self.name = str(recording.path)
        self.info: Any = recording.header.info
        self.calibration = recording.header.calibration
        self.poll_s = math.inf if math.isinf(speed) else POLL_S
        self._recording = recording
        self._speed = speed
        self._recorded_s = recording.header.host_s
        self._begun_s = time.monotonic()
        self._entries = iter(recording)
        self._next = next(self._entries, None)

    @property
    def stats(self) -> LinkStats:
        """Statistics of the recorded link, up to the present time of the recording."""
        return self._recording.stats

    @property
    def doubts(self) -> Sequence[str]:
        """What is wrong with the frames that were played, see `Recording.doubts`."""
        return self._recording.doubts

    @property
    def ended(self) -> bool:
        """Whether all recorded frames have been delivered."""
        return self._next is None

    def now_s(self) -> float:
        if math.isinf(self._speed):
            return self._recorded_s
        return self._recorded_s + (time.monotonic() - self._begun_s) * self._speed

    def reply(self, line: str, timeout_s: float) -> dict[str, Any]:
        name, *words = line.split()
        if name == "hello":
            sensor = line.rpartition("sensor=")[2]
            strips: Any = self.info.get("strips")
            if isinstance(strips, list) and sensor.isdecimal() and int(sensor) < len(strips):
                return {**strips[int(sensor)], **_READ}
            return {**self.info, **_READ}
        if name == "stream":
            return {"stream": [word for word in words if not word.startswith("sensor=")]}
        raise BoardError(
            f"'{line}' needs a connected board, but {self.name} is a recording: give the port of a "
            "board",
            "not_here",
        )

    def frames(self, timeout_s: float) -> Iterator[Reading | Text]:
        if self._next is None:
            raise StateError(f"the recording {self.name} has ended: open it again")
        self._wait_until(min(self._next[0], self.now_s() + timeout_s))
        now_s = self.now_s()
        for _ in range(_PUMPED_FRAMES):
            if self._next is None or self._next[0] > now_s:
                return
            yield self._next[1]
            self._next = next(self._entries, None)

    def close(self) -> None:
        """Close the recording's file."""
        self._entries.close()

    def _wait_until(self, recorded_s: float) -> None:
        if math.isinf(self._speed):
            self._recorded_s = max(self._recorded_s, recorded_s)
        else:
            time.sleep(max(0.0, recorded_s - self.now_s()) / self._speed)


def open_port(target: str, options: Namespace | None = None) -> Board:
    """Open the port ``recording:FILE`` as a board, at the original pace; see `link.ports`.

    SettingError if `target`, the path, is empty; FileError if the recording cannot be read.
    """
    if not target:
        raise SettingError("the port 'recording:' has no file: write recording:FILE.spots")
    return open_recording(target)


def open_recording(path: str | Path, speed: float = 1.0) -> Board:
    """Open a recording as a board.

    Parameters
    ----------
    path : str or Path
        File of the recording. If this is the first of several files of one recording, the other
        files are played too.
    speed : float
        1 for the original pace, 2 for twice as fast, ``math.inf`` for no pauses.

    Returns
    -------
    Board
        A board that refuses all commands except ``hello`` and ``stream``.

    Raises
    ------
    FileError
        If the file is not a recording or has a later format version, or if a later file is missing
        although a file after it exists.
    SettingError
        If `speed` is not more than 0.
    """
    if not (isinstance(speed, (int, float)) and speed > 0):
        raise SettingError(f"the speed of a recording must be more than 0, not {speed!r}")
    return Board(RecordedLink(Recording(path), speed))
