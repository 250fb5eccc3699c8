"""What connects a `Board` to a board, to a publisher on another machine, or to a recording."""

import time
from collections.abc import Iterable, Sequence
from typing import Any, Protocol, runtime_checkable

from .frames import LinkStats, Reading, Text

POLL_S = 0.1  # longest wait in one call of a link


class Link(Protocol):
    """Transports bytes to and from a board, independently of the protocol; `name` is the port's."""

    name: str

    def now_s(self) -> float:
        """Return the host's time in seconds, by the clock of this link."""
        return time.monotonic()

    def read(self, timeout_s: float) -> bytes:
        """Return the bytes that have arrived; wait up to `timeout_s` seconds for the first."""
        ...

    def write(self, data: bytes) -> None:
        """Send bytes to the board."""

    def sleep(self, duration_s: float) -> None:
        """Wait for `duration_s` seconds by the clock of `now_s`."""
        time.sleep(duration_s)

    def reopen(self) -> None:
        """Open the port again. A link that never raises PortLostError need not implement this.

        RefusedError if another device now has the port's name, and the board is on no other port;
        PortError if the port does not exist or cannot be opened.
        """

    def close_port(self) -> None:
        """Close the port until `reopen`; needed only in a link that raises PortLostError."""

    def close(self) -> None:
        """Close the port permanently."""


@runtime_checkable
class ReplyingLink(Link, Protocol):
    """A link that replies to commands itself; nothing is written to it, so it is read-only."""

    def reply(self, line: str, timeout_s: float) -> dict[str, Any] | None:
        """Return the reply to a command, as docs/extend/commands.md has it; None after a timeout.

        The reply of a refused command has the key ``error``. SpotsError if this link can say better
        than the board why it refuses the command.
        """
        ...


@runtime_checkable
class FrameLink(ReplyingLink, Protocol):
    """A link that delivers decoded frames with their times, in place of bytes: a recording.

    `info` is the reply to ``hello``; the calibration is that of sensor 0. `stats` are those up to
    the latest frame. `doubts` are sentences about what is wrong with the delivered frames. After
    `ended`, no more frames will come. `poll_s` is the longest wait in one call of `frames`, by the
    clock of this link.
    """

    info: Any
    calibration: list[str] | None
    poll_s: float

    @property
    def stats(self) -> LinkStats: ...
    @property
    def doubts(self) -> Sequence[str]: ...
    @property
    def ended(self) -> bool: ...
    def frames(self, timeout_s: float) -> Iterable[Reading | Text]:
        """Yield the frames that have arrived; wait up to `timeout_s` seconds for the first."""
        ...
