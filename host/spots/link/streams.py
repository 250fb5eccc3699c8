"""Starts and stops the streams of a board; makes the iterators that read them."""

import math
from contextlib import suppress
from typing import TypeVar

from ..errors import PortLostError, SpotsError
from .channel import Channel
from .commands import Commands
from .frames import Contact, Key, Reading, Spectrum, Touch
from .lines import of_sensor
from .link import POLL_S
from .readers import FrameIterator
from .reconnect import Connection
from .timeouts import duration_s

# Streams by kind of frame. Keys need no stream: the board sends them after `set keys=1`.
# Contacts come only while a finger touches, so readings are streamed, too: they show that the board
# runs.
_STREAMS: dict[type, tuple[str, ...]] = {
    Touch: ("touch",),
    Spectrum: ("spectrum",),
    Contact: ("contact", "touch"),
}
KINDS = Touch, Spectrum, Key, Contact
_ReadingT = TypeVar("_ReadingT", bound=Reading)


class Streams:
    """Starts the streams of a board, and makes iterators over their frames.

    `chosen` is whether the program has chosen the streams with a command.
    """

    def __init__(self, channel: Channel, commands: Commands, connection: Connection):
        self._channel, self._commands, self._connection = channel, commands, connection
        self.chosen = False

    def want(self, *kinds: type) -> None:
        """Start the streams of these kinds of frames, unless they are on."""
        channel = self._channel
        with channel.turn:
            # `command` may have chosen the streams of some sensors only.
            chosen = self.chosen and channel.wanted
            for sensor in list(channel.wanted) if chosen else channel.sensors:
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
        reader = self.reader(*kinds)
        if wanted:
            self.want(*kinds)
        reader.end_s = channel.now_s() + lasts_s
        return reader

    def reader(self, *kinds: type[_ReadingT]) -> FrameIterator[_ReadingT]:
        """Return an iterator over frames of some kinds, which starts no streams."""
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

    def stop(self) -> None:
        """Send the command that stops the streams, without waiting for a reply."""
        channel = self._channel
        with suppress(SpotsError):  # already unplugged
            for sensor in channel.wanted or [0]:
                line = of_sensor("stream off", channel.only or sensor)
                channel.link.write(line.encode() + b"\n")
