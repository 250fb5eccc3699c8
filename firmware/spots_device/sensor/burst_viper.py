"""Unpacks a sample in machine code; replaces burst.py on boards with ``viper = true``."""

import micropython

from .smux import CHANNELS


@micropython.viper
def unpack(burst: ptr8, counts: ptr32, at: int) -> int:
    most = 0
    for i in range(CHANNELS):
        count = burst[at] | burst[at + 1] << 8
        at += 2
        counts[i] = count
        if count > most:
            most = count
    return most
