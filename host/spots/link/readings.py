"""The methods of a board that return frames: iterators, subscriptions, the newest reading."""

from collections.abc import AsyncGenerator, Callable, Mapping, Sequence
from typing import Any, TypeVar, overload

from ..common.certainty import Certainty
from ..errors import BoardError, SettingError
from .channel import Channel
from .frames import Contact, Key, Reading, Spectrum, Touch
from .lines import of_sensor
from .readers import FrameIterator, Subscription, check_callback
from .streams import KINDS, Streams

_ReadingT = TypeVar("_ReadingT", bound=Reading)


class Readings:
    """Base class of `board.Board`, which has the link and the commands."""

    _channel: Channel
    _streams: Streams
    read_only: bool
    command: Callable[..., Any]

    @property
    def port(self) -> str:
        """Name of the port."""
        raise NotImplementedError

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
        self._channel.certainties.pop(sensor, None)
        if found is not None:
            self._channel.certainties[sensor] = found

    def stream(self, *kinds: str) -> None:
        """Make all strips stream these kinds of frames, and no other kinds.

        For one strip, use ``command("stream touch sensor=1")``.

        Parameters
        ----------
        *kinds : str
            ``touch``, ``spectrum`` or ``contact``.

        Raises
        ------
        BoardError
            If the board refuses a kind.
        NoReplyError
            If the board does not answer.
        """
        for sensor in self.sensors:
            self.command(of_sensor("stream " + " ".join(map(str, kinds)), sensor))

    @property
    def sensors(self) -> range:
        """Numbers of the board's sensors, from 0."""
        return self._streams.sensors

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
        if not self.read_only and not self.command("hello")["keys"]:
            raise BoardError(
                f"the keys of the board on {self.port} are off: run 'spots command set keys=1'",
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
        return self._streams.atouches(seconds)

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
        SpotsError
            If no reading arrives in time.
        """
        return self._streams.read_latest(timeout_s)

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
        SpotsError
            If the board is closed, or lost for longer than `patience_s`.

        Examples
        --------
        >>> with spots.open("virtual") as board:
        ...     first = board.read_latest()
        ...     board.latest().t_us >= first.t_us
        True
        """
        return self._streams.latest(sensor)
