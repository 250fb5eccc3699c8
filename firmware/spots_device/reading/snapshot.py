"""Sends the state of a strip, from which a host computes later readings again from their spectra.

A reading depends on more than its spectrum: on dark frame, baseline, light that sticks, drift,
temperature, and the silicone. A board imports this module when it streams spectra.
docs/extend/protocol.md describes the STATE frame; `spots.recording.replayed_strip` reads it.
"""

from array import array

from .. import const
from . import decode as d
from .kernel import frame

KIND = const(6)  # of a STATE frame
_SINGLE = const(20)  # values that are no arrays


def arrays(strip):
    """Return the arrays in the frame after its single values (tuple); allocates."""
    baseline = strip.baseline
    silicone = strip.decode.compensation
    state = memoryview(strip._reading)  # without what is computed for each reading alone
    return (
        state[: d.COARSE_SUM],
        state[d.SUMS : d.FOUND],
        state[d.STICK : d.BEYOND],
        strip._dark.window,
        baseline._before,
        baseline._after,
        baseline._gap,
        strip._ambient._lamp,
    ) + ((silicone._state,) if silicone else ())


class Snapshot:
    """Sends the state of one strip. `send` allocates nothing.

    Parameters
    ----------
    strip : strip.Strip
        The strip.
    """

    def __init__(self, strip):
        self._strip = strip
        self._single = array("i", bytes(4 * _SINGLE))
        self.follow()

    def follow(self):
        """Find the arrays again, after another calibration is in use."""
        self._arrays = (self._single,) + arrays(self._strip)

    def send(self):
        """Send the state as it is between two samples."""
        strip = self._strip
        self._fill(strip, self._single)
        framer = strip._framer
        at = d.HEADER_SIZE
        i = 0
        while i < len(self._arrays):
            at = _put(framer.payload, at, self._arrays[i])
            i += 1
        # As `frame.Framer._send_body`, with fewer nested calls.
        head = framer._head
        head[d.KIND] = KIND | strip.index << 4
        gap = head[d.GAP]
        if framer.send(frame(head, framer.payload, at, framer.encoded)):
            head[d.GAP] = gap

    def _fill(self, strip, v):
        v[0] = strip._state
        v[1] = strip.lit_flags
        v[2] = int(strip._tare_wanted)
        v[3] = strip.sensor.gain
        v[4] = strip.sensor.led_mA
        values = strip.settings.values
        v[5] = values["strain_ppm"]
        v[6] = strip._heat_mC
        # Keys and contacts mark the readings of two fingers.
        v[7] = int(bool(strip._outputs.streams_contacts or values["keys"]))
        part = strip._dark
        v[8] = part.count
        v[9] = part.changing
        v[10] = part._last
        v[11] = part._every
        part = strip.baseline
        v[12] = part._count
        v[13] = part.left
        part = strip._ambient
        v[14] = part._total
        v[15] = part._moved
        v[16] = int(part._is_contradicted)
        part = strip.decode.compensation
        if part:
            v[17] = part._t
            v[18] = part._x_um
            v[19] = part._force


def _put(payload, at, words):
    # As little-endian integers of 32 bits; return the index after them.
    i = 0
    while i < len(words):
        value = words[i]
        i += 1
        end = at + 4
        while at < end:
            payload[at] = value & 0xFF
            value >>= 8
            at += 1
    return at
