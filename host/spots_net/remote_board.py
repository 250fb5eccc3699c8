"""The class `Remote`: a board on another machine, which is read over Zenoh."""

from spots.errors import SpotsError
from spots.link.board import Board
from spots.link.frames import Text

from .zenoh_link import ZenohLink
from .zenoh_session import READ_ONLY, find, open_session

_STREAMS = {"touch", "spectrum", "contact"}


class Remote(Board):
    """A board that another machine publishes; programs read this object like any other board.

    The publisher replies to the commands ``hello``, ``get`` and ``sync``. This object replies to
    ``stream``, which only starts or stops the reception of all published frames. Other commands are
    refused.

    Parameters
    ----------
    link : ZenohLink
        Link to the publisher.
    """

    read_only = True

    def __init__(self, link: ZenohLink):
        self._far = link
        self._listening: list[str] = []
        super().__init__(link)

    def _exchange(self, line: str, timeout_s: float) -> Text | None:
        name, *words = line.split()
        sensor = [word for word in words if word.startswith("sensor=")]
        if name == "stream":
            # The words sensor=N have no effect: a publisher sends the frames of all sensors.
            reply = self._stream([word for word in words if word not in sensor])
        elif sensor:
            reply = {"error": "a remote board replies only for sensor 0: leave sensor= out"}
        elif name in READ_ONLY:
            reply = self._far.ask(name, timeout_s)
        else:
            reply = {"error": "a remote board is read-only: send the command on its machine"}
        if reply is None:
            return None
        if name == "hello" and not sensor and "error" in reply:
            raise SpotsError(
                f"the board {self.port} does not answer 'hello'; its publisher reports: "
                f"{reply['error']}"
            )
        if name == "sync":
            if not isinstance(reply.get("t_us"), int):
                return None  # the board is disconnected, or no SPOTS publisher has replied
            reply["stream"] = self._listening
        return Text(0, 0, 0, {**reply, "re": name})

    def _stream(self, words: list[str]) -> dict:
        kinds = sorted(set(words))
        if not kinds or (kinds != ["off"] and set(kinds) - _STREAMS):
            return {"error": "the arguments of stream are touch, spectrum, contact, or off"}
        on = kinds != ["off"]
        if on and not self._listening:
            # Frames sent before the subscription do not count as lost: accept any sequence number.
            self._decoder.forget()
        self._listening = kinds if on else []
        self._far.listen(on)
        return {"stream": kinds}

    def _ask_time(self) -> None:
        # A query blocks until its reply arrives, so no query is sent between readings.
        if self.now_s() >= self._clocks.due_s:
            self._clocks.due_s = float("inf")

    def _reconnect(self, timeout_s: float) -> None:
        self._listening = []  # a board that has restarted has no streams
        super()._reconnect(timeout_s)


def open_port(rest: str, **simulated) -> Remote:
    """Open the port ``zenoh:ID``, a board that is published on Zenoh; see `link.ports`.

    Parameters
    ----------
    rest : str
        Id of the board; empty for the only published board.
    **simulated
        Options that only simulated boards use; ignored.

    Returns
    -------
    Remote

    Raises
    ------
    SpotsError
        If the board is not published, or `rest` is empty and several boards are published.
    """
    session = open_session()
    try:
        link = ZenohLink(session, find(session, rest))
    except BaseException:
        session.close()
        raise
    return Remote(link)
