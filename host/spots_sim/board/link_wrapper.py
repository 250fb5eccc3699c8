"""Connections to a board (links) that wrap another link, see `spots.link.link.Link`."""

from __future__ import annotations

from collections.abc import Callable

from spots.link.link import Link


class LinkWrapper:
    """A link that delegates each call to another link; the base class of wrappers.

    Parameters
    ----------
    link : Link
        The link to wrap.
    """

    def __init__(self, link: Link):
        self._link = link

    @property
    def name(self) -> str:
        return self._link.name

    def now_s(self) -> float:
        return self._link.now_s()

    def read(self, timeout_s: float) -> bytes:
        return self._link.read(timeout_s)

    def write(self, data: bytes) -> None:
        self._link.write(data)

    def sleep(self, duration_s: float) -> None:
        self._link.sleep(duration_s)

    def reopen(self) -> None:
        self._link.reopen()

    def close_port(self) -> None:
        self._link.close_port()

    def close(self) -> None:
        self._link.close()


class Tap(LinkWrapper):
    """A wrapper of a link that passes a copy of all received data to a function.

    Parameters
    ----------
    link : Link
        The link to wrap.
    look : callable
        ``look(data, now_s)`` is called after each read, with the received bytes and the time of
        the link's clock in s.
    """

    def __init__(self, link: Link, look: Callable[[bytes, float], None]):
        super().__init__(link)
        self._look = look

    def read(self, timeout_s: float) -> bytes:
        data = self._link.read(timeout_s)
        self._look(data, self.now_s())
        return data
