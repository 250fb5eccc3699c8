"""The streams of a board, and what reads them: iterators, the newest reading, asyncio."""

import asyncio
import math
from collections.abc import AsyncGenerator
from contextlib import suppress
from typing import Any, TypeVar

from ..errors import PortError, PortLostError, SettingError, SpotsError
from .channel import Channel
from .commands import Commands
from .frames import Contact, Key, Reading, Spectrum, Touch
from .lines import of_sensor
from .link import POLL_S
from .readers import FrameIterator
from .reconnect import Connection
from .timeouts import CONNECTED, duration_s, silent_s

# Streams by kind of frame. Keys need no stream: the board sends them after `set keys=1`.
# Contacts come only while a finger touches, so readings are streamed, too: they show that the board
# runs.
_STREAMS: dict[type, tuple[str, ...]] = {
    Touch: ("touch",),
    Spectrum: ("spectrum",),
    Contact: ("contact", "touch"),
}
KINDS = Touch, Spectrum, Key, Contact
_LATEST_S = 2.0  # usual timeout of `Board.read_latest`
_SENSORS_MAX = 16  # the number of the sensor has four bits in a frame
_ReadingT = TypeVar("_ReadingT", bound=Reading)


class Streams:
    """Starts the streams of a board, and reads them.

    `chosen` is whether the program has chosen the streams with a command.
    """

    def __init__(self, channel: Channel, commands: Commands, connection: Connection):
        self._channel, self._commands, self._connection = channel, commands, connection
        self.chosen = False

    @property
    def sensors(self) -> range:
        """Numbers of the board's sensors, from 0."""
        channel = self._channel
        count: Any = channel.info.get("sensors") if channel.only is None else 1
        return range(count if isinstance(count, int) and 0 < count <= _SENSORS_MAX else 1)

    @property
    def ended(self) -> bool:
        """Whether all frames of a recording have been read."""
        channel = self._channel
        return channel.player is not None and channel.player.ended and not len(channel.frames)

    def want(self, *kinds: type) -> None:
        """Start the streams of these kinds of frames, unless they are on."""
        channel = self._channel
        with channel.turn:
            # `command` may have chosen the streams of some sensors only.
            chosen = self.chosen and channel.wanted
            for sensor in list(channel.wanted) if chosen else self.sensors:
                self._want_of(sensor, *kinds)

    def _want_of(self, sensor: int, *kinds: type) -> None:
        channel = self._channel
        before = set(channel.wanted.get(sensor, ()))
        streams = before.union(*(_STREAMS.get(kind, ()) for kind in kinds))
        if streams == before:
            return
        try:
            self._commands.send(of_sensor("stream " + " ".join(sorted(streams)), sensor))
        except PortLostError:
            if not before:
                raise
            # They start when the board is connected again.
            channel.wanted[sensor] = sorted(streams)

    def start(
        self, seconds: float | None, *kinds: type[_ReadingT], wanted: bool = True
    ) -> FrameIterator[_ReadingT]:
        """Return an iterator over frames of some kinds; start their streams if `wanted`.

        The duration is by the clock of the link; None for no limit.
        """
        channel = self._channel
        channel.check_open()
        lasts_s = math.inf if seconds is None else duration_s(seconds, "seconds")
        reader = self._reader(*kinds)
        if wanted:
            self.want(*kinds)
        reader.end_s = channel.now_s() + lasts_s
        return reader

    def _reader(self, *kinds: type[_ReadingT]) -> FrameIterator[_ReadingT]:
        channel = self._channel
        player = channel.player
        poll_s = POLL_S if player is None else player.poll_s

        def advance(reader: FrameIterator[_ReadingT], until_s: float) -> bool:
            if player is not None and player.ended:
                return reader.unread
            left_s = min(reader.end_s, until_s) - channel.now_s()
            if left_s <= 0:
                return False
            # While another thread reads the link, that thread stores this reader's frames, too.
            if channel.turn.take(POLL_S, lambda: reader.unread):
                try:
                    if not reader.unread:
                        self._connection.advance(min(poll_s, left_s))
                finally:
                    channel.turn.give()
            return True

        return FrameIterator(channel.frames, kinds, advance, channel.now_s)

    def atouches(self, seconds: float | None) -> AsyncGenerator[Touch, None]:
        """Iterate over readings in asyncio; see `Board.atouches`."""
        self._channel.check_open()
        lasts_s = math.inf if seconds is None else duration_s(seconds, "seconds")
        return self._in_asyncio(self._reader(Touch), lasts_s)

    async def _in_asyncio(
        self, touches: FrameIterator[Touch], lasts_s: float
    ) -> AsyncGenerator[Touch, None]:
        await asyncio.to_thread(self.want, Touch)
        touches.end_s = self._channel.now_s() + lasts_s
        try:
            while await asyncio.to_thread(touches.wait):
                while touches.unread:
                    yield next(touches)
                    await asyncio.sleep(0)  # many unread readings must not block the loop
        finally:
            touches.close()

    def read_latest(self, timeout_s: float | None) -> Touch:
        """Return the newest reading; see `Board.read_latest`."""
        channel, every_s = self._channel, self._channel.loss.every_s
        if timeout_s is None:
            timeout_s = silent_s(_LATEST_S, every_s)
        timeout_s = duration_s(timeout_s, "timeout_s")
        touches = self.start(timeout_s, Touch)
        with channel.turn:
            self._connection.advance(0.0)
        for latest in touches:  # waits for the first reading only
            if not touches.unread:
                return latest
        none = f"no reading within {timeout_s:g} s from the board on {channel.port}"
        if timeout_s < every_s:
            raise SettingError(
                f"{none}, which sends one every {every_s:g} s: wait longer, or call latest(), "
                "which does not wait"
            )
        raise PortError(f"{none}: check its USB cable and the wires of its sensor")

    def latest(self, sensor: int) -> Touch | None:
        """Return the newest reading that has arrived; see `Board.latest`."""
        channel = self._channel
        channel.check_open()
        if sensor not in self.sensors:
            numbers = ", ".join(map(str, self.sensors))
            raise SettingError(f"the board has no strip {sensor!r}: its strips are {numbers}")
        # While another thread reads the link, `want` would wait for it.
        if not channel.wanted or not all("touch" in kinds for kinds in channel.wanted.values()):
            self.want(Touch)
        if channel.turn.take(0.0):  # otherwise another thread reads the link
            try:
                self._connection.advance(0.0)
            finally:
                channel.turn.give()
        return channel.newest.touches.get(sensor) if self._connection.state == CONNECTED else None

    def stop(self) -> None:
        """Send the command that stops the streams, without waiting for a reply."""
        channel = self._channel
        with suppress(SpotsError):  # already unplugged
            for sensor in channel.wanted or [0]:
                line = of_sensor("stream off", channel.only or sensor)
                channel.link.write(line.encode() + b"\n")
