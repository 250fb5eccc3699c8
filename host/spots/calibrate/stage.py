"""A calibration run on the simulated stage: real firmware, simulated time, known presses."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ..board import Board
from ..frames import Spectrum
from ..sim.files import SensorFile
from ..sim.lockstep import LockstepLink
from ..sim.scenario import Held, Press
from .fit import Conditions, Presses, fit

_FIRM_MN = 6000.0
_PLACES = 25
_FORCES_MN = np.geomspace(200.0, 10_000.0, 24)
_FORCE_PLACES = (0.1, 0.5, 0.9)  # shares of the length
_SAMPLES = 16
_SETTLE_SAMPLES = 3
_WIDTH_MM = 4.0


@lru_cache(maxsize=8)
def calibrate(sensor: SensorFile) -> tuple[str, ...]:
    """Return the lines of a calibration of a simulated sensor at its board's settings.

    Raises
    ------
    SpotsError
        If the sensor's readings do not allow a calibration.
    """
    held = Held()
    with Board(LockstepLink(sensor, held)) as board:
        dark = np.array(board.command("dark")["dark"]) / 4
        board.command("stream spectrum")
        length_um = 1000 * sensor.length_mm

        def read(places_um, forces_mN):
            return _read(board, held, dark, places_um, forces_mN)

        along = read(np.linspace(0, length_um, _PLACES), [_FIRM_MN])
        pressed = read([share * length_um for share in _FORCE_PLACES], _FORCES_MN)
        info = board.info
        conditions = Conditions(
            info["id"], tuple(info["plan"]), info["gain"], info["exposure_us"], info["led_mA"]
        )
    return tuple(fit(along, pressed, conditions))


def _read(board, held, dark, places_um, forces_mN) -> Presses:
    rows = []
    for force_mN in forces_mN:
        for place_um in places_um:
            held.press = Press(place_um / 1000, force_mN, _WIDTH_MM)
            counts = _samples(board) - dark
            rows.append((place_um, force_mN, counts.mean(axis=0), counts.var(axis=0, ddof=1)))
    held.press = None
    return Presses(*(np.array(column) for column in zip(*rows)))


def _samples(board: Board) -> np.ndarray:
    counts = []
    for frame in board.frames():
        if isinstance(frame, Spectrum) and not frame.flags & 0x80:
            counts.append(frame.counts)
            if len(counts) == _SETTLE_SAMPLES + _SAMPLES:
                return np.array(counts[_SETTLE_SAMPLES:], dtype=float)
    raise AssertionError("frames() without an end ended")
