"""A link to a published board: receives its frames, and queries its publisher."""

from contextlib import suppress

from spots.errors import ClosedError, PortError, PortLostError
from spots.link.link import ReplyingLink
from spots.link.replies import decoded

from .mailbox import Mailbox
from .optional import zenoh
from .zenoh_session import READ_ONLY, direct, key

# Longest name of a run. A publisher begins a run, with a new name, at its start and at each restart
# of the board.
_RUN_BYTES_MAX = 64
_STREAMS = {"touch", "spectrum", "contact"}
_ERROR_BYTES_MAX = 600  # longer error messages are ignored


class ZenohLink(ReplyingLink):
    """Receives the frames of a published board, and never writes to the board.

    The publisher replies to the commands ``hello``, ``get`` and ``sync``. This link replies to
    ``stream``, which only starts or stops the reception of all published frames, and ends with
    each `reopen`. Other commands are refused. If the publisher disconnects or restarts, or the
    board restarts, `read` raises PortLostError.

    Parameters
    ----------
    session : zenoh.Session
        An open session, which is closed with the link.
    board_id : str
        Id of the board.
    """

    def __init__(self, session: zenoh.Session, board_id: str):
        self.name = f"zenoh:{board_id}"
        self._session, self._id = session, board_id
        self._mail = Mailbox()
        self._alive = True  # the board was found a moment ago
        self._frames: zenoh.Subscriber | None = None
        self._streams: list[str] = []
        self._run: bytes | None = None
        token = key(board_id, "alive")
        self._watch = session.liveliness().declare_subscriber(
            token, direct(self._note), history=True
        )

    def listen(self, on: bool) -> None:
        """Start to receive frames if `on` is true, else stop."""
        if self._frames is not None and not on:
            self._frames.undeclare()
            self._frames = None
            self._mail.clear()
        elif self._frames is None and on:
            frames = key(self._id, "frames")
            self._frames = self._session.declare_subscriber(frames, direct(self._receive))

    def read(self, timeout_s: float) -> bytes:
        """Return the bytes that have arrived; wait up to `timeout_s` seconds for the first one.

        Raises
        ------
        PortLostError
            If the publisher disconnected or restarted, or the board restarted.
        ClosedError
            If this link is closed.
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
        """Query the publisher for the reply to a command that changes nothing.

        Parameters
        ----------
        command : str
            Name of the command, a key of `READ_ONLY`.
        timeout_s : float
            Longest time to wait for the reply, in seconds.

        Returns
        -------
        dict or None
            The reply, or a dict with the key ``error``; None if no valid reply arrives in time.
        """
        selector = key(self._id, READ_ONLY[command])
        for reply in self._session.get(selector, timeout=max(timeout_s, 0.001)):
            if reply.err is None:
                with suppress(ValueError):  # not a SPOTS publisher
                    return decoded(reply.ok.payload)
            # Any peer can send an error, of any length and with any bytes.
            elif len(reply.err.payload) <= _ERROR_BYTES_MAX:
                text = bytes(reply.err.payload).decode(errors="replace")
                if text != "Timeout":  # Zenoh's own error, from this or from the other machine
                    return {"re": command, "error": text}
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
            run, data = self._mail.take()
            if self._run not in (None, run):
                raise PortLostError(
                    f"the board {self.name} or its publisher has restarted: open the board again"
                )
            self._run = run
            pieces.append(data)
        return b"".join(pieces)

    def _receive(self, sample: zenoh.Sample) -> None:
        run = sample.attachment or b""
        if len(run) <= _RUN_BYTES_MAX:
            self._mail.put(bytes(run), sample.payload)

    def _note(self, sample: zenoh.Sample) -> None:
        with self._mail.changed:
            self._alive = sample.kind == zenoh.SampleKind.PUT
            self._mail.changed.notify_all()
