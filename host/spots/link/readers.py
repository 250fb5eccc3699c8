"""Distributes frames to any number of readers: iterators and callbacks."""

from __future__ import annotations

import atexit
import math
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, Generic, TypeVar
from weakref import ref

from spots_device.reading.decode import DROPPED

from ..common.guarded import Guarded
from ..errors import ClosedError, SettingError, SpotsError
from .frames import Contact, Key, LinkStats, Reading

# A reader that lags by more frames than this loses the oldest ones.
FRAMES_MAX = 1 << 16
_END_S = 1.0  # longest wait for a callback at the end of the program
_ReadingT = TypeVar("_ReadingT", bound=Reading)


class FrameLog:
    """Stores each frame until all readers (iterators and callbacks) have taken it.

    A reader begins with the first frame after its creation, and skips frames of other kinds than
    its own. Without readers, nothing is stored.
    """

    def __init__(self):
        self._lock = threading.Lock()
        self._frames: deque[Reading] = deque()
        self._begin = 0  # number of the first stored frame
        self._taken = 0  # number of the first frame that no reader has taken
        # Not a WeakSet: its callback runs when a reader is dropped. If Ctrl-C raises
        # KeyboardInterrupt there, Python ignores the exception, and the program continues.
        self._readers: list[ref[FrameIterator[Any]]] = []

    def __len__(self) -> int:
        return self._begin + len(self._frames) - max(self._begin, self._taken)

    def append(self, frame: Reading, stats: LinkStats) -> None:
        """Add a frame, and drop the oldest frame if the log is full.

        `stats.overrun` counts the frames that no reader took in time.
        """
        with self._lock:
            places = [reader.place for reader in self._alive()]
            self._frames.append(frame)
            end = self._begin + len(self._frames)
            if not places:
                self._taken = end
            least = min(places, default=end)
            while self._frames and (self._begin < least or len(self._frames) > FRAMES_MAX):
                self._frames.popleft()
                stats.overrun += self._begin >= self._taken
                self._begin += 1

    def join(self, reader: FrameIterator[_ReadingT]) -> int:
        """Add a reader, and return the number of its first frame, counted since the start."""
        with self._lock:
            self._readers = [*map(ref, self._alive()), ref(reader)]
            return self._begin + len(self._frames)

    def unread(self, reader: FrameIterator[_ReadingT]) -> bool:
        """Return whether the log has a frame for a reader."""
        with self._lock:
            return self._find(reader)[0] is not None

    def take(self, reader: FrameIterator[_ReadingT]) -> _ReadingT | None:
        """Return a reader's next frame, with the flag `DROPPED` if the reader missed frames."""
        with self._lock:
            frame, place = self._find(reader)
            reader.missed |= reader.place < self._begin
            reader.place = place
            self._taken = max(self._taken, place)
        if frame is None or isinstance(frame, (Key, Contact)) or not reader.missed:
            return frame
        reader.missed = False
        return frame._replace(flags=frame.flags | DROPPED)

    def _alive(self) -> list[FrameIterator[Any]]:
        return [reader for one in self._readers if (reader := one()) is not None]

    def _find(self, reader: FrameIterator[_ReadingT]) -> tuple[_ReadingT | None, int]:
        end = self._begin + len(self._frames)
        for place in range(max(reader.place, self._begin), end):
            frame = self._frames[place - self._begin]
            if isinstance(frame, reader.kinds) and reader.sensor in (None, frame.sensor):
                return frame, place + 1
        return None, end


class FrameIterator(Iterator[_ReadingT]):
    """Iterates over frames of some kinds; `board.Board` creates it.

    Iterators are independent: each iterator yields every frame of its kinds.

    Parameters
    ----------
    log : FrameLog
        Log with the frames.
    kinds : tuple of type
        Kinds of the frames to yield.
    advance : callable
        ``advance(reader, until_s)`` waits a short time for frames; returns False at the time
        `until_s`, or if no more frames will come.
    now_s : callable
        The clock of `within` and of `advance`.

    Attributes
    ----------
    place : int
        Number of the next frame to look at, counted since the start of the log.
    missed : bool
        Whether frames were dropped since the last yielded frame.
    sensor : int or None
        Number of the strip whose frames to yield; None for the frames of all strips.
    end_s : float
        Time at which the iteration ends.
    """

    sensor: int | None = None
    end_s = math.inf

    def __init__(
        self,
        log: FrameLog,
        kinds: tuple[type[_ReadingT], ...],
        advance: Callable[[FrameIterator[_ReadingT], float], bool],
        now_s: Callable[[], float],
    ):
        self.kinds, self.missed = kinds, False
        self._log, self._advance, self._now_s = log, advance, now_s
        self._closed = False
        self.place = log.join(self)

    def __next__(self) -> _ReadingT:
        for frame in self._until(math.inf):
            return frame
        raise StopIteration

    def within(self, seconds: float) -> Iterator[_ReadingT]:
        """Iterate for a time in seconds; the next call continues, and no frame is lost between.

        For a loop that also has other work, such as a tick.
        """
        return self._until(self._now_s() + seconds)

    def _until(self, end_s: float) -> Iterator[_ReadingT]:
        while not self._closed:
            frame = self._log.take(self)
            if frame is not None:
                yield frame
            elif not self._advance(self, end_s):
                return

    @property
    def unread(self) -> bool:
        """Whether a frame has already arrived; `next` then does not wait."""
        return self._log.unread(self)

    def wait(self) -> bool:
        """Wait for a frame, usually up to 0.2 s; return False if the iteration has ended."""
        return not self._closed and (self.unread or self._advance(self, math.inf))

    def close(self) -> None:
        """End the iteration; safe in any thread."""
        self._closed = True


def check_callback(callback: object) -> None:
    """Raise SettingError if a callback cannot be called; later, its error would have no context."""
    if not callable(callback):
        raise SettingError(f"the callback must be a function, not {callback!r}")


class Handle:
    """Registration of a callback; `cancel` removes the callback."""

    def __init__(self, callbacks: list[Callable[..., None]], callback: Callable[..., None]):
        check_callback(callback)
        self._callbacks, self._callback = callbacks, callback
        callbacks.append(callback)

    def cancel(self) -> None:
        """Stop calling the callback. Idempotent."""
        with suppress(ValueError):
            self._callbacks.remove(self._callback)


class Subscription(Generic[_ReadingT]):
    """Calls a function with each frame, in a new thread, until `cancel` or until the board closes.

    An exception in the function is reported on stderr; the thread continues with the next frame.

    Attributes
    ----------
    error : Exception or None
        Error that ended the subscription, such as the loss of the board; also reported on stderr.
    """

    def __init__(self, frames: FrameIterator[_ReadingT], callback: Callable[[_ReadingT], object]):
        self.error: Exception | None = None
        self._frames = frames
        self._callback = Guarded(callback, "a subscriber of a board")
        self._thread = threading.Thread(target=self._run, name="subscription", daemon=True)
        atexit.register(self._end)
        self._thread.start()

    def cancel(self) -> None:
        """Start no further calls, and return immediately; a running call may still continue."""
        self._frames.close()

    def _end(self) -> None:
        """End the thread when the program ends, before what the thread reads from is closed."""
        self.cancel()
        self._thread.join(_END_S)

    def _run(self) -> None:
        try:
            for frame in self._frames:
                self._callback(frame)
        except ClosedError:
            pass
        except SpotsError as error:
            self.error = error
            print(f"spots: {error}", file=sys.stderr, flush=True)
        except Exception as error:
            self.error = error
            self._callback.failed(error)
        finally:
            atexit.unregister(self._end)
