"""The class `Board`: connects to a SPOTS board, sends commands and receives frames.

A SPOTS board is a microcontroller that measures presses on one or more tactile strips. A frame is
one message of a board, such as a reading (`frames.Touch`). A stream is a kind of frame that the
board sends by itself after the command ``stream``. A board with several strips has one sensor for
each strip; sensors are numbered from 0.
"""

import asyncio
import math
import re
from collections import deque
from collections.abc import AsyncGenerator, Callable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, suppress
from numbers import Integral
from pathlib import Path
from typing import Any, Literal, NoReturn, TypeVar, cast, overload

import msgspec

from spots_device import PROTOCOL
from spots_device.board.command import LINE_MAX, NAME_MAX

from ..common.plugins import entry_points
from ..errors import (
    AtPromptError,
    ClosedError,
    CommandError,
    NoReplyError,
    PortLostError,
    RefusedError,
    SpotsError,
)
from .board_errors import in_words
from .clocksync import TRIPS, ClockSync, spread_s
from .frames import Contact, Decoder, Frame, Key, LinkStats, Note, Reading, Spectrum, Text, Touch
from .readers import FrameIterator, FrameLog, Handle, Subscription, check_callback
from .replies import Changed, DarkFrame, Get, Hello, Sync, validated
from .serial_link import Link
from .timeouts import ANSWER_S, CONNECTED, PATIENCE_S, WHO_S, WHO_TRIES, LinkLoss, silent_s
from .turn import Turn

# Timeouts of replies, in s. These commands reply when their work is done, all others immediately.
# The usual timeout is long, because on a busy computer a simulated board may get no processor time
# for seconds.
_REPLY_S = {"auto": 120.0, "dark": 30.0, "save": 10.0}
_USUAL_REPLY_S = 4.0
# Timeouts and numbers of attempts when a board is opened.
_HELLO_TIMEOUT_S = 1.0
_HELLO_TRIES = 3
# A board at its Python prompt (REPL) prints _PROMPT after each line. Its raw prompt prints nothing;
# Ctrl-B leaves the raw prompt. To the firmware, Ctrl-B is part of an unknown command.
_PROMPT, _LEAVE_RAW_PROMPT = b">>> ", b"\x02"
_PROMPT_S = 0.3
_TAIL_BYTES = 64  # number of latest bytes in which a prompt is looked for
_POLL_S = 0.1  # longest wait in one call of the link
_SYNC_TIMEOUT_S = 0.5
_SYNC_TRIES = 4
_STREAM_TRIES = 3  # attempts to resume the streams after a restart
_LATEST_S = 2.0  # usual timeout of `Board.read_latest`
_RATE_READINGS = 64  # number of readings from which the rate is computed
# Streams by kind of frame. Keys need no stream: the board sends them after `set keys=1`.
# Contacts come only while a finger touches, so readings are streamed, too: they show that the board
# runs.
_STREAMS: dict[type, tuple[str, ...]] = {
    Touch: ("touch",),
    Spectrum: ("spectrum",),
    Contact: ("contact", "touch"),
}
_KINDS = Touch, Spectrum, Key, Contact
_ReadingT = TypeVar("_ReadingT", bound=Reading)
_SENSORS_MAX = 16  # the number of the sensor has four bits in a frame


_OF_ALL = "save", "reboot", "sync"  # commands for the whole board
# The first line of an upload names the sensor for all of its lines.
_UPLOADED = re.compile(r"(cal|layout) (?!(begin|clear)\b)")


def _duration_s(value: object, name: str) -> float:
    """Return the argument `name` of a function, a duration in seconds; validate it.

    A negative duration is valid: a program may compute it as the rest of a time that has passed.
    """
    try:
        found = float(value)  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError):
        found = math.nan
    if math.isnan(found):
        raise SpotsError(f"{name} must be a number of seconds, not {value!r}")
    return found


def of_sensor(line: str, sensor: int) -> str:
    """Append ``sensor=N`` to a command, unless N is 0.

    Parameters
    ----------
    line : str
        The command.
    sensor : int
        Number N of the sensor; more than 0 only on a board with several strips.

    Returns
    -------
    str
    """
    return f"{line} sensor={sensor}" if sensor else line


