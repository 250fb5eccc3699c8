"""Turns the bytes of a link into frames and replies, and commands into bytes."""

from collections import deque
from collections.abc import Callable
from typing import Any

from spots_device.board.command import NAME_MAX

from ..common.certainty import Certainty
from ..errors import AtPromptError, ClosedError
from .board_errors import in_words
from .clocksync import ClockSync
from .decoder import Decoder
from .frames import Frame, Key, LinkStats, Note, Reading, Text, Touch, with_sigma
from .lines import addressed
from .link import POLL_S, FrameLink, Link, ReplyingLink
from .newest import Newest
from .readers import FrameLog
from .replies import Hello
from .timeouts import LinkLoss
from .turn import Turn

# A board at its Python prompt (REPL) prints PROMPT after each line.
PROMPT = b">>> "
_SENSORS_MAX = 16  # the number of the sensor has four bits in a frame
_TAIL_BYTES = 64  # number of latest bytes in which a prompt is looked for


class Channel:
    """Receives the frames of a board, and exchanges commands and replies with it.

    One thread at a time may call the methods: the one that has the `turn`. `only` is the only
    sensor whose frames are taken, as sensor 0. `info` is the reply to ``hello``, with the present
    settings. `wanted` are the streams that should be on, by sensor; `stopped` the sensors whose
    streams ended with a restart of the board. `taps` are called as ``look(data, now_s)`` with all
    bytes before they are decoded. `certainties` give the standard deviations of positions, for each
    sensor with a known calibration. `frames` stores the frames until all readers have taken them.
    """

    info: Hello

    def __init__(self, link: Link, only: int | None = None):
        self.link, self.only = link, only
        self.replying = link if isinstance(link, ReplyingLink) else None
        self.player = link if isinstance(link, FrameLink) else None
        self.turn = Turn()
        self.decoder = Decoder()
        self.clocks = ClockSync()
        self.loss = LinkLoss(link.now_s())
        self.newest = Newest()
        self.frames = FrameLog()
        self.replies: deque[Text] = deque(maxlen=64)
        self.log: deque[dict[str, Any]] = deque(maxlen=100)
        self.taps: list[Callable[..., None]] = []
        self.wanted: dict[int, list[str]] = {}
        self.stopped: set[int] = set()
        self.closed = False
        self.certainties: dict[int, Certainty] = {}
        self._tail = b""  # the latest bytes that have arrived

    @property
    def sensors(self) -> range:
        """Numbers of the board's sensors, from 0."""
        count: Any = self.info.get("sensors") if self.only is None else 1
        return range(count if isinstance(count, int) and 0 < count <= _SENSORS_MAX else 1)

    @property
    def port(self) -> str:
        """Name of the board's port."""
        return self.link.name

    @property
    def stats(self) -> LinkStats:
        """Statistics of the link since the board was opened."""
        return self.decoder.stats if self.player is None else self.player.stats

    @property
    def at_prompt(self) -> bool:
        """Whether the board has just shown the prompt of Python."""
        return PROMPT in self._tail

    def now_s(self) -> float:
        """Return the host's time in seconds, by the clock of the link."""
        return self.link.now_s()

    def check_open(self) -> None:
        """Raise ClosedError if the program has closed the board."""
        if self.closed:
            raise ClosedError(f"the board on {self.port} is closed: open it again")

    def check_prompt(self) -> None:
        """Raise AtPromptError if the device without a reply has shown a Python prompt."""
        if self.at_prompt:
            raise AtPromptError(
                f"the board on {self.port} is at its Python prompt, so its firmware does not run: "
                f"press the board's reset button, or run 'mpremote connect {self.port} resume "
                "reset'; flash the board if it has no firmware yet"
            )

    def exchange(self, line: str, timeout_s: float) -> Text | None:
        """Send a command; return its reply, or None if there was no reply in time."""
        self.check_open()
        name = line.split()[0][:NAME_MAX]
        if self.only:
            line = addressed(line, self.only)
        if self.replying is not None:
            return self._replied(name, self.replying.reply(line, timeout_s))
        self.replies.clear()
        self._tail = b""
        self.link.write(line.encode() + b"\n")
        sent_s, expected = self.now_s(), self.decoder.expected
        end_s = sent_s + timeout_s
        while self.now_s() < end_s:
            self.pump(min(POLL_S, timeout_s))
            while self.replies:
                reply = self.replies.popleft()
                if reply.content.get("re") == name:
                    self._compare(sent_s, reply, reply.sequence == expected)
                    return reply
        return None

    def _compare(self, sent_s: float, reply: Text, continued: bool) -> None:
        """Record that the board has restarted, or the host has slept, if a reply's time shows it.

        `continued` is whether the reply follows the last frame before the command. An idle board
        that has restarted counts its frames from 0; one that streams is asked for its streams.
        """
        ahead_s = self.clocks.clock.ahead_s(sent_s, reply.t_us, self.now_s())
        if not ahead_s:
            return
        if continued or (ahead_s > 0.0 and self.wanted):
            self.clocks.restart(sent_s, reply.t_us, self.now_s(), max(0.0, ahead_s))
        else:
            self.restarted(sent_s, reply.t_us)

    def _replied(self, name: str, content: dict[str, Any] | None) -> Text | None:
        if content is None:
            return None
        if name == "stream":
            # Frames from before the subscription are no loss: accept any sequence number.
            self.decoder.forget()
        return Text(0, 0, 0, {**content, "re": name})

    def pump(self, timeout_s: float) -> None:
        """Take what has arrived; wait up to `timeout_s` seconds for the first bytes.

        A timeout below 0 is 0: a deadline may pass between the caller's look at it and this call.
        """
        timeout_s = max(timeout_s, 0.0)
        self.check_open()
        if self.player is not None:
            for frame in self.player.frames(timeout_s):
                self._take(frame)
            self.turn.wake()
            return
        frames = self.decoded(self.link.read(timeout_s))
        arrived_s = self.now_s()
        for frame in frames:
            # A restarted board sends keys without a stream.
            if not (isinstance(frame, Key) or self.stopped):
                self.loss.heard(arrived_s)
            if not isinstance(frame, Note):
                # While the port is unplugged, a frame may be of another board.
                known = self.loss.unplugged or isinstance(frame, Text)
                self._take(frame if known else self.clocks.clock.timed(frame, arrived_s))
        self.clocks.learn(self.now_s())
        if frames:
            self.turn.wake()

    def decoded(self, data: bytes) -> list[Frame]:
        """Pass bytes to the taps, and return the frames that they complete."""
        if data:
            self._tail = (self._tail + data)[-_TAIL_BYTES:]
            for look in list(self.taps):
                look(data, self.now_s())
        return self.decoder.feed(data)

    def restarted(self, sent_s: float, t_us: int) -> None:
        """Record that the board has restarted: its streams are off, and its clock is a new one.

        The times are those of the query whose reply shows the restart, and of this reply.
        """
        self.stopped = set(self.wanted)
        self.stats.restarts += 1
        self.newest.restart()
        self.decoder.restarted(self.stats.restarts)
        self.clocks.restart(sent_s, t_us, self.now_s())
        self.loss.ask_s = self.now_s()

    def _take(self, frame: Reading | Text) -> None:
        if not isinstance(frame, Text):
            self._take_reading(frame)
        elif "log" in frame.content:
            text = frame.content.get("text")
            words = {"text": in_words(text)} if isinstance(text, str) else {}
            self.log.append(frame.content | words)
        else:
            if frame.content.get("re") == "sync":
                self.clocks.answered(frame.t_us, self.now_s())
                if self.wanted and frame.content.get("stream") == []:  # it has restarted
                    self.loss.ask_s = self.now_s()
            self.replies.append(frame)

    def _take_reading(self, frame: Reading) -> None:
        if self.loss.unplugged:
            return  # the reading may be of another board
        if self.only is not None:
            if frame.sensor != self.only:
                return
            frame = frame._replace(sensor=0)
        if not isinstance(frame, Key):
            self.loss.expect(self.now_s())
        if isinstance(frame, Touch):
            frame = with_sigma(frame, self.certainties)
            self.newest.take(frame)
        self.frames.append(frame, self.stats)
