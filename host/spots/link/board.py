"""A board that one can talk to."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from importlib.metadata import entry_points
from pathlib import Path

import msgspec

from spots_device import PROTOCOL
from spots_device.command import LINE_MAX, NAME_MAX
from spots_device.decode import DROPPED

from ..errors import PortLostError, RefusedError, SpotsError
from .clocksync import GOLDEN, SPREAD_S, TRIPS, ClockSync
from .frames import Decoder, Frame, Key, LinkStats, Note, Text, Touch
from .replies import made_sure
from .serial_link import Link, Tap
from .timeouts import ANSWER_S, CONNECTED, PATIENCE_S, WHO_S, WHO_TRIES, LinkLoss

# Commands whose reply comes when the work is done; the others answer at once.
_REPLY_S = {"auto": 120.0, "dark": 30.0, "save": 10.0}
_USUAL_REPLY_S = 2.0
_HELLO_TIMEOUT_S = 1.0
_HELLO_TRIES = 3
_POLL_S = 0.1
_SYNC_TIMEOUT_S = 0.5
_SYNC_TRIES = 4
_STREAM_TRIES = 3
# A consumer that falls behind by more than this many frames loses the oldest.
_QUEUE_FRAMES = 1 << 16


class Board:
    """A connected board. Close it, or use it in a ``with`` block.

    A board that restarts (a brown-out, a crash) has forgotten that it was streaming, and its port
    may go away for a while and come back under another name. `frames` and what builds on it open
    it again, notice the silence, ask, and tell it again; see `state` and `stats.restarts`. Another
    board in its place is refused.

    Parameters
    ----------
    link : serial_link.Link
        Taken over; closed with the board.

    Attributes
    ----------
    info : dict
        The board's answer to ``hello``.
    log : collections.deque of dict
        Its last log lines.
    patience_s : float
        How long its port may be away while it streams, before `frames` raises PortLostError.
    calibration : list of str or None
        The lines of its calibration, where it got them from this object: a board tells only
        their checksum.
    read_only : bool
        Whether `command` can change nothing: of recordings, and of boards on other machines.
    ended : bool
        Whether nothing will come any more, ever: of recordings.

    Raises
    ------
    SpotsError
        If nothing answers, or the answer is not that of a board of this protocol version.
    """

    read_only = False
    ended = False
    _poll_s = _POLL_S

    def __init__(self, link: Link):
        self._link = link
        self._decoder = Decoder()
        self._clocks = ClockSync()
        self._frames: deque[Frame] = deque(maxlen=_QUEUE_FRAMES)
        self._replies: deque[Text] = deque(maxlen=64)
        self._streams: list[str] = []  # what the board was told to stream
        self._loss = LinkLoss(link.now_s())
        self._resuming = False
        self._missing = False  # frames before the next one were dropped here
        self._on_close: Callable[[], None] | None = None
        self._on_state: Callable[[str], None] | None = None
        self._told_state = CONNECTED
        self.calibration: list[str] | None = None
        self.log: deque[dict] = deque(maxlen=100)
        self.patience_s = PATIENCE_S
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
    def state(self) -> str:
        """``connected``, or why nothing comes.

        ``stalled``: the port is there and the board, or its sensor, is silent; ``lost``: the port
        is away and looked for; ``refused``: another board is in its place.
        """
        return self._loss.state(self.now_s())

    def silent(self, least_s: float) -> bool:
        """Return whether readings are streamed and none has come for so long.

        Parameters
        ----------
        least_s : float
            By the clock of the link; on a slow board the time of three readings, if that is more.
        """
        return self._loss.silent(self.now_s(), least_s)

    @property
    def drift_ppm(self) -> float:
        """How much faster its clock runs than the host's, known after a minute of readings."""
        return self._clocks.clock.drift_ppm

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
        content = self._made_sure(reply)
        if content["re"] == "stream":
            self._streams = [kind for kind in content["stream"] if kind != "off"]
            self._loss.expect(*[self.now_s()] * bool(self._streams))
        if "exposure_us" in content:
            self._take_settings(content)
        return content

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
                yield self._next_frame()
            if end_s is not None and self.now_s() >= end_s:
                return
            left_s = self._poll_s if end_s is None else min(self._poll_s, end_s - self.now_s())
            self._pump_or_resume(max(left_s, 0))
            self._tell_state()

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
        self._pump_or_resume(0)
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

    def record(self, path: str | Path, *, rotate_bytes: int | None = None):
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
        recording.recorder.Recorder
            Ends the recording when stopped, at the end of its ``with`` block, or with the board.

        Raises
        ------
        SpotsError
            If there is such a file, or it cannot be written.
        """
        info = self.command("hello")

        def describe() -> dict:
            return {
                "info": info,
                "clock": self._clocks.clock.state(),
                "calibration": self.calibration,
                "restarts": self.stats.restarts,
            }

        (entry,) = entry_points(group="spots.recorders", name="file")
        recorder = entry.load()(
            self._link, path, describe, begun=self._decoder.pending, rotate_bytes=rotate_bytes
        )
        self._link = recorder
        return recorder

    def tap(self, look: Callable[[bytes, float], None]) -> None:
        """Show ``look(data, now_s)`` all that is read from now on."""
        self._link = Tap(self._link, look)

    def when_closed(self, action: Callable[[], None]) -> None:
        """Do something after the port was let go."""
        self._on_close = action

    def when_state_changes(self, action: Callable[[str], None]) -> None:
        """Tell ``action(state)`` from now on, while frames are waited for; see `state`."""
        self._on_state = action

    def _connect(self) -> None:
        self.info = self._hello()
        self._take_settings(self.info)
        self._map_clocks()
        # Of a stream that an earlier program did not end: their times were not known yet.
        self._frames.clear()

    def _hello(self) -> dict:
        self._link.write(b"\n")  # ends whatever half a line an earlier program left
        for _ in range(_HELLO_TRIES):
            reply = self._exchange("hello", _HELLO_TIMEOUT_S)
            if reply is not None:
                break
        info = self._checked(reply)
        # What came before the reply may have begun in the middle of a frame.
        self._decoder.stats.lost = self._decoder.stats.bad_crc = 0
        return info

    def _checked(self, reply: Text | None) -> dict:
        if reply is None:
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
        return self._made_sure(reply)

    def _made_sure(self, reply: Text) -> dict:
        name = reply.content["re"]
        try:
            return made_sure(name, reply.content)
        except msgspec.ValidationError as error:
            raise SpotsError(
                f"the board on {self.port} is none of ours: its reply to '{name}' tells: {error}"
            ) from None

    def _take_settings(self, told: dict) -> None:
        self._loss.every_s = told["exposure_us"] * told["average"] * 1e-6

    def _map_clocks(self) -> None:
        for i in range(TRIPS):
            self._idle(i * GOLDEN % 1 * SPREAD_S)
            self._sync()
        self._clocks.keep(self.now_s())

    def _sync(self) -> None:
        for tries_left in reversed(range(_SYNC_TRIES)):
            sent_s = self.now_s()
            try:
                reply = self.command("sync", _SYNC_TIMEOUT_S)
            except SpotsError:
                if not tries_left:
                    raise
                # It answers in order: a reply that is only late is not taken for the next one.
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
            self._loss.unplug(self.now_s())

    def _tell_state(self) -> None:
        state = self.state
        if state != self._told_state:
            self._told_state = state
            if self._on_state:
                self._on_state(state)

    def _ask_time(self) -> None:
        if question := self._clocks.ask(self.now_s()):
            self._link.write(question)

    def _reconnect(self, timeout_s: float) -> None:
        # A try, no more: who holds keys down has to be back in time to release them.
        loss = self._loss
        wait_s = loss.reopen_s - self.now_s()
        if wait_s > 0:
            self._link.sleep(min(timeout_s, wait_s))
            return
        try:
            if not loss.is_open:
                self._link.reopen()
                loss.reopened()
                self._decoder.feed(b"\0")  # the frame that was cut off ends here
            reply = self._exchange("hello", WHO_S)
            loss.asked += 1
            if reply is None and loss.asked < WHO_TRIES:
                return  # its firmware may be starting
            self.info = self._recognised(self._checked(reply))
            self._take_settings(self.info)
        except SpotsError as error:
            if loss.unplugged_for_s(self.now_s()) >= self.patience_s:
                raise
            if loss.look_later(self.now_s(), isinstance(error, RefusedError)):  # once, not a flood
                self.log.append({"log": "error", "text": str(error)})
            return
        loss.plug(self.now_s())

    def _recognised(self, info: dict) -> dict:
        if info.get("id") != self.info.get("id"):
            self._link.let_go()
            raise RefusedError(
                f"the board on {self.port} is {info.get('id')} and not {self.info.get('id')}, "
                "which is waited for: plug that one in again"
            )
        return info

    def _resume(self) -> None:
        # Ask a board that is silent what it streams; if that is nothing, it has begun anew.
        loss = self._loss
        if self.now_s() < loss.ask_s:
            return
        loss.asking(self.now_s())
        reply = self._exchange("sync", ANSWER_S)
        if reply is None:
            loss.unanswered(self.now_s())
            return  # nobody there, or damaged
        told = self._made_sure(reply)
        if told["stream"] != []:
            return  # it has no news, or its firmware does not tell
        if not self._resuming:
            # Which question it answers nobody knows, but none before the first one.
            self._begin_anew(loss.first_asked_s, told["t_us"])
        for _ in range(_STREAM_TRIES):
            try:
                self.command("stream " + " ".join(self._streams), ANSWER_S)
                return
            except SpotsError:
                loss.ask_s = self.now_s()  # damaged, either way

    def _begin_anew(self, sent_s: float, t_us: int) -> None:
        self._resuming = bool(self._streams)
        self.stats.restarts += 1
        self._decoder.restarted(self.stats.restarts)
        self._clocks.begin_anew(sent_s, t_us, self.now_s())
        self._loss.ask_s = self.now_s()

    def _idle(self, seconds: float) -> None:
        end_s = self.now_s() + seconds
        while self.now_s() < end_s:
            self._pump(end_s - self.now_s())

    def _exchange(self, line: str, timeout_s: float) -> Text | None:
        name = line.split()[0][:NAME_MAX]
        self._replies.clear()
        self._link.write(line.encode() + b"\n")
        sent_s = self.now_s()
        end_s = sent_s + timeout_s
        while self.now_s() < end_s:
            self._pump(min(_POLL_S, timeout_s))
            while self._replies:
                reply = self._replies.popleft()
                if reply.content.get("re") == name:
                    if self._clocks.clock.began_anew(sent_s, reply.t_us, self.now_s()):
                        self._begin_anew(sent_s, reply.t_us)
                    return reply
        return None

    def _pump(self, timeout_s: float) -> None:
        frames = self._decoder.feed(self._link.read(timeout_s))
        arrived_s = self.now_s()
        if frames:
            self._loss.heard(arrived_s)
        for frame in frames:
            if not isinstance(frame, Note):
                self._take(self._clocks.clock.timed(frame, arrived_s))
        self._clocks.learn()

    def _take(self, frame: Frame) -> None:
        if not isinstance(frame, Text):
            self._take_reading(frame)
        elif "log" in frame.content:
            self.log.append(frame.content)
        else:
            if frame.content.get("re") == "sync":
                self._clocks.answered(frame.t_us, self.now_s())
            self._replies.append(frame)

    def _take_reading(self, frame: Frame) -> None:
        if self._loss.unplugged:
            return  # nobody knows yet whose it is
        self._resuming = False
        self._loss.expect(self.now_s())
        if len(self._frames) == self._frames.maxlen:
            self.stats.overrun += 1
            self._missing = True
        self._frames.append(frame)

    def _next_frame(self) -> Frame:
        frame = self._frames.popleft()
        if self._missing and not isinstance(frame, Key):
            self._missing = False
            return frame._replace(flags=frame.flags | DROPPED)
        return frame
