"""Frames for any number of readers, each at its own place: iterators, callbacks, asyncio."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import AsyncGenerator, Callable
from contextlib import suppress
from typing import Generic, TypeVar
from weakref import WeakSet

from spots_device.decode import DROPPED

from ..errors import ClosedError
from ..guarded import Guarded
from .frames import Key, LinkStats, Reading

# A reader that falls behind by more than this many frames loses the oldest.
FRAMES_MAX = 1 << 16
_ReadingT = TypeVar("_ReadingT", bound=Reading)


class FrameLog:
    """The latest frames; those that every reader has taken are dropped.

    A new reader begins where the foremost one is, or was: with what nobody has taken.
    """

    def __init__(self):
        self._lock = threading.Lock()
        self._frames: deque[Reading] = deque()
        self._begin = 0  # number of the first frame that is here
        self._taken = 0  # of the first one that nobody has taken
        self._readers: WeakSet[FrameIterator[Reading]] = WeakSet()

    def __len__(self) -> int:
        return self._begin + len(self._frames) - max(self._begin, self._taken)

    def clear(self) -> None:
        """Drop all frames."""
        with self._lock:
            self._taken = self._begin = self._begin + len(self._frames)
            self._frames.clear()

    def append(self, frame: Reading, stats: LinkStats) -> None:
        """Add a frame, and count frames that are dropped because no reader took them in time.

        Parameters
        ----------
        frame : Touch, Spectrum or Key
            The latest frame.
        stats : LinkStats
            Its `overrun` is increased.
        """
        with self._lock:
            self._frames.append(frame)
            least = min([reader.place for reader in self._readers], default=self._taken)
            while self._frames and (self._begin < least or len(self._frames) > FRAMES_MAX):
                self._frames.popleft()
                stats.overrun += self._begin >= self._taken
                self._begin += 1

    def join(self, reader: FrameIterator[_ReadingT]) -> int:
        """Return the place of a new reader."""
        with self._lock:
            self._readers.add(reader)
            return self._taken

    def unread(self, reader: FrameIterator[_ReadingT]) -> bool:
        """Return whether there is a frame for a reader."""
        with self._lock:
            return self._find(reader)[0] is not None

    def take(self, reader: FrameIterator[_ReadingT]) -> _ReadingT | None:
        """Return the next frame for a reader, flagged if those before it were dropped."""
        with self._lock:
            frame, place = self._find(reader)
            reader.missed |= reader.place < self._begin
            reader.place = place
            self._taken = max(self._taken, place)
        if frame is None or isinstance(frame, Key) or not reader.missed:
            return frame
        reader.missed = False
        return frame._replace(flags=frame.flags | DROPPED)

    def _find(self, reader: FrameIterator[_ReadingT]) -> tuple[_ReadingT | None, int]:
        end = self._begin + len(self._frames)
        for place in range(max(reader.place, self._begin), end):
            frame = self._frames[place - self._begin]
            if isinstance(frame, reader.kinds):
                return frame, place + 1
        return None, end


class FrameIterator(Generic[_ReadingT]):
    """Frames of some kinds, those that nobody has taken first; made by `board.Board`.

    Two iterators are independent: each gives all frames of its kinds from its making on.

    Parameters
    ----------
    log : FrameLog
    kinds : tuple of type
    advance : callable
        ``advance(reader)`` waits a moment for frames; it returns False if no more will come.

    Attributes
    ----------
    place : int
        In the log.
    missed : bool
        Whether frames before that place were dropped.
    """

    def __init__(
        self,
        log: FrameLog,
        kinds: tuple[type[_ReadingT], ...],
        advance: Callable[[FrameIterator[_ReadingT]], bool],
    ):
        self.kinds, self.missed = kinds, False
        self._log, self._advance = log, advance
        self._closed = False
        self.place = log.join(self)

    def __iter__(self) -> FrameIterator[_ReadingT]:
        return self

    def __next__(self) -> _ReadingT:
        while not self._closed:
            frame = self._log.take(self)
            if frame is not None:
                return frame
            if not self._advance(self):
                break
        raise StopIteration

    @property
    def unread(self) -> bool:
        """Whether a frame is here, so that `next` does not wait."""
        return self._log.unread(self)

    def close(self) -> None:
        """End the iteration, from any thread."""
        self._closed = True

    async def arriving(self) -> AsyncGenerator[_ReadingT, None]:
        """Yield the frames in asyncio; a thread waits for them."""
        loop, news = asyncio.get_running_loop(), asyncio.Event()
        ended: list[Exception | None] = []
        threading.Thread(target=self._drive, args=(loop, news, ended), daemon=True).start()
        try:
            while True:
                over = bool(ended)
                while (frame := self._log.take(self)) is not None:
                    yield frame
                    await asyncio.sleep(0)  # a backlog must not block the loop
                if over:
                    break
                await news.wait()
                news.clear()
            if ended[0] is not None:
                raise ended[0]
        finally:
            self.close()

    def _drive(
        self,
        loop: asyncio.AbstractEventLoop,
        news: asyncio.Event,
        ended: list[Exception | None],
    ) -> None:
        error = None
        try:
            while not self._closed and self._advance(self):
                if self.unread:
                    loop.call_soon_threadsafe(news.set)
        except Exception as failure:  # raised where the frames are awaited
            error = failure
        ended.append(error)
        with suppress(RuntimeError):  # the loop is closed
            loop.call_soon_threadsafe(news.set)


class Handle:
    """A callback that was registered; `cancel` removes it."""

    def __init__(self, callbacks: list[Callable[..., None]], callback: Callable[..., None]):
        self._callbacks, self._callback = callbacks, callback
        callbacks.append(callback)

    def cancel(self) -> None:
        """Stop calling the callback. Idempotent."""
        with suppress(ValueError):
            self._callbacks.remove(self._callback)


class Subscription(Generic[_ReadingT]):
    """Calls a function with each frame, in a thread of its own, until `cancel`.

    It ends with the board, too. An exception of the function is reported on stderr, and the next
    frame follows.

    Attributes
    ----------
    error : Exception or None
        Why it ended before it was cancelled: the board was lost. It is reported on stderr, too.
    """

    def __init__(self, frames: FrameIterator[_ReadingT], callback: Callable[[_ReadingT], object]):
        self.error: Exception | None = None
        self._frames = frames
        self._callback = Guarded(callback, "a subscriber of a board")
        self._thread = threading.Thread(target=self._run, name="subscription", daemon=True)
        self._thread.start()

    def cancel(self) -> None:
        """Start no further calls. Returns at once: a call that has started may still run."""
        self._frames.close()

    def _run(self) -> None:
        try:
            for frame in self._frames:
                self._callback(frame)
        except ClosedError:
            pass
        except Exception as error:
            self.error = error
            self._callback.failed(error)
