"""Converts the times of a recording to UTC, also if the computer's clock was set meanwhile."""

from bisect import bisect
from typing import NamedTuple

_SET_S = 1.0  # a larger change of UTC against the host's monotonic clock shows that it was set


class Seen(NamedTuple):
    """The clocks of the host at one moment, in seconds.

    `host_s` is the monotonic clock, which had stood still for `slept_s` while the computer slept.
    """

    host_s: float
    utc_s: float
    slept_s: float


class Utc:
    """UTC of host times; `seen` are the moments that the recorder noted, at least one.

    If the clock was set during the recording, as on a computer without a battery clock, its latest
    time holds for the whole recording.
    """

    def __init__(self, seen: list[Seen]):
        first = seen[0]
        # By how much each one differs from the UTC that the first one lets expect.
        set_s = [
            one.utc_s - first.utc_s - (one.host_s - first.host_s) - (one.slept_s - first.slept_s)
            for one in seen
        ]
        was_set = any(abs(one) > _SET_S for one in set_s)
        self._begun_s = first.utc_s + (set_s[-1] if was_set else 0.0)
        slept = {one.slept_s - first.slept_s: one.host_s for one in reversed(seen)}
        self._slept_s, self._since_s = zip(*reversed(slept.items()))

    def begun_s(self, host_s: float) -> float:
        """Return UTC minus the host time since the first moment, at the time `host_s`."""
        which = max(0, bisect(self._since_s, host_s) - 1)
        return self._begun_s + self._slept_s[which]
