"""Commands to a board and its replies: timeouts, refusals, and what a reply changes."""

from collections.abc import Mapping, Sequence
from numbers import Integral
from typing import Any, cast

import msgspec

from spots_device.board.command import LINE_MAX

from ..errors import BoardError, NoReplyError, PortError, SettingError
from .board_errors import in_words, reason_of
from .channel import Channel
from .frames import Text
from .lines import of_sensor
from .replies import Hello, validated

# Timeouts of replies, in s. These commands reply when their work is done, all others immediately.
# The usual timeout is long, because on a busy computer a simulated board may get no processor time
# for seconds.
_REPLY_S = {"autoexpose": 120.0, "dark": 30.0, "save": 10.0}
_USUAL_REPLY_S = 4.0
HELLO_TIMEOUT_S = 1.0


class Commands:
    """Sends commands over a channel, and validates the replies.

    `late` is whether the reply to an earlier command may still arrive.
    """

    def __init__(self, channel: Channel):
        self._channel = channel
        self.late = False

    def send(self, line: str, timeout_s: float | None = None) -> dict[str, Any]:
        """Send a command and return its reply; see `Board.command`."""
        if not line.strip() or len(line) > LINE_MAX or not (line.isascii() and line.isprintable()):
            raise SettingError(
                f"cannot send {line!r}: a command must have 1 to {LINE_MAX} printable ASCII "
                "characters, not only spaces"
            )
        usual_s = _REPLY_S.get(line.split()[0], _USUAL_REPLY_S)
        if timeout_s is None:
            timeout_s = usual_s
        channel = self._channel
        with channel.turn:
            if self.late:
                # The board replies in order: a late reply comes before the one to `hello`.
                hello_s = min(timeout_s, HELLO_TIMEOUT_S)
                self.late = channel.exchange("hello", hello_s) is None
            reply = channel.exchange(line, timeout_s)
            if reply is None:
                self.late = True
                channel.check_prompt()
                remedy = "replug the board" if timeout_s >= usual_s else f"wait for {usual_s:g} s"
                raise NoReplyError(
                    f"no reply to '{line}' within {timeout_s:g} s from the board on "
                    f"{channel.port}: {remedy}"
                )
            if "error" in reply.content:
                reason = in_words(str(reply.content["error"]))
                raise BoardError(f"the board refuses '{line}': {reason}", reason_of(reply.content))
            content = self.validated(reply)
            self._learn(reply, content)
        return content

    def set(self, settings: Mapping[str, int | Sequence[str]]) -> dict[str, Any]:
        """Change settings of the board; see `Board.set`."""
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
                raise SettingError(f"{name} must be a whole number or a text, not {value!r}")
            if name != "sensor":
                words.append(f"{name}={text}")
        return self.send(
            of_sensor("set " + " ".join(words), cast("int", settings.get("sensor", 0)))
        )

    def validated(self, reply: Text) -> dict[str, Any]:
        """Return the content of a reply; raise PortError if it is invalid."""
        if self._channel.player is not None:
            return reply.content  # the file was validated as a whole
        name = reply.content["re"]
        try:
            return validated(name, reply.content)
        except msgspec.ValidationError as error:
            raise PortError(
                f"the device on {self._channel.port} is not a SPOTS board: its reply to '{name}' "
                f"is invalid ({error}); name another port, or flash the board"
            ) from None

    def take_settings(self, settings: Mapping[str, Any]) -> None:
        """Derive the time between two readings from the settings of sensor 0."""
        if "exposure_us" in settings and "average" in settings:
            exposure_us: float = settings["exposure_us"]
            self._channel.loss.every_s = exposure_us * settings["average"] * 1e-6

    def _learn(self, reply: Text, content: dict[str, Any]) -> None:
        """Record the streams and settings that a reply shows."""
        channel = self._channel
        number = content.get("sensor")
        # To a program that reads one strip only, this strip is sensor 0.
        sensor = number if isinstance(number, int) and channel.only is None else 0
        if content["re"] == "stream":
            channel.wanted.pop(sensor, None)
            channel.stopped.discard(sensor)
            if kinds := [kind for kind in content["stream"] if kind != "off"]:
                channel.wanted[sensor] = kinds
            channel.loss.expect(channel.now_s() if channel.wanted else None)
        if sensor in channel.certainties and "average" in content:
            channel.certainties[sensor].average = content["average"]
        if sensor:
            return
        self.take_settings(content)
        if content["re"] == "hello":
            channel.info = cast("Hello", dict(content))
        elif content["re"] in ("set", "autoexpose"):
            known = {name: reply.content[name] for name in channel.info if name in reply.content}
            channel.info = cast("Hello", {**channel.info, **known, "re": "hello"})
