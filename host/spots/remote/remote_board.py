"""A board on another machine."""

from __future__ import annotations

from ..errors import SpotsError
from ..link.board import Board
from ..link.frames import Text
from .zenoh_link import ZenohLink
from .zenoh_session import READ_ONLY, find, open_session

_STREAMS = {"touch", "spectrum"}


class Remote(Board):
    """A board that someone publishes, to be read as any other.

    All that is published comes, whatever is said to be streamed. Of commands ``hello``, ``get``
    and ``sync`` are answered by the publisher and ``stream`` here; all others are refused.

    Parameters
    ----------
    link : ZenohLink
    """

    read_only = True

    def __init__(self, link: ZenohLink):
        self._far = link
        self._listening: list[str] = []
        super().__init__(link)

    def _exchange(self, line: str, timeout_s: float) -> Text | None:
        name, *words = line.split()
        if name == "stream":
            reply = self._stream(words)
        elif name in READ_ONLY:
            reply = self._far.ask(name, timeout_s)
        else:
            reply = {"error": "it is read-only from here; send it where the board is plugged in"}
        if reply is None:
            return None
        if name == "hello" and "error" in reply:
            raise SpotsError(f"the board {self.port} does not answer 'hello': {reply['error']}")
        if name == "sync":
            if not isinstance(reply.get("t_us"), int):
                return None  # its board is away, or it is not a SPOTS publisher
            reply["stream"] = self._listening
        return Text(0, 0, 0, {**reply, "re": name})

    def _stream(self, words: list[str]) -> dict:
        kinds = sorted(set(words))
        if not kinds or (kinds != ["off"] and set(kinds) - _STREAMS):
            return {"error": "stream takes touch, spectrum, both, or off"}
        on = kinds != ["off"]
        if on and not self._listening:
            # What was sent while nobody listened is not lost: any sequence number may be next.
            self._decoder.forget()
        self._listening = kinds if on else []
        self._far.listen(on)
        return {"stream": kinds}

    def _ask_time(self) -> None:
        # Nobody sends it questions beside its readings: each would be waited for.
        if self.now_s() >= self._clocks.due_s:
            self._clocks.due_s = float("inf")

    def _reconnect(self, timeout_s: float) -> None:
        self._listening = []  # as a board that has restarted
        super()._reconnect(timeout_s)


def open_port(rest: str, **simulated) -> Remote:
    """Open the port ``zenoh:ID``, see `link.ports`.

    Parameters
    ----------
    rest : str
        The board's id.
    **simulated
        Options of virtual boards; ignored.

    Returns
    -------
    Remote
    """
    return open_remote(rest)


def open_remote(board_id: str) -> Remote:
    """Open a board that is published on Zenoh.

    Parameters
    ----------
    board_id : str
        Empty for the only one.

    Raises
    ------
    SpotsError
        If it is not published, or there are more and none was named.
    """
    session = open_session()
    try:
        link = ZenohLink(session, find(session, board_id))
    except BaseException:
        session.close()
        raise
    return Remote(link)
