"""Connects to a board, and again after it was unplugged or has restarted."""

from typing import Any, cast

from spots_device import PROTOCOL

from ..errors import BoardError, PortError, PortLostError, RefusedError, SpotsError
from .board_errors import reason_of
from .channel import Channel
from .clocksync import TRIPS, spread_s
from .commands import HELLO_TIMEOUT_S, Commands
from .frames import Text
from .lines import of_sensor
from .replies import Hello
from .timeouts import ANSWER_S, CONNECTED, PATIENCE_S, WHO_S, WHO_TRIES

_HELLO_TRIES = 3
# Ctrl-B leaves the raw prompt of Python, which prints nothing. To the firmware, Ctrl-B is part of
# an unknown command.
_LEAVE_RAW_PROMPT = b"\x02"
_PROMPT_S = 0.3
_SYNC_TIMEOUT_S = 0.5
_SYNC_TRIES = 4
_STREAM_TRIES = 3  # attempts to resume the streams after a restart


class Connection:
    """Identifies the board on a channel, and resumes its streams when they stop.

    A streaming board may be unplugged for `patience_s` before PortLostError is raised. At each
    change of `state`, the functions in `on_state` are called with it.
    """

    def __init__(self, channel: Channel, commands: Commands):
        self._channel, self._commands = channel, commands
        self.on_state: list[Any] = []
        self._reported_state = CONNECTED
        self.patience_s = PATIENCE_S

    @property
    def state(self) -> str:
        """State of the connection, see `Board.state`."""
        channel = self._channel
        return "closed" if channel.closed else channel.loss.state(channel.now_s())

    def open(self) -> None:
        """Identify the board, and map its clock to the host's clock.

        SpotsError if no board answers, or it has another protocol version than this program.
        """
        channel = self._channel
        channel.info = self._hello() if channel.player is None else channel.player.info
        self._commands.take_settings(channel.info)
        if channel.player is None:
            self._map_clocks()

    def advance(self, timeout_s: float) -> None:
        """Take what arrives within a time; look after a board that is silent or unplugged.

        SpotsError if the board is lost for longer than `patience_s`.
        """
        self._pump_or_resume(timeout_s)
        state = self.state
        if state != self._reported_state:
            self._reported_state = state
            for action in list(self.on_state):
                action(state)

    def _hello(self) -> Hello:
        channel = self._channel
        channel.link.write(b"\n")  # an earlier program may have sent a part of a line
        replies = (channel.exchange("hello", HELLO_TIMEOUT_S) for _ in range(_HELLO_TRIES))
        reply = next(filter(None, replies), None)
        if reply is None:
            channel.link.write(_LEAVE_RAW_PROMPT)
            end_s = channel.now_s() + _PROMPT_S
            while not channel.at_prompt and (left_s := end_s - channel.now_s()) > 0:
                channel.pump(left_s)
        info = self._checked(reply)
        self._commands.late = False
        # The bytes before the reply may start in the middle of a frame: that is no loss.
        channel.decoder.stats.lost = channel.decoder.stats.bad_crc = 0
        return info

    def _checked(self, reply: Text | None) -> Hello:
        port, only = self._channel.port, self._channel.only
        if reply is None:
            self._channel.check_prompt()
            raise PortError(
                f"the device on {port} does not answer 'hello': it is not a SPOTS board, or "
                "its firmware does not run; press its reset button, name another port, or flash "
                "the board"
            )
        if refusal := reply.content.get("error"):
            why = reason_of(reply.content)
            if only and why in ("", "no_sensor"):
                raise PortError(
                    f"the board on {port} has no strip {only}: leave out #{only}, or write the "
                    "number of another strip"
                )
            raise BoardError(f"the board on {port} refuses 'hello': {refusal}", why)
        version = reply.content.get("protocol")
        if version != PROTOCOL:
            raise PortError(
                f"the board on {port} has protocol {version}, but the program has {PROTOCOL}: "
                "update the firmware or the program, whichever is older"
            )
        return cast("Hello", self._commands.validated(reply))

    def _map_clocks(self) -> None:
        channel = self._channel
        for i in range(TRIPS):
            end_s = channel.now_s() + spread_s(i)
            while channel.now_s() < end_s:
                channel.pump(end_s - channel.now_s())
            self._sync()
        channel.clocks.keep(channel.now_s())

    def _sync(self) -> None:
        channel = self._channel
        for tries_left in reversed(range(_SYNC_TRIES)):
            sent_s = channel.now_s()
            try:
                reply = self._commands.send("sync", _SYNC_TIMEOUT_S)
            except SpotsError:
                if not tries_left:
                    raise
                # A late reply comes before the reply to `hello`, and is dropped.
                self._hello()
            else:
                channel.clocks.clock.round_trip(sent_s, reply["t_us"], channel.now_s())
                return

    def _pump_or_resume(self, timeout_s: float) -> None:
        channel = self._channel
        if channel.loss.unplugged:
            self._reconnect(timeout_s)
            return
        try:
            if not channel.wanted or channel.player is not None:
                channel.pump(timeout_s)
                return
            due_s = min(channel.loss.ask_s, channel.clocks.due_s)
            channel.pump(min(timeout_s, due_s - channel.now_s()))
            self._resume()
            self._ask_time()
        except PortLostError:
            if not channel.wanted:
                raise
            channel.newest.forget()
            channel.loss.unplug(channel.now_s())

    def _ask_time(self) -> None:
        channel = self._channel
        question = channel.clocks.ask(channel.now_s())
        # A link that replies itself blocks until the reply is there: no query between readings.
        if question and channel.replying is None:
            channel.link.write(question)

    def _reconnect(self, timeout_s: float) -> None:
        # Only one attempt in each call: an application must return in time to release its keys.
        channel, loss = self._channel, self._channel.loss
        wait_s = loss.reopen_s - channel.now_s()
        if wait_s > 0:
            channel.link.sleep(min(timeout_s, wait_s))
            return
        try:
            if not loss.is_open:
                channel.link.reopen()
                loss.reopened()
                channel.decoded(b"\0")  # ends the frame that the disconnect cut off
            reply = channel.exchange("hello", WHO_S)
            loss.tries += 1
            if reply is None and loss.tries < WHO_TRIES:
                return  # the board's firmware may be starting
            info, known = self._checked(reply), channel.info.get("id")
            if info.get("id") != known:
                channel.link.close_port()
                raise RefusedError(
                    f"{channel.port} now has board {info.get('id')} instead of {known}: plug in "
                    f"board {known} again"
                )
            channel.info = info
            self._commands.take_settings(info)
        except SpotsError as error:
            if (lost_s := loss.unplugged_for_s(channel.now_s())) >= self.patience_s:
                if isinstance(error, PortLostError):
                    raise PortLostError(
                        f"{error}; it has been unplugged for {lost_s:.0f} s"
                    ) from None
                raise
            if loss.look_later(channel.now_s(), isinstance(error, RefusedError)):
                channel.log.append({"log": "error", "text": str(error)})
            return
        loss.plug(channel.now_s())

    def _resume(self) -> None:
        # Ask a silent board for its streams. A board without streams has restarted.
        channel, loss = self._channel, self._channel.loss
        if channel.now_s() < loss.ask_s:
            return
        loss.asking(channel.now_s())
        reply = channel.exchange("sync", ANSWER_S)
        if reply is None:
            loss.unanswered(channel.now_s())
            return
        known = self._commands.validated(reply)
        if known["stream"] != [] and not channel.stopped:
            return  # the board still streams, or its firmware does not report its streams
        if not channel.stopped:
            # This reply may belong to any query since the first one.
            channel.restarted(loss.first_asked_s, known["t_us"])
        for _ in range(_STREAM_TRIES):
            try:
                for sensor in sorted(channel.stopped):
                    kinds = " ".join(channel.wanted[sensor])
                    self._commands.send(of_sensor("stream " + kinds, sensor), ANSWER_S)
                return
            except SpotsError:
                loss.ask_s = channel.now_s()  # the command or its reply was damaged
