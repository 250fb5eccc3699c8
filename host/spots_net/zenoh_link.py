"""A link to a published board: receives its frames, and queries its publisher."""

import secrets
import time
from contextlib import suppress

from spots.errors import ClosedError, PortError, PortLostError
from spots.link.link import ReplyingLink
from spots.link.replies import decoded

from .mailbox import Mailbox
from .optional import zenoh
from .ros2.naming import (
    GID_BYTES,
    Attachment,
    frames_topic,
    gid_of,
    service_name,
    short_name,
    unpacked,
)
from .ros2.types import EMPTY, FRAME, REPLY, service, store, topic
from .zenoh_session import READ_ONLY, direct

_STREAMS = {"touch", "spectrum", "contact"}
_ERROR_BYTES_MAX = 600  # longer error messages are ignored
_REPLY_BYTES_MAX = 1 << 13  # a longer response is no reply of a board
_TOKENS_S = 3.0  # longest wait for the tokens of a board
_PUBLISHERS_MAX = 1000  # of one board; anyone may declare more tokens


class ZenohLink(ReplyingLink):
    """Receives the frames of a published board, and never writes to the board.

    The frames are messages ``spots_msgs/Frame`` of ROS 2. The publisher replies to the commands
    ``hello``, ``get`` and ``sync``. This link replies to ``stream``, which only starts or stops the
    reception of all published frames, and ends with each `reopen`. Other commands are refused. If
    the publisher disconnects or restarts, or the board restarts, `read` raises PortLostError. The
    session is closed with the link.
    """

    def __init__(self, session: zenoh.Session, node: str, domain: int):
        self.name = f"zenoh:{short_name(node)}"
        self._session, self._node, self._domain = session, node, domain
        self._topic = topic(frames_topic(node), FRAME)
        self._mail = Mailbox()
        self._publishers: set[bytes] = set()  # ids of those that have a token
        self._alive = True  # the board was found a moment ago
        self._frames: zenoh.Subscriber | None = None
        self._streams: list[str] = []
        # A run has one publisher and no restart of the board.
        self._run: tuple[bytes, int] | None = None
        self._gid, self._asked = secrets.token_bytes(GID_BYTES), 0
        self._watch = session.liveliness().declare_subscriber(
            self._topic.tokens(domain, node), direct(self._note), history=True
        )

    def listen(self, on: bool) -> None:
        """Start to receive frames if `on` is true, else stop."""
        if self._frames is not None and not on:
            self._frames.undeclare()
            self._frames = None
            self._mail.clear()
        elif self._frames is None and on:
            # Not only by `_note`, because frames whose publisher is unknown are ignored.
            tokens = self._topic.tokens(self._domain, self._node)
            for reply in self._session.liveliness().get(tokens, timeout=_TOKENS_S):
                if reply.ok is not None:
                    self._note(reply.ok)
            self._frames = self._session.declare_subscriber(
                self._topic.key(self._domain), direct(self._receive)
            )

    def read(self, timeout_s: float) -> bytes:
        """Return the bytes that have arrived; wait up to `timeout_s` seconds for the first one.

        PortLostError if the publisher disconnected or restarted, or the board restarted;
        ClosedError if this link is closed.
        """
        mail = self._mail
        with mail.changed:
            mail.changed.wait_for(lambda: mail or not self._alive, timeout_s)
            if mail:
                return self._whole_run()
        if self._session.is_closed():
            raise ClosedError(f"the board {self.name} is closed: open it again")
        if not self._alive:
            raise PortLostError(self._gone())
        return b""

    def close_port(self) -> None:
        self._stream(["off"])

    def reopen(self) -> None:
        """Prepare for another ``stream``; raise PortError if the board is not published."""
        self._stream(["off"])
        self._run = None
        if not self._alive:
            raise PortError(self._gone())

    def write(self, data: bytes) -> None:
        """Ignore the data, because nothing is written to a remote board; see `reply`."""

    def reply(self, line: str, timeout_s: float) -> dict | None:
        name, *words = line.split()
        sensor = [word for word in words if word.startswith("sensor=")]
        if name == "stream":
            # The words sensor=N have no effect: a publisher sends the frames of all sensors.
            return self._stream([word for word in words if word not in sensor])
        if sensor:
            return {
                "error": "a remote board replies only for sensor 0: leave sensor= out",
                "why": "no_sensor",
            }
        if name not in READ_ONLY:
            return {
                "error": "a remote board is read-only: send the command on its machine",
                "why": "not_here",
            }
        reply = self.ask(name, timeout_s)
        if reply is not None and name == "hello" and "error" in reply:
            raise PortError(
                f"the board {self.name} does not answer 'hello'; its publisher reports: "
                f"{reply['error']}"
            )
        if reply is not None and name == "sync":
            if not isinstance(reply.get("t_us"), int):
                return None  # the board is disconnected, or no SPOTS publisher has replied
            reply["stream"] = self._streams
        return reply

    def _stream(self, words: list[str]) -> dict:
        kinds = sorted(set(words))
        if not kinds or (kinds != ["off"] and set(kinds) - _STREAMS):
            return {
                "error": "the arguments of stream are touch, spectrum, contact, or off",
                "why": "bad_value",
            }
        self._streams = kinds if kinds != ["off"] else []
        self.listen(bool(self._streams))
        return {"stream": kinds}

    def ask(self, command: str, timeout_s: float) -> dict | None:
        """Query the publisher for the reply to a command of `READ_ONLY`.

        The reply of a refused command has the key ``error``. None if no valid reply arrives in
        time.
        """
        self._asked += 1
        mark = Attachment(self._asked, time.time_ns(), self._gid)
        replies = self._session.get(
            service(service_name(self._node, command)).key(self._domain),
            payload=EMPTY,
            encoding=zenoh.Encoding.APPLICATION_CDR,
            attachment=mark.packed(),
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=max(timeout_s, 0.001),
        )
        for reply in replies:
            # Any peer can send a reply or an error, of any length and with any bytes.
            if reply.ok is not None and len(reply.ok.payload) <= _REPLY_BYTES_MAX:
                with suppress(Exception):  # not a SPOTS publisher
                    return _content(command, bytes(reply.ok.payload))
        return None

    def close(self) -> None:
        """Close the Zenoh session."""
        self._alive = False
        self._session.close()

    def _gone(self) -> str:
        return (
            f"the board {self.name} is no longer published: run 'spots publish' on the machine of "
            "the board"
        )

    def _whole_run(self) -> bytes:
        # All waiting messages together: decoding then costs less, and a live view lags less.
        pieces = []
        while self._mail:
            gid, data = self._mail.take()
            try:
                message = store().deserialize_cdr(data, FRAME)
            except Exception:  # the parser raises exceptions of several kinds
                continue
            run = gid, message.restarts
            if self._run not in (None, run):
                raise PortLostError(
                    f"the board {self.name} or its publisher has restarted: open the board again"
                )
            self._run = run
            pieces.append(message.data.tobytes())
        return b"".join(pieces)

    def _receive(self, sample: zenoh.Sample) -> None:
        # Anyone may publish anything under this key. Only publishers with a token count.
        mark = unpacked(sample.attachment)
        if mark is not None and mark.gid in self._publishers:
            self._mail.put(mark.gid, sample.payload)

    def _note(self, sample: zenoh.Sample) -> None:
        gid = gid_of(str(sample.key_expr))
        with self._mail.changed:
            if sample.kind != zenoh.SampleKind.PUT:
                self._publishers.discard(gid)
            elif len(self._publishers) < _PUBLISHERS_MAX:
                self._publishers.add(gid)
            self._alive = bool(self._publishers)
            self._mail.changed.notify_all()


def _content(command: str, data: bytes) -> dict:
    """Return the board's reply in the response of a service, or a dict with the key ``error``.

    An invalid response raises exceptions of several kinds, from the parser.
    """
    response = store().deserialize_cdr(data, REPLY)
    content = decoded(response.message.encode())
    if response.success:
        return content
    error, why = content["error"], content.get("why", "")
    if len(error) > _ERROR_BYTES_MAX:
        raise ValueError("the error is too long")
    return {"re": command, "error": error, "why": why}