def addressed(line: str, sensor: int) -> str:
    """Add the number of a sensor to a command if the command concerns a single strip.

    Parameters
    ----------
    line : str
        The command, without ``sensor=``.
    sensor : int
        Number of the sensor.

    Returns
    -------
    str
        The command with ``sensor=``. A command for all strips is returned unchanged. In an upload,
        the first line names the sensor for all its lines; the other lines are returned unchanged.
    """
    if line.partition(" ")[0] in _OF_ALL or _UPLOADED.match(line):
        return line
    return of_sensor(line, sensor)


class Board(AbstractContextManager["Board"]):
    """A connected SPOTS board. Close this object, or use it in a ``with`` block.

    When a board restarts, for example after a brown-out, its streams stop. Its port may disappear
    and appear again under another name. While a program waits for frames, this object opens the
    port again and resumes the streams; see `state` and `stats.restarts`. If another board is on the
    port, this object refuses that board.

    Several threads may use this object in parallel. A frame is one message of the board, such as a
    reading. Each iterator over frames, such as `touches`, yields every frame of its kinds. A
    command in one thread does not delay frames for other threads.

    Parameters
    ----------
    link : serial_link.Link
        Link to the board; `close` closes it.
    only : int, optional
        Number of a sensor, on a board with several strips. The object then represents this strip
        only: its commands go to this sensor, and frames of other sensors are dropped. In its
        frames, `sensor` is 0.

    Attributes
    ----------
    info : replies.Hello
        The board's reply to ``hello`` when it was connected. Since then, ``set`` and ``auto`` have
        updated the settings, and `connect.upload` the calibration.
    log : collections.deque of dict
        The latest log lines of the board.
    patience_s : float
        Time in seconds for which a streaming board may be unplugged before SpotsError is raised.
    calibration : list of str or None
        Lines of the latest calibration that this object uploaded to sensor 0; None if there was no
        upload; see also `advice.stored_calibration`.
    read_only : bool
        True for a recording or a remote board, which no command can change.
    ended : bool
        True after the end of a recording: no more frames will come.
    doubts : sequence of str
        What is wrong with the played part of a recording, see `Recording.doubts`; empty for a
        board.

    Raises
    ------
    SpotsError
        If no board answers, or the board has another protocol version than this program.

    Examples
    --------
    >>> import spots
    >>> with spots.open("virtual") as board:
    ...     touches = list(board.touches(seconds=0.5))
    ...     board.info["board"], board.state
    ('virtual', 'connected')
    >>> len(touches) > 10
    True
    """

    read_only = False
    ended = False
    doubts: Sequence[str] = ()
    _poll_s = _POLL_S

    def __init__(self, link: Link, only: int | None = None):
        if not hasattr(link, "now_s"):
            raise SpotsError(f"a Board needs a link, not {link!r}: call spots.open(port)")
        self._link: Link = link
        self._only = only
        self._decoder = Decoder()
        self._clocks = ClockSync()
        self._frames = FrameLog()
        self._turn = Turn()
        self._replies: deque[Text] = deque(maxlen=64)
        self._streams: dict[int, list[str]] = {}  # streams that should be on, by sensor
        self._chosen = False  # whether `command` chose the streams
        self._loss = LinkLoss(link.now_s())
        self._stopped: set[int] = set()  # sensors whose streams ended with a restart of the board
        self._tail = b""  # the latest bytes that have arrived
        self._late = False  # whether the reply to an earlier command may still arrive
        self._closed = False
        self._times_us: deque[int] = deque(maxlen=_RATE_READINGS)
        self._latest: dict[int, Touch] = {}  # the newest reading since the last restart, by sensor
        self._on_data: list[Callable[..., None]] = []
        self._on_close: list[Callable[..., None]] = []
        self._on_state: list[Callable[..., None]] = []
        self._reported_state = CONNECTED
        self.calibration: list[str] | None = None
        self.log: deque[dict[str, Any]] = deque(maxlen=100)
        self.patience_s = PATIENCE_S
        try:
            self._connect()
        except BaseException:
            link.close()
            raise

    def __exit__(self, *exception: object) -> None:
        self.close()

    def __reduce_ex__(self, protocol: object) -> NoReturn:
        # A copy would close this object's port, and another process cannot share it.
        raise TypeError(
            "a Board cannot be copied or sent to another process: pass this object on, or open the "
            "board there"
        )

    def __repr__(self) -> str:
        rate = ("no readings yet", "one reading", f"{self.rate_hz:.1f} Hz")[
            min(len(self._times_us), 2)
        ]
        name = self.info["board"]
        return f"<{type(self).__name__} {name} on {self.port}: {self.state}, {rate}>"

    @property
    def stats(self) -> LinkStats:
        """Statistics of the link since the board was opened."""
        return self._decoder.stats

    @property
    def state(self) -> str:
        """State of the connection: ``connected``, or the reason why no readings arrive.

        ``stalled``: the port exists, but the board or its sensor sends nothing. ``lost``: the board
        is unplugged, and its port is searched for. ``refused``: another board is on the port.
        ``closed``: the program has closed the board.
        """
        return "closed" if self._closed else self._loss.state(self.now_s())

    @property
    def rate_hz(self) -> float:
        """Mean rate of the last 64 readings in Hz, by the board's clock; NaN before two readings.

        On a board with several strips, this is the rate of sensor 0.
        """
        times_us = self._times_us
        if len(times_us) < 2:
            return float("nan")
        return (len(times_us) - 1) * 1e6 / max(1, (times_us[-1] - times_us[0]) % (1 << 32))

    @property
    def drift_ppm(self) -> float:
        """How much faster the board's clock runs than the host's, in ppm.

        Valid after the board has streamed for a minute; before that, it may be 0.
        """
        return -1e6 * self._clocks.clock.slope

    @property
    def port(self) -> str:
        """Name of the board's port."""
        return self._link.name

    def silent(self, least_s: float) -> bool:
        """Return whether no reading has arrived for some time although readings are streamed.

        Parameters
        ----------
        least_s : float
            Time without a reading, in seconds, after which to return True. For a slow board, the
            time of three readings is used if that is longer.
        """
        return self._loss.silent(self.now_s(), _duration_s(least_s, "least_s"))

    def now_s(self) -> float:
        """Return the host's time in seconds, by the same clock as `Touch.time_s`.

        For a recording, this is the time of the recording; for a simulation, the simulated time.
        """
        return self._link.now_s()

    @overload
    def command(self, line: Literal["hello"], timeout_s: float | None = None) -> Hello: ...
    @overload
    def command(self, line: Literal["get"], timeout_s: float | None = None) -> Get: ...
    @overload
    def command(self, line: Literal["auto"], timeout_s: float | None = None) -> Changed: ...
    @overload
    def command(self, line: Literal["dark"], timeout_s: float | None = None) -> DarkFrame: ...
    @overload
    def command(self, line: Literal["sync"], timeout_s: float | None = None) -> Sync: ...
    @overload
    def command(self, line: str, timeout_s: float | None = None) -> Mapping[str, Any]: ...
    def command(self, line: str, timeout_s: float | None = None) -> Any:
        """Send a command to the board and return its reply.

        Parameters
        ----------
        line : str
            Command as in docs/protocol.md, for example ``set exposure_us=10000``.
        timeout_s : float, optional
            Longest time to wait for the reply, in seconds. The default is the longest time that
            this command may take.

        Returns
        -------
        dict
            The reply. For ``hello``, ``get``, ``auto``, ``dark`` and ``sync`` see the types in
            `replies`.

        Raises
        ------
        SpotsError
            If the line is invalid, the board refuses the command, or no reply arrives in time.
        """
        if not isinstance(line, str):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise SpotsError(f"a command must be a text, not {line!r}")
        if timeout_s is not None:
            timeout_s = _duration_s(timeout_s, "timeout_s")
        content = self._command(line, timeout_s)
        self._chosen |= content["re"] == "stream"
        return content

    def set(self, **settings: int | Sequence[str]) -> Changed:
        """Change settings of the board, atomically.

        Parameters
        ----------
        **settings : int, str or sequence of str
            Names and values of settings, as in docs/protocol.md. The value of ``plan`` is a
            sequence of channel names, or a text with commas between the names. On a board with
            several strips, ``sensor`` selects a strip.

        Returns
        -------
        replies.Changed
            All settings after the change, and the expected rate.

        Raises
        ------
        SpotsError
            If the board refuses one of the settings. Then no setting is changed.

        Examples
        --------
        >>> with spots.open("virtual") as board:
        ...     board.set(average=2)["average"]
        2
        """
        words: list[str] = []
        for name, value in settings.items():
            given: Any = value
            if isinstance(given, Integral | str):  # Integral: an integer of NumPy, too
                text = str(given)
            elif isinstance(given, Sequence) and all(
                isinstance(part, str) for part in cast("Sequence[object]", given)
            ):
                text = ",".join(cast("Sequence[str]", given))
            else:
                raise SpotsError(f"{name} must be a whole number or a text, not {value!r}")
            if name != "sensor":
                words.append(f"{name}={text}")
        line = of_sensor("set " + " ".join(words), cast("int", settings.get("sensor", 0)))
        return cast("Changed", self._command(line))

    def _command(self, line: str, timeout_s: float | None = None) -> dict[str, Any]:
        if not line.strip() or len(line) > LINE_MAX or not (line.isascii() and line.isprintable()):
            raise SpotsError(
                f"cannot send {line!r}: a command must have 1 to {LINE_MAX} printable ASCII "
                "characters, not only spaces"
            )
        usual_s = _REPLY_S.get(line.split()[0], _USUAL_REPLY_S)
        if timeout_s is None:
            timeout_s = usual_s
        with self._turn:
            if self._late:
                # The board replies in order: a late reply comes before the one to `hello`.
                hello_s = min(timeout_s, _HELLO_TIMEOUT_S)
                self._late = self._exchange("hello", hello_s) is None
            reply = self._exchange(line, timeout_s)
            if reply is None:
                self._late = True
                self._check_prompt()
                remedy = "replug the board" if timeout_s >= usual_s else f"wait for {usual_s:g} s"
                raise NoReplyError(
                    f"no reply to '{line}' within {timeout_s:g} s from the board on {self.port}: "
                    f"{remedy}"
                )
            if "error" in reply.content:
                reason = in_words(str(reply.content["error"]))
                raise CommandError(f"the board refuses '{line}': {reason}")
            content = self._validated(reply)
            number = content.get("sensor")
            # To a program that reads one strip only, this strip is sensor 0.
            sensor = number if isinstance(number, int) and self._only is None else 0
            if content["re"] == "stream":
                self._streams.pop(sensor, None)
                self._stopped.discard(sensor)
                if kinds := [kind for kind in content["stream"] if kind != "off"]:
                    self._streams[sensor] = kinds
                self._loss.expect(self.now_s() if self._streams else None)
            if "exposure_us" in content and sensor == 0:
                self._take_settings(content)
            if content["re"] in ("set", "auto") and sensor == 0:
                known = {name: reply.content[name] for name in self.info if name in reply.content}
                self.info = cast("Hello", {**self.info, **known, "re": "hello"})
        return content

    def stream(self, *kinds: str) -> None:
        """Make all strips stream these kinds of frames, and no other kinds.

        For one strip, use ``command("stream touch sensor=1")``.

        Parameters
        ----------
        *kinds : str
            ``touch``, ``spectrum`` or ``contact``.

        Raises
        ------
        SpotsError
            If the board refuses a kind or does not answer.
        """
        for sensor in self.sensors:
            self.command(of_sensor("stream " + " ".join(map(str, kinds)), sensor))

    @property
    def sensors(self) -> range:
        """Numbers of the board's sensors, from 0."""
        count: Any = self.info.get("sensors") if self._only is None else 1
        return range(count if isinstance(count, int) and 0 < count <= _SENSORS_MAX else 1)

    def touches(self, seconds: float | None = None) -> FrameIterator[Touch]:
        """Iterate over the readings of all strips as they arrive.

        Earlier readings come first, unless an iterator has read or skipped them; an iterator skips
        frames of other kinds than its own. This method starts the stream of readings, which
        continues until the board is closed. On a board with several strips, `frames.Touch.sensor`
        is the number of the strip.

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
        (True, 9)
        """
        return self._start(seconds, Touch)

    def spectra(self, seconds: float | None = None) -> FrameIterator[Spectrum]:
        """Iterate over spectra: the six raw counts of each reading; see `touches`."""
        return self._start(seconds, Spectrum)

    def keys(self, seconds: float | None = None) -> FrameIterator[Key]:
        """Iterate over presses and releases of keys in the board's own layout; see `touches`.

        Raises
        ------
        SpotsError
            If the board's keys are off. ``command("set keys=1")`` turns them on. If the board is a
            USB keyboard, it then also types on the computer that it is plugged into.
        """
        if not self.read_only and not self.command("hello")["keys"]:
            raise SpotsError(
                f"the keys of the board on {self.port} are off: run 'spots command set keys=1'"
            )
        self._want(Touch)  # a stream that stops shows that the board has restarted
        return self._start(seconds, Key)

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
        return self._start(seconds, Contact)

    def frames(self, seconds: float | None = None) -> FrameIterator[Reading]:
        """Iterate over frames of all kinds; see `touches`.

        This starts the streams of readings and spectra, unless ``command("stream ...")`` has chosen
        the streams. Contacts are included only after `contacts` or
        ``command("stream contact touch")`` has started their stream.
        """
        kinds = () if self._chosen else (Touch, Spectrum)
        self._want(*kinds)
        return self._start(seconds, *_KINDS, wanted=False)

    async def atouches(self, seconds: float | None = None) -> AsyncGenerator[Touch, None]:
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
        touches = await asyncio.to_thread(self.touches, seconds)
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

        Earlier frames come first as in `touches`. A board can have any number of subscribers.

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
        SpotsError
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
        if wrong := [kind for kind in kinds if kind not in _KINDS]:
            names = ", ".join(kind.__name__ for kind in _KINDS)
            raise SpotsError(f"a kind of frames must be one of {names}, not {wrong[0]!r}")
        return Subscription(self._start(None, *(kinds or (Touch,))), callback)

    def read_latest(self, timeout_s: float | None = None) -> Touch:
        """Return the newest reading and drop older readings, for a display that must not lag.

        If no unread reading has arrived, this waits for the next one, on average for half the time
        of a reading; `latest` does not wait. This starts the stream of readings.

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
        if timeout_s is None:
            timeout_s = silent_s(_LATEST_S, self._loss.every_s)
        timeout_s = _duration_s(timeout_s, "timeout_s")
        touches = self.touches(timeout_s)
        with self._turn:
            self._advance(0.0)
        for latest in touches:  # waits for the first reading only
            if not touches.unread:
                return latest
        none = f"no reading within {timeout_s:g} s from the board on {self.port}"
        if timeout_s < self._loss.every_s:
            raise SpotsError(
                f"{none}, which sends one every {self._loss.every_s:g} s: wait longer, or call "
                "latest(), which does not wait"
            )
        raise SpotsError(f"{none}: check its USB cable and the wires of its sensor")

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
        self._check_open()
        if sensor not in self.sensors:
            numbers = ", ".join(map(str, self.sensors))
            raise SpotsError(f"the board has no strip {sensor!r}: its strips are {numbers}")
        # While another thread reads the link, `_want` would wait for it.
        if not all("touch" in kinds for kinds in self._streams.values()) or not self._streams:
            self._want(Touch)
        if self._turn.take(0.0):  # otherwise another thread reads the link
            try:
                self._advance(0.0)
            finally:
                self._turn.give()
        self._frames.skip()
        return self._latest.get(sensor) if self.state == CONNECTED else None

    def close(self) -> None:
        """Stop the streams and close the port. Idempotent; iterators then raise ClosedError."""
        if self._closed:
            return
        self._closed = True  # other threads stop using the link
        with ExitStack() as actions:
            for action in reversed(self._on_close):
                actions.callback(action)
            with self._turn:
                with suppress(SpotsError):  # already unplugged
                    for sensor in self._streams or [0]:
                        line = of_sensor("stream off", self._only or sensor)
                        self._link.write(line.encode() + b"\n")
                self._link.close()

    def _want(self, *kinds: type) -> None:
        with self._turn:
            # `command` may have chosen the streams of some sensors only.
            for sensor in list(self._streams) if self._chosen and self._streams else self.sensors:
                self._want_of(sensor, *kinds)

    def _want_of(self, sensor: int, *kinds: type) -> None:
        before = set(self._streams.get(sensor, ()))
        streams = before.union(*(_STREAMS.get(kind, ()) for kind in kinds))
        if streams == before:
            return
        try:
            self._command(of_sensor("stream " + " ".join(sorted(streams)), sensor))
        except PortLostError:
            if not before:
                raise
            self._streams[sensor] = sorted(streams)  # they start when the board is connected again

    def _start(
        self, seconds: float | None, *kinds: type[_ReadingT], wanted: bool = True
    ) -> FrameIterator[_ReadingT]:
        self._check_open()
        lasts_s = math.inf if seconds is None else _duration_s(seconds, "seconds")
        if wanted:
            self._want(*kinds)
        end_s = self.now_s() + lasts_s

        def advance(reader: FrameIterator[_ReadingT]) -> bool:
            left_s = end_s - self.now_s()
            if self.ended or left_s <= 0:
                return False
            # While another thread reads the link, that thread stores this reader's frames, too.
            if self._turn.take(_POLL_S, lambda: reader.unread):
                try:
                    if not reader.unread:
                        self._advance(min(self._poll_s, left_s))
                finally:
                    self._turn.give()
            return True

        return FrameIterator(self._frames, kinds, advance)

    def _check_open(self) -> None:
        if self._closed:
            raise ClosedError(f"the board on {self.port} is closed: open it again")

    def _advance(self, timeout_s: float) -> None:
        self._pump_or_resume(timeout_s)
        state = self.state
        if state != self._reported_state:
            self._reported_state = state
            for action in list(self._on_state):
                action(state)

    def record(
        self, path: str | Path, *, rotate_bytes: int | None = None
    ) -> AbstractContextManager[Any]:
        """Start a recording: a file with all bytes that arrive from now on.

        Frames that have already arrived are not recorded, even if they are still unread.

        Parameters
        ----------
        path : str or Path
            Name of the new file.
        rotate_bytes : int, optional
            Largest size of a file, in bytes; a longer recording continues in another file. No limit
            if not given.

        Returns
        -------
        recording.recorder.Recorder
            The recorder. The recording ends when you call the recorder's method ``stop()``, at the
            end of its ``with`` block, or when the board is closed.

        Raises
        ------
        SpotsError
            If the file exists or cannot be written.
        """
        info: dict[str, Any] = dict(self.command("hello"))
        if others := [self.command(of_sensor("hello", i)) for i in self.sensors[1:]]:
            info["strips"] = [dict(info), *others]
        dark = None
        if not self.read_only:
            dark = [self.command(of_sensor("get", i))["dark"] for i in self.sensors]

        def describe() -> dict[str, Any]:
            return {
                "info": info,
                "clock": self._clocks.clock.state(),
                "calibration": self.calibration,
                "restarts": self.stats.restarts,
                "sequence": self._decoder.expected,
                "dark": dark,
            }

        (entry,) = entry_points(group="spots.recorders", name="file")
        with self._turn:
            begun = self._decoder.pending
            recorder: Any = entry.load()(
                self.now_s, path, describe, begun=begun, rotate_bytes=rotate_bytes
            )
            recorder.handles = [self.tap(recorder.take), self.when_closed(recorder.stop)]
        return recorder

    def tap(self, look: Callable[[bytes, float], None]) -> Handle:
        """Register ``look(data, now_s)``, which is called with all bytes that arrive from now on.

        `now_s` is the link's time in seconds. The call comes before the bytes are decoded. Return a
        handle that cancels the registration.
        """
        return Handle(self._on_data, look)

    def when_closed(self, action: Callable[[], None]) -> Handle:
        """Register ``action()``, to be called after the port is closed; return a `Handle`."""
        return Handle(self._on_close, action)

    def when_state_changes(self, action: Callable[[str], None]) -> Handle:
        """Register ``action(state)``, to be called at each change of `state`; return a `Handle`.

        The call comes from the thread that waits for frames. It may be missing for ``closed``.
        """
        return Handle(self._on_state, action)

    def _connect(self) -> None:
        self.info = self._hello()
        self._take_settings(self.info)
        self._map_clocks()
        # Frames of a stream that an earlier program left on have no host time yet.
        self._frames.clear()

    def _hello(self) -> Hello:
        self._link.write(b"\n")  # an earlier program may have sent a part of a line
        replies = (self._exchange("hello", _HELLO_TIMEOUT_S) for _ in range(_HELLO_TRIES))
        reply = next(filter(None, replies), None)
        if reply is None:
            self._link.write(_LEAVE_RAW_PROMPT)
            end_s = self.now_s() + _PROMPT_S
            while _PROMPT not in self._tail and (left_s := end_s - self.now_s()) > 0:
                self._pump(left_s)
        info = self._checked(reply)
        self._late = False
        # The bytes before the reply may start in the middle of a frame: that is no loss.
        self._decoder.stats.lost = self._decoder.stats.bad_crc = 0
        return info

    def _checked(self, reply: Text | None) -> Hello:
        if reply is None:
            self._check_prompt()
            raise SpotsError(
                f"the device on {self.port} does not answer 'hello': it is not a SPOTS board, or "
                "its firmware does not run; press its reset button, name another port, or flash "
                "the board"
            )
        if refusal := reply.content.get("error"):
            if self._only and "sensor" in refusal:
                raise SpotsError(
                    f"the board on {self.port} has no strip {self._only}: leave out "
                    f"#{self._only}, or write the number of another strip"
                )
            raise SpotsError(f"the board on {self.port} refuses 'hello': {refusal}")
        version = reply.content.get("protocol")
        if version != PROTOCOL:
            raise SpotsError(
                f"the board on {self.port} has protocol {version}, but the program has {PROTOCOL}: "
                "update the firmware or the program, whichever is older"
            )
        return cast("Hello", self._validated(reply))

    def _check_prompt(self) -> None:
        """Raise AtPromptError if the device without a reply has shown a Python prompt."""
        if _PROMPT in self._tail:
            raise AtPromptError(
                f"the board on {self.port} is at its Python prompt, so its firmware does not run: "
                f"press the board's reset button, or run 'mpremote connect {self.port} resume "
                "reset'; flash the board if it has no firmware yet"
            )

    def _validated(self, reply: Text) -> dict[str, Any]:
        name = reply.content["re"]
        try:
            return validated(name, reply.content)
        except msgspec.ValidationError as error:
            raise SpotsError(
                f"the device on {self.port} is not a SPOTS board: its reply to '{name}' is "
                f"invalid ({error}); name another port, or flash the board"
            ) from None

    def _take_settings(self, settings: Mapping[str, Any]) -> None:
        self._loss.every_s = settings["exposure_us"] * settings["average"] * 1e-6

    def _map_clocks(self) -> None:
        for i in range(TRIPS):
            end_s = self.now_s() + spread_s(i)
            while self.now_s() < end_s:
                self._pump(end_s - self.now_s())
            self._sync()
        self._clocks.keep(self.now_s())

    def _sync(self) -> None:
        for tries_left in reversed(range(_SYNC_TRIES)):
            sent_s = self.now_s()
            try:
                reply = self._command("sync", _SYNC_TIMEOUT_S)
            except SpotsError:
                if not tries_left:
                    raise
                # A late reply comes before the reply to `hello`, and is dropped.
                self._hello()
            else:
                self._clocks.clock.round_trip(sent_s, reply["t_us"], self.now_s())
                return

    def _pump_or_resume(self, timeout_s: float) -> None:
        if self._loss.unplugged:
            self._reconnect(timeout_s)
            return
        try:
            if not self._streams:
                self._pump(timeout_s)
                return
            due_s = min(self._loss.ask_s, self._clocks.due_s)
            self._pump(max(0.0, min(timeout_s, due_s - self.now_s())))
            self._resume()
            self._ask_time()
        except PortLostError:
            if not self._streams:
                raise
            self._latest.clear()
            self._loss.unplug(self.now_s())

    def _ask_time(self) -> None:
        if question := self._clocks.ask(self.now_s()):
            self._link.write(question)

    def _reconnect(self, timeout_s: float) -> None:
        # Only one attempt in each call: an application must return in time to release its keys.
        loss = self._loss
        wait_s = loss.reopen_s - self.now_s()
        if wait_s > 0:
            self._link.sleep(min(timeout_s, wait_s))
            return
        try:
            if not loss.is_open:
                self._link.reopen()
                loss.reopened()
                self._decoded(b"\0")  # ends the frame that the disconnect cut off
            reply = self._exchange("hello", WHO_S)
            loss.tries += 1
            if reply is None and loss.tries < WHO_TRIES:
                return  # the board's firmware may be starting
            info, known = self._checked(reply), self.info.get("id")
            if info.get("id") != known:
                self._link.close_port()
                raise RefusedError(
                    f"{self.port} now has board {info.get('id')} instead of {known}: plug in board "
                    f"{known} again"
                )
            self.info = info
            self._take_settings(self.info)
        except SpotsError as error:
            if (lost_s := loss.unplugged_for_s(self.now_s())) >= self.patience_s:
                if isinstance(error, PortLostError):
                    raise PortLostError(
                        f"{error}; it has been unplugged for {lost_s:.0f} s"
                    ) from None
                raise
            if loss.look_later(self.now_s(), isinstance(error, RefusedError)):
                self.log.append({"log": "error", "text": str(error)})
            return
        loss.plug(self.now_s())

    def _resume(self) -> None:
        # Ask a silent board for its streams. A board without streams has restarted.
        loss = self._loss
        if self.now_s() < loss.ask_s:
            return
        loss.asking(self.now_s())
        reply = self._exchange("sync", ANSWER_S)
        if reply is None:
            loss.unanswered(self.now_s())
            return
        known = self._validated(reply)
        if known["stream"] != [] and not self._stopped:
            return  # the board still streams, or its firmware does not report its streams
        if not self._stopped:
            # This reply may belong to any query since the first one.
            self._restarted(loss.first_asked_s, known["t_us"])
        for _ in range(_STREAM_TRIES):
            try:
                for sensor in sorted(self._stopped):
                    kinds = " ".join(self._streams[sensor])
                    self._command(of_sensor("stream " + kinds, sensor), ANSWER_S)
                return
            except SpotsError:
                loss.ask_s = self.now_s()  # the command or its reply was damaged

    def _restarted(self, sent_s: float, t_us: int) -> None:
        self._stopped = set(self._streams)
        self.stats.restarts += 1
        self._times_us.clear()
        self._latest.clear()
        self._decoder.restarted(self.stats.restarts)
        self._clocks.restart(sent_s, t_us, self.now_s())
        self._loss.ask_s = self.now_s()

    def _exchange(self, line: str, timeout_s: float) -> Text | None:
        self._check_open()
        name = line.split()[0][:NAME_MAX]
        self._replies.clear()
        self._tail = b""
        if self._only:
            line = addressed(line, self._only)
        self._link.write(line.encode() + b"\n")
        sent_s = self.now_s()
        end_s = sent_s + timeout_s
        while self.now_s() < end_s:
            self._pump(min(_POLL_S, timeout_s))
            while self._replies:
                reply = self._replies.popleft()
                if reply.content.get("re") == name:
                    if self._clocks.clock.shows_restart(sent_s, reply.t_us, self.now_s()):
                        self._restarted(sent_s, reply.t_us)
                    return reply
        return None

    def _pump(self, timeout_s: float) -> None:
        self._check_open()
        frames = self._decoded(self._link.read(timeout_s))
        arrived_s = self.now_s()
        for frame in frames:
            # A restarted board sends keys without a stream.
            if not (isinstance(frame, Key) or self._stopped):
                self._loss.heard(arrived_s)
            if not isinstance(frame, Note):
                self._take(self._clocks.clock.timed(frame, arrived_s))
        self._clocks.learn()
        if frames:
            self._turn.wake()

    def _decoded(self, data: bytes) -> list[Frame]:
        if data:
            self._tail = (self._tail + data)[-_TAIL_BYTES:]
            for look in list(self._on_data):
                look(data, self.now_s())
        return self._decoder.feed(data)

    def _take(self, frame: Reading | Text) -> None:
        if not isinstance(frame, Text):
            self._take_reading(frame)
        elif "log" in frame.content:
            text = frame.content.get("text")
            words = {"text": in_words(text)} if isinstance(text, str) else {}
            self.log.append(frame.content | words)
        else:
            if frame.content.get("re") == "sync":
                self._clocks.answered(frame.t_us, self.now_s())
            self._replies.append(frame)

    def _take_reading(self, frame: Reading) -> None:
        if self._loss.unplugged:
            return  # the reading may be of another board
        if self._only is not None:
            if frame.sensor != self._only:
                return
            frame = frame._replace(sensor=0)
        if not isinstance(frame, Key):
            self._loss.expect(self.now_s())
        if isinstance(frame, Touch):
            self._latest[frame.sensor] = frame
            if frame.sensor == 0:
                self._times_us.append(frame.t_us)
        self._frames.append(frame, self.stats)
