"""The methods of a board that return frames: iterators, subscriptions, the newest reading."""

import asyncio
import math
from collections.abc import AsyncGenerator, Callable, Mapping, Sequence
from typing import Any, TypeVar, overload

from ..common.certainty import Certainty
from ..errors import BoardError, PortError, SettingError
from .channel import Channel
from .commands import Commands
from .frames import Contact, Key, Reading, Spectrum, Touch
from .readers import FrameIterator, Subscription, check_callback
from .reconnect import Connection
from .streams import KINDS, Streams
from .timeouts import CONNECTED, duration_s, silent_s

_LATEST_S = 2.0  # usual timeout of `read_latest`

_ReadingT = TypeVar("_ReadingT", bound=Reading)


class Readings:
    """The methods of `board.Board` that return frames; `Board` makes the attributes."""

    channel: Channel
    _commands: Commands
    _connection: Connection
    _streams: Streams

    def learn(self, lines: Sequence[str] | None, info: Mapping[str, Any], sensor: int = 0) -> None:
        """Compute `Touch.sigma_um` of the next readings of a sensor from its calibration.

        Parameters
        ----------
        lines : sequence of str or None
            Lines of the calibration; None if they are unknown.
        info : mapping
            Reply to ``hello`` for this sensor.
        sensor : int, optional
            Number of the sensor.
        """
        found = Certainty.of(lines, info.get("average") or 1)
        self.channel.certainties.pop(sensor, None)
        if found is not None:
            self.channel.certainties[sensor] = found

    @property
    def sensors(self) -> range:
        """Numbers of the board's sensors, from 0."""
        return self.channel.sensors

    def touches(self, seconds: float | None = None) -> FrameIterator[Touch]:
        """Iterate over the readings of all strips as they arrive.

        The iterator yields what arrives from now on. This method starts the stream of readings,
        which continues until the board is closed. On a board with several strips,
        `frames.Touch.sensor` is the number of the strip.

        Parameters
        ----------
        seconds : float, optional
            Duration of the iteration, in seconds by the clock of `now_s`; no limit if not given.
            With 0 or less, the iteration ends immediately.

        Returns
        -------
        iterator of frames.Touch

        Raises
        ------
        SpotsError
            If the board is lost or closed, even during the iteration.

        Examples
        --------
        >>> import pandas as pd
        >>> with spots.open("virtual") as board:
        ...     table = pd.DataFrame(board.touches(seconds=0.5))
        >>> bool(table.position_um.isna().any()), len(table.columns)
        (True, 10)
        """
        return self._streams.start(seconds, Touch)

    def spectra(self, seconds: float | None = None) -> FrameIterator[Spectrum]:
        """Iterate over spectra: the six raw counts of each reading; see `touches`."""
        return self._streams.start(seconds, Spectrum)

    def keys(self, seconds: float | None = None) -> FrameIterator[Key]:
        """Iterate over presses and releases of keys in the board's own layout; see `touches`.

        Raises
        ------
        BoardError
            If the board's keys are off. ``command("set keys=1")`` turns them on. If the board is a
            USB keyboard, it then also types on the computer that it is plugged into.
        """
        channel = self.channel
        if channel.replying is None and not self._commands.send("hello")["keys"]:
            raise BoardError(
                f"the keys of the board on {channel.port} are off: run 'spots command set keys=1'",
                "keys_off",
            )
        self._streams.want(Touch)  # a stream that stops shows that the board has restarted
        return self._streams.start(seconds, Key)

    def contacts(self, seconds: float | None = None) -> FrameIterator[Contact]:
        """Iterate over contacts, one frame for each finger in each reading; see `touches`.

        This also starts the stream of readings: no contacts arrive while no finger touches, so
        contacts alone do not show that the board still works.

        Examples
        --------
        >>> with spots.open("virtual") as board:
        ...     ended = [contact.id for contact in board.contacts(seconds=3) if contact.ended]
        >>> len(ended) > 0
        True
        """
        return self._streams.start(seconds, Contact)

    def frames(self, seconds: float | None = None) -> FrameIterator[Reading]:
        """Iterate over frames of all kinds; see `touches`.

        This starts the streams of readings and spectra, unless ``command("stream ...")`` has chosen
        the streams. Contacts are included only after `contacts` or
        ``command("stream contact touch")`` has started their stream.
        """
        kinds = () if self._streams.chosen else (Touch, Spectrum)
        self._streams.want(*kinds)
        return self._streams.start(seconds, *KINDS, wanted=False)

    def atouches(self, seconds: float | None = None) -> AsyncGenerator[Touch, None]:
        """Iterate over readings in asyncio, without blocking the event loop; see `touches`.

        A thread of asyncio's pool waits for the readings. Soon after the iteration ends, on every
        exit path, the thread is free again.

        Parameters
        ----------
        seconds : float, optional
            Duration of the iteration, in seconds by the clock of `now_s`; no limit if not given.

        Examples
        --------
        >>> import asyncio
        >>> async def count(board):
        ...     return len([touch async for touch in board.atouches(seconds=0.5)])
        >>> with spots.open("virtual") as board:
        ...     asyncio.run(count(board)) > 10
        True
        """
        self.channel.check_open()
        lasts_s = math.inf if seconds is None else duration_s(seconds, "seconds")
        return self._in_asyncio(self._streams.reader(Touch), lasts_s)

    async def _in_asyncio(
        self, touches: FrameIterator[Touch], lasts_s: float
    ) -> AsyncGenerator[Touch, None]:
        await asyncio.to_thread(self._streams.want, Touch)
        touches.end_s = self.channel.now_s() + lasts_s
        try:
            while await asyncio.to_thread(touches.wait):
                while touches.unread:
                    yield next(touches)
                    await asyncio.sleep(0)  # many unread readings must not block the loop
        finally:
            touches.close()

    @overload
    def subscribe(self, callback: Callable[[Touch], object]) -> Subscription[Touch]: ...
    @overload
    def subscribe(
        self, callback: Callable[[_ReadingT], object], *kinds: type[_ReadingT]
    ) -> Subscription[_ReadingT]: ...
    def subscribe(self, callback: Callable[[Any], object], *kinds: Any) -> Subscription[Any]:
        """Call a function with each frame, in a new thread.

        A board can have any number of subscribers.

        Parameters
        ----------
        callback : callable
            ``callback(frame)`` is called with each frame.
        *kinds : type
            Kinds of frames: `Touch`, `Spectrum`, `Key`, `Contact`. Only `Touch` if not given.

        Returns
        -------
        readers.Subscription
            The subscription. It ends when you call its method ``cancel()``, or when the board is
            closed or lost.

        Raises
        ------
        SettingError
            If an argument is wrong.

        Examples
        --------
        >>> import time
        >>> got = []
        >>> with spots.open("virtual") as board:
        ...     subscription = board.subscribe(got.append)
        ...     while len(got) < 10:
        ...         time.sleep(0.01)
        ...     subscription.cancel()
        """
        check_callback(callback)
        if wrong := [kind for kind in kinds if kind not in KINDS]:
            names = ", ".join(kind.__name__ for kind in KINDS)
            raise SettingError(f"a kind of frames must be one of {names}, not {wrong[0]!r}")
        return Subscription(self._streams.start(None, *(kinds or (Touch,))), callback)

    def read_latest(self, timeout_s: float | None = None) -> Touch:
        """Return the newest reading and drop older readings, for a display that must not lag.

        If no reading is waiting in the port, this waits for the next one, on average for half the
        time of a reading; `latest` does not wait. This starts the stream of readings.

        Parameters
        ----------
        timeout_s : float, optional
            Longest time to wait for a reading, in seconds. The default is 2 s, or the time of three
            readings if that is longer.

        Raises
        ------
        PortError
            If no reading arrives in time.
        SettingError
            If it cannot arrive, because `timeout_s` is shorter than the time between two readings.
        """
        channel, every_s = self.channel, self.channel.loss.every_s
        if timeout_s is None:
            timeout_s = silent_s(_LATEST_S, every_s)
        timeout_s = duration_s(timeout_s, "timeout_s")
        touches = self.touches(timeout_s)
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

    def latest(self, sensor: int = 0) -> Touch | None:
        """Return the newest reading that has arrived, without waiting for one; for a control loop.

        A call reads and decodes all bytes that have arrived since the last call. The first call
        also starts the stream of readings, which takes some milliseconds. While the board is silent
        or unplugged, a call may take 0.3 s, because it looks for the board. In contrast to
        `read_latest`, the same reading may be returned several times; ``touch.t_us`` shows this,
        and ``board.now_s() - touch.time_s`` is its age.

        Parameters
        ----------
        sensor : int
            Number of the strip, on a board with several strips.

        Returns
        -------
        frames.Touch or None
            None before the first reading, and when `state` is not ``connected``: a stale reading is
            never returned.

        Raises
        ------
        SettingError
            If the board has no such strip.
        SpotsError
            If the board is closed, or lost for longer than `patience_s`.

        Examples
        --------
        >>> with spots.open("virtual") as board:
        ...     first = board.read_latest()
        ...     board.latest().t_us >= first.t_us
        True
        """
        channel = self.channel
        channel.check_open()
        if sensor not in self.sensors:
            numbers = ", ".join(map(str, self.sensors))
            raise SettingError(f"the board has no strip {sensor!r}: its strips are {numbers}")
        # While another thread reads the link, `want` would wait for it.
        if not channel.wanted or not all("touch" in kinds for kinds in channel.wanted.values()):
            self._streams.want(Touch)
        if channel.turn.take(0.0):  # otherwise another thread reads the link
            try:
                self._connection.advance(0.0)
            finally:
                channel.turn.give()
        return channel.newest.touches.get(sensor) if self._connection.state == CONNECTED else None
