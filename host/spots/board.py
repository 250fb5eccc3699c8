"""A board that one can talk to."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path

from tactile import PROTOCOL
from tactile.command import LINE_MAX, NAME_MAX

from .clockmap import ClockMap
from .errors import PortLostError, SpotsError
from .frames import Decoder, Frame, LinkStats, Note, Text, Touch
from .link import Link
from .recording.recorder import Recorder

# Commands whose reply comes when the work is done; the others answer at once.
_REPLY_S = {"auto": 120.0, "dark": 30.0}
_USUAL_REPLY_S = 2.0
_HELLO_TIMEOUT_S = 1.0
_HELLO_TRIES = 3
# Round trips that begin at different moments of the board's loop: steps of the golden ratio
# spread evenly over any period.
_SYNC_ROUND_TRIPS = 12
_SYNC_SPREAD_S = 0.01
_GOLDEN = 0.618034
_POLL_S = 0.1
# A board that streams and is silent for so long is asked whether it has restarted.
_SILENCE_S = 0.5
# So long may its port be gone meanwhile; a board takes some seconds to be a USB device again.
_GONE_S = 10.0
_REOPEN_EVERY_S = 0.1
# A consumer that falls behind by more than this many frames loses the oldest.
_QUEUE_FRAMES = 1 << 16


class Board:
    """A connected board. Close it, or use it in a ``with`` block.

    A board that restarts (a brown-out, a crash) has forgotten that it was streaming, and its port
    may go away for a while. `frames` and what builds on it open the port again, notice the
    silence, ask, and tell it again; see `stats.restarts`.

    Parameters
    ----------
    link : link.Link
        Taken over; closed with the board.

    Attributes
    ----------
    info : dict
        The board's answer to ``hello``.
    log : collections.deque of dict
        Its last log lines.
    calibration : list of str or None
        The lines of its calibration, where it got them from this object: a board tells only
        their checksum.
    read_only : bool
        Whether `command` can change nothing: of recordings, and of boards on other machines.

    Raises
    ------
    SpotsError
        If nothing answers, or the answer is not that of a board of this protocol version.
    """

    read_only = False

    def __init__(self, link: Link):
        self._link = link
        self._decoder = Decoder()
        self._clock = ClockMap()
        self._frames: deque[Frame] = deque(maxlen=_QUEUE_FRAMES)
        self._replies: deque[Text] = deque(maxlen=64)
        self._streams: list[str] = []  # what the board was told to stream
        self._gone_s: float | None = None  # since when its port is gone
        self._resuming = False
        self._heard_s = link.now_s()
        self._on_close: Callable[[], None] | None = None
        self.calibration: list[str] | None = None
        self.log: deque[dict] = deque(maxlen=100)
        try:
            self._connect()
        except BaseException:
            link.close()
            raise

    def __enter__(self) -> Board:
        return self

    def __exit__(self, *exception) -> None:
        self.close()

    @property
    def stats(self) -> LinkStats:
        """Health of the link since the board was opened."""
        return self._decoder.stats

    @property
    def port(self) -> str:
        """Name of the port."""
        return self._link.name

    def now_s(self) -> float:
        """Return the host's time by the clock of `Touch.time_s`."""
        return self._link.now_s()

    def command(self, line: str, timeout_s: float | None = None) -> dict:
        """Send a command and return the reply.

        Parameters
        ----------
        line : str
            See docs/protocol.md, for example ``set exposure_us=10000``.
        timeout_s : float, optional
            How long to wait; as long as the command may take, if not given.

        Raises
        ------
        SpotsError
            If the line is none, the board refuses, or no reply comes in time.
        """
        if not line.strip() or len(line) > LINE_MAX or not (line.isascii() and line.isprintable()):
            raise SpotsError(f"a command is 1 to {LINE_MAX} printable ASCII characters")
        if timeout_s is None:
            timeout_s = _REPLY_S.get(line.split()[0], _USUAL_REPLY_S)
        reply = self._exchange(line, timeout_s)
        if reply is None:
            raise SpotsError(f"no reply to '{line}' within {timeout_s:g} s; is the board alive?")
        if "error" in reply.content:
            raise SpotsError(f"the board refuses '{line}': {reply.content['error']}")
        if reply.content["re"] == "stream":
            self._streams = [kind for kind in reply.content["stream"] if kind != "off"]
        return reply.content

    def frames(self, seconds: float | None = None) -> Iterator[Frame]:
        """Yield readings and spectra as they come, those that waited first.

        Parameters
        ----------
        seconds : float, optional
            End after this much time of the link's clock; never, if not given.
        """
        end_s = None if seconds is None else self.now_s() + seconds
        while True:
            while self._frames:
                yield self._frames.popleft()
            if end_s is not None and self.now_s() >= end_s:
                return
            left_s = _POLL_S if end_s is None else min(_POLL_S, end_s - self.now_s())
            self._pump_or_resume(max(left_s, 0))

    def touches(self, seconds: float | None = None) -> Iterator[Touch]:
        """Tell the board to stream readings, and nothing else, and yield them."""
        self.command("stream touch")
        return (frame for frame in self.frames(seconds) if isinstance(frame, Touch))

    def read_latest(self, timeout_s: float = 2.0) -> Touch:
        """Return the newest reading and forget those before it, so that a view never lags.

        Raises
        ------
        SpotsError
            If none comes in time. The board has to be streaming, see `touches`.
        """
        end_s = self.now_s() + timeout_s
        latest = None
        self._pump(0)
        while True:
            while self._frames:
                frame = self._frames.popleft()
                latest = frame if isinstance(frame, Touch) else latest
            if latest is not None:
                return latest
            if self.now_s() >= end_s:
                raise SpotsError(f"no reading within {timeout_s:g} s; is the board streaming?")
            self._pump_or_resume(_POLL_S)

    def close(self) -> None:
        """Tell the board to be silent and let the port go."""
        try:
            self._link.write(b"stream off\n")
        except SpotsError:
            pass  # it is gone already
        self._link.close()
        if self._on_close:
            self._on_close()

    def record(self, path: str | Path, *, rotate_bytes: int | None = None) -> Recorder:
        """Write all that comes from now on into a file, before anyone sees it.

        Frames that came earlier and wait to be read are not in it.

        Parameters
        ----------
        path : str or Path
            A file that is not there yet.
        rotate_bytes : int, optional
            Begin another file where one would become longer.

        Returns
        -------
        Recorder
            Ends the recording when stopped, at the end of its ``with`` block, or with the board.

        Raises
        ------
        SpotsError
            If there is such a file, or it cannot be written.
        """
        info = self.command("hello")

        def describe() -> dict:
            clock = self._clock.state()
            return {"info": info, "clock": clock, "calibration": self.calibration}

        recorder = Recorder(
            self._link, path, describe, begun=self._decoder.pending, rotate_bytes=rotate_bytes
        )
        self._link = recorder
        return recorder

    def tap(self, wrap: Callable[[Link], Link]) -> Link:
        """Put a link around the board's own, through which all is read from now on."""
        self._link = wrap(self._link)
        return self._link

    def when_closed(self, action: Callable[[], None]) -> None:
        """Do something after the port was let go."""
        self._on_close = action

    def _connect(self) -> None:
        self.info = self._hello()
        self._map_clocks()
        # Of a stream that an earlier program did not end: their times were not known yet.
        self._frames.clear()

    def _hello(self) -> dict:
        self._link.write(b"\n")  # ends whatever half a line an earlier program left
        for _ in range(_HELLO_TRIES):
            reply = self._exchange("hello", _HELLO_TIMEOUT_S)
            if reply is not None:
                break
        else:
            raise SpotsError(
                f"what is on {self.port} does not answer 'hello': it is not one of our boards, "
                "or its firmware is not running"
            )
        version = reply.content.get("protocol")
        if version != PROTOCOL:
            raise SpotsError(
                f"the board on {self.port} speaks protocol {version}, this program {PROTOCOL}: "
                "update whichever is older"
            )
        # What came before the reply may have begun in the middle of a frame.
        self._decoder.stats.lost = self._decoder.stats.bad_crc = 0
        return reply.content

    def _map_clocks(self) -> None:
        for i in range(_SYNC_ROUND_TRIPS):
            self._idle(i * _GOLDEN % 1 * _SYNC_SPREAD_S)
            self._sync()

    def _sync(self) -> None:
        sent_s = self.now_s()
        reply = self.command("sync", _SILENCE_S)
        self._clock.round_trip(sent_s, reply["t_us"], self.now_s())

    def _pump_or_resume(self, timeout_s: float) -> None:
        if self._gone_s is not None:
            self._reopen(timeout_s)
            return
        try:
            self._pump(timeout_s)
            self._resume()
        except PortLostError:
            if not self._streams:
                raise
            self._gone_s = time.monotonic()

    def _reopen(self, timeout_s: float) -> None:
        # A try, no more: who holds keys down has to be back in time to let go of them.
        try:
            self._link.reopen()
            self._gone_s = None
        except SpotsError:
            if time.monotonic() - self._gone_s >= _GONE_S:
                raise
            time.sleep(min(timeout_s, _REOPEN_EVERY_S))

    def _resume(self) -> None:
        # Ask a board that is silent what it streams; if that is nothing, it has begun anew.
        if not self._streams or self.now_s() - self._heard_s < _SILENCE_S:
            return
        sent_s = self._heard_s = self.now_s()
        lost = self.stats.lost
        reply = self._exchange("sync", _SILENCE_S)
        if reply is None or reply.content.get("stream") != []:
            return  # nobody there, or damaged: after the next silence again; or it has no news
        if not self._resuming:
            self._resuming = True
            self.stats.restarts += 1
        self.stats.lost = lost  # it counts its frames from 0 again
        self._clock = ClockMap()
        self._clock.round_trip(sent_s, reply.content["t_us"], self.now_s())
        try:
            self.command("stream " + " ".join(self._streams), _SILENCE_S)
            self._map_clocks()
        except SpotsError:
            pass  # as above

    def _idle(self, seconds: float) -> None:
        end_s = self.now_s() + seconds
        while self.now_s() < end_s:
            self._pump(end_s - self.now_s())

    def _exchange(self, line: str, timeout_s: float) -> Text | None:
        name = line.split()[0][:NAME_MAX]
        self._replies.clear()
        self._link.write(line.encode() + b"\n")
        end_s = self.now_s() + timeout_s
        while self.now_s() < end_s:
            self._pump(min(_POLL_S, timeout_s))
            while self._replies:
                reply = self._replies.popleft()
                if reply.content.get("re") == name:
                    return reply
        return None

    def _pump(self, timeout_s: float) -> None:
        frames = self._decoder.feed(self._link.read(timeout_s))
        if frames:
            self._heard_s = self.now_s()
        for frame in frames:
            if not isinstance(frame, Note):
                self._take(self._clock.timed(frame))

    def _take(self, frame: Frame) -> None:
        if not isinstance(frame, Text):
            self._resuming = False
            self._frames.append(frame)
        elif "log" in frame.content:
            self.log.append(frame.content)
        else:
            self._replies.append(frame)
