"""Unpacks a sample from the bytes of a transfer, in portable Python; see burst_viper.py."""

from .smux import CHANNELS


def unpack(burst, counts, at):
    """Copy six little-endian counts from `burst`, byte `at` onwards; return the largest count."""
    for i in range(CHANNELS):
        counts[i] = burst[at] | burst[at + 1] << 8
        at += 2
    return max(counts)
