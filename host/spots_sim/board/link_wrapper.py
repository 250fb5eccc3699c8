"""Connections to a board (links) that wrap another link, see `spots.link.link.Link`."""

from __future__ import annotations

from collections.abc import Callable

from spots.link.link import Link


class LinkWrapper:
    """A link that delegates each call to another link; the base class of wrappers."""

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
    """A link that calls ``look(data, now_s)`` after each read; `now_s` is the link's clock."""

    def __init__(self, link: Link, look: Callable[[bytes, float], None]):
        super().__init__(link)
        self._look = look

    def read(self, timeout_s: float) -> bytes:
        data = self._link.read(timeout_s)
        self._look(data, self.now_s())
        return data
