"""The FIFO of a simulated AS7341: it holds 128 values of two bytes each."""

from __future__ import annotations

from collections.abc import Iterable

_ENTRIES = 128


class Fifo:
    """The values that wait for a read, in `entries`; the oldest is the first."""

    def __init__(self):
        self.entries: list[bytes] = []

    def __len__(self) -> int:
        return len(self.entries)

    def push(self, entries: Iterable[bytes], overwrites: bool) -> bool:
        """Append entries; return whether one was lost.

        If the FIFO is full, it drops its oldest entry if `overwrites`, else the new one.
        """
        lost = False
        for entry in entries:
            if len(self.entries) == _ENTRIES:
                lost = True
                if not overwrites:
                    continue
                del self.entries[0]
            self.entries.append(entry)
        return lost

    def take(self, count: int) -> bytes:
        """Remove up to `count` entries; return their bytes."""
        data = b"".join(self.entries[:count])
        del self.entries[:count]
        return data

    def low(self) -> int:
        """Return the first byte of the oldest entry, which stays; 0 if the FIFO is empty."""
        return self.entries[0][0] if self.entries else 0

    def high(self) -> int:
        """Remove the oldest entry and return its second byte; 0 if the FIFO is empty."""
        return self.entries.pop(0)[1] if self.entries else 0
