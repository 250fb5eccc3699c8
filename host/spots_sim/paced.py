"""A virtual board in simulated time that runs at the speed of real time."""

from __future__ import annotations

import time

from .link_wrapper import LinkWrapper
from .lockstep import LockstepLink


class PacedLink(LinkWrapper):
    """A `lockstep.LockstepLink` that never runs ahead of real time.

    Links with the same epoch have one clock: two boards can be parts of one machine.

    Parameters
    ----------
    link : LockstepLink
    epoch_s : float
        Of ``time.monotonic()``, when the link's clock was or would have been at 0.
    """

    def __init__(self, link: LockstepLink, epoch_s: float):
        super().__init__(link)
        self._epoch_s = epoch_s

    def read(self, timeout_s: float) -> bytes:
        """Wait until real time has reached the board's time, then let it run."""
        self._wait()
        return self._link.read(timeout_s)

    def sleep(self, duration_s: float) -> None:
        self._wait()
        self._link.sleep(duration_s)

    def _wait(self) -> None:
        time.sleep(max(self.now_s() - (time.monotonic() - self._epoch_s), 0.0))
