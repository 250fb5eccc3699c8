"""The class `Board`: connects to a SPOTS board, sends commands and receives frames.

A SPOTS board is a microcontroller that measures presses on one or more tactile strips. A frame is
one message of a board, such as a reading (`frames.Touch`). A stream is a kind of frame that the
board sends by itself after the command ``stream``. A board with several strips has one sensor for
each strip; sensors are numbered from 0.

The parts of a `Board`: `channel` (bytes, frames and replies), `commands`, `reconnect` and
`streams`; `readings` has the methods that return frames.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from typing import Any, Literal, NoReturn, TypeVar, cast, overload

from ..errors import SettingError, StateError, printable
from .channel import Channel
from .commands import Commands
from .frames import LinkStats, Reading
from .lines import of_sensor
from .link import Link
from .readers import Handle
from .readings import Readings
from .reconnect import Connection
from .replies import Changed, DarkFrame, Get, Hello, Sync
from .streams import Streams
from .timeouts import duration_s

_MARK_MAX = 64  # characters; as JSON, with up to 12 bytes each, they fit a note
_ReadingT = TypeVar("_ReadingT", bound=Reading)


class Board(Readings, AbstractContextManager["Board"]):
    """A connected SPOTS board. Close this object, or use it in a ``with`` block.

    When a board restarts, for example after a brown-out, its streams stop. Its port may disappear
    and appear again under another name. While a program waits for frames, this object opens the
    port again and resumes the streams; see `state` and `stats.restarts`. If another board is on the
    port, this object refuses that board.

    Several threads may use this object in parallel. Each iterator over frames, such as `touches`,
    yields every frame of its kinds. A command in one thread does not delay frames for other
    threads.

    Parameters
    ----------
    link : link.Link
        Link to the board; `close` closes it.
    only : int, optional
        Number of a sensor, on a board with several strips. The object then represents this strip
        only: its commands go to this sensor, and frames of other sensors are dropped. In its
        frames, `sensor` is 0.

    Attributes
    ----------
    read_only : bool
        True for a recording or a remote board, which no command can change.
    channel : channel.Channel
        What is below this object, for a program that stores the bytes of the link: they pass
        through the functions in ``channel.taps``.
    log : collections.deque of dict
        The latest log lines of the board.
    calibration : list of str or None
        Lines of the latest calibration that this object uploaded to sensor 0; None if there was no
        upload; see also `advice.stored_calibration`.

    Raises
    ------
    PortError
        If no board answers, or the board has another protocol version than this program.
    SettingError
        If `link` is no link.

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

    def __init__(self, link: Link, only: int | None = None):
        if not hasattr(link, "now_s"):
            raise SettingError(f"a Board needs a link, not {link!r}: call spots.open(port)")
        self._link: Link = link
        self.channel = Channel(link, only)
        self._commands = Commands(self.channel)
        self._connection = Connection(self.channel, self._commands)
        self._streams = Streams(self.channel, self._commands, self._connection)
        self._on_close: list[Callable[..., None]] = []
        self._on_mark: list[Callable[..., None]] = []
        self.log = self.channel.log
        self.read_only = self.channel.replying is not None
        player = self.channel.player
        self.calibration: list[str] | None = None if player is None else player.calibration
        try:
            self._connection.open()
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
        rate = self.channel.newest.rate_text
        return f"<Board {self.info['board']} on {self.port}: {self.state}, {rate}>"

    @property
    def info(self) -> Hello:
        """The latest reply to ``hello``, with settings that were changed since.

        Its ``calibration`` may have become invalid by such a change: ``command("hello")`` asks.
        """
        return self.channel.info

    @property
    def patience_s(self) -> float:
        """Time in s for which a streaming board may be unplugged before SpotsError is raised."""
        return self._connection.patience_s

    @patience_s.setter
    def patience_s(self, value: float) -> None:
        self._connection.patience_s = value

    @property
    def ended(self) -> bool:
        """True after the end of a recording: no more frames will come."""
        player = self.channel.player
        return player is not None and player.ended and not len(self.channel.frames)

    @property
    def stats(self) -> LinkStats:
        """Statistics of the link since the board was opened."""
        return self.channel.stats

    @property
    def state(self) -> str:
        """State of the connection: ``connected``, or the reason why no readings arrive.

        ``stalled``: the port exists, but the board or its sensor sends nothing. ``lost``: the board
        is unplugged, and its port is searched for. ``refused``: another board is on the port.
        ``closed``: the program has closed the board.
        """
        return self._connection.state

    @property
    def rate_hz(self) -> float:
        """Mean rate of the last 64 readings in Hz, by the board's clock; NaN before two readings.

        On a board with several strips, this is the rate of sensor 0.
        """
        return self.channel.newest.rate_hz

    @property
    def drift_ppm(self) -> float:
        """How much faster the board's clock runs than the host's, in ppm.

        Valid after the board has streamed for a minute; before that, it may be 0.
        """
        return -1e6 * self.channel.clocks.clock.slope

    @property
    def time_error_s(self) -> float:
        """Largest error of ``time_s`` that the comparison of the clocks allows, in seconds.

        Infinite before the clocks of board and host were compared.
        """
        return self.channel.clocks.clock.uncertainty_s

    @property
    def port(self) -> str:
        """Name of the board's port."""
        return self.channel.port

    def now_s(self) -> float:
        """Return the host's time in seconds, by the same clock as `Touch.time_s`.

        For a recording, this is the time of the recording; for a simulation, the simulated time.
        """
        return self.channel.now_s()

    @overload
    def command(self, line: Literal["hello"], timeout_s: float | None = None) -> Hello: ...
    @overload
    def command(self, line: Literal["get"], timeout_s: float | None = None) -> Get: ...
    @overload
    def command(self, line: Literal["autoexpose"], timeout_s: float | None = None) -> Changed: ...
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
            Command as in docs/extend/commands.md, for example ``set exposure_us=10000``.
        timeout_s : float, optional
            Longest time to wait for the reply, in seconds. The default is the longest time that
            this command may take.

        Returns
        -------
        dict
            The reply. For ``hello``, ``get``, ``autoexpose``, ``dark`` and ``sync`` see the types
            in `replies`.

        Raises
        ------
        SettingError
            If the line is invalid.
        BoardError
            If the board refuses the command; its attribute ``why`` has the reason.
        NoReplyError
            If no reply arrives in time.
        """
        if not isinstance(line, str):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise SettingError(f"a command must be a text, not {line!r}")
        if timeout_s is not None:
            timeout_s = duration_s(timeout_s, "timeout_s")
        content = self._commands.send(line, timeout_s)
        self._streams.chosen |= content["re"] == "stream"
        return content

    def set(self, **settings: int | Sequence[str]) -> Changed:
        """Change settings of the board, atomically.

        Parameters
        ----------
        **settings : int, str or sequence of str
            Names and values of settings, as in docs/extend/commands.md. The value of
            ``channels`` is a sequence of channel names, or a text with commas between the names.
            On a board with several strips, ``sensor`` selects a strip.

        Returns
        -------
        replies.Changed
            All settings after the change, and the rate that the chip allows.

        Raises
        ------
        BoardError
            If the board refuses one of the settings. Then no setting is changed.

        Examples
        --------
        >>> with spots.open("virtual") as board:
        ...     board.set(average=2)["average"]
        2
        """
        return cast("Changed", self._commands.set(settings))

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

    def close(self) -> None:
        """Stop the streams and close the port. Idempotent; iterators then raise ClosedError."""
        channel = self.channel
        if channel.closed:
            return
        channel.closed = True  # other threads stop using the link
        with ExitStack() as actions:
            for action in reversed(self._on_close):
                actions.callback(action)
            with channel.turn:
                self._streams.stop()
                self._link.close()

    def mark(self, text: str) -> None:
        """Mark the present moment in all running recordings of this board.

        Parameters
        ----------
        text : str
            Text of the mark, such as "trial 3": 1 to 64 characters.

        Raises
        ------
        SettingError
            If the text is too long or empty.
        StateError
            If no recording is running.

        Examples
        --------
        >>> with spots.Recorder(board, "run.spots"):  # doctest: +SKIP
        ...     board.mark("trial 1")
        """
        if not isinstance(text, str) or not 0 < len(text.strip()) <= _MARK_MAX:  # pyright: ignore[reportUnnecessaryIsInstance]
            raise SettingError(f"a mark must have 1 to {_MARK_MAX} characters, not {text!r}")
        if not self._on_mark:
            raise StateError("there is no recording to mark: start one first")
        for action in [*self._on_mark]:
            action(printable(text.strip()))

    def when_marked(self, action: Callable[[str], None]) -> Handle:
        """Register ``action(text)``, to be called by `mark`; return a `Handle`."""
        return Handle(self._on_mark, action)

    def when_closed(self, action: Callable[[], None]) -> Handle:
        """Register ``action()``, to be called after the port is closed; return a `Handle`."""
        return Handle(self._on_close, action)

    def when_state_changes(self, action: Callable[[str], None]) -> Handle:
        """Register ``action(state)``, to be called at each change of `state`; return a `Handle`.

        The call comes from the thread that waits for frames. It may be missing for ``closed``.
        """
        return Handle(self._connection.on_state, action)
