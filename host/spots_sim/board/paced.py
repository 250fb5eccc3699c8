"""A virtual board in simulated time that runs at the speed of real time."""

from __future__ import annotations

import time

from .link_wrapper import LinkWrapper
from .lockstep import LockstepLink


class PacedLink(LinkWrapper):
    """A `lockstep.LockstepLink` whose reads and sleeps first wait until real time has caught up.

    `epoch_s` is the value of ``time.monotonic()`` at which the link's clock is 0. The links of a
    linkage's two boards must have the same one.
    """

    def __init__(self, link: LockstepLink, epoch_s: float):
        super().__init__(link)
        self._epoch_s = epoch_s

    def read(self, timeout_s: float) -> bytes:
        """Wait until real time has reached the board's time, then run the board."""
        self._wait()
        return self._link.read(timeout_s)

    def sleep(self, duration_s: float) -> None:
        self._wait()
        self._link.sleep(duration_s)

    def _wait(self) -> None:
        time.sleep(max(self.now_s() - (time.monotonic() - self._epoch_s), 0.0))
