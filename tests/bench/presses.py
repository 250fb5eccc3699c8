"""Reads counts of presses along a whole strip from a virtual board, with noise."""

from __future__ import annotations

from itertools import islice

import numpy as np

from spots.errors import SpotsError
from spots.link.board import Board
from spots.link.frames import Spectrum
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.files import SensorFile
from spots_sim.strip.scenario import Held, Press

_PLACES = 16
_FORCES_MN = (1500.0, 4000.0)
_WIDTH_MM = 4.0
_SETTLING = 3
_DARK_WINDOW = 16
_LIMIT_S = 60.0  # timeout in simulated time


def counts_of_presses(sensor: SensorFile, samples: int) -> list[tuple[int, ...]]:
    """Return the counts (tuples of six) of `samples` readings of each of 32 presses."""
    held = Held()
    with Board(LockstepLink(sensor, held)) as board:
        board.command("stream spectrum")
        frames = (frame for frame in board.frames(_LIMIT_S) if isinstance(frame, Spectrum))
        _take(frames, _DARK_WINDOW)
        counts = []
        for force_mN in _FORCES_MN:
            for share in np.linspace(0.05, 0.95, _PLACES):
                held.press = Press(share * sensor.length_mm, force_mN, _WIDTH_MM)
                _take(frames, _SETTLING)
                counts += _take(frames, samples)
    return counts


def _take(frames, count: int) -> list[tuple[int, ...]]:
    found = [frame.counts for frame in islice(frames, count)]
    if len(found) < count:
        raise SpotsError("the virtual board sends no more spectra: check its firmware")
    return found
