"""The path of the light in the dyed guide: uneven dye, dye bleached in places, and bends."""

from __future__ import annotations

import math

import numpy as np

from .change import Change
from .files import SensorFile

_BENT_DEG = 90.0  # `Stretch.bend_path_percent` refers to this angle


class DyedPath:
    """Length of the path in the dyed guide, in mm of evenly dyed guide.

    `sensor` is the strip as calibrated. `is_even` is whether the path is the distance along the
    strip, at every angle of a bend.
    """

    def __init__(self, sensor: SensorFile, now: Change):
        dye, stretch = sensor.dye, sensor.stretch
        self._swing = dye.uneven_percent / 100
        self._per_mm = 2 * math.pi / dye.uneven_mm
        self._phase = math.radians(dye.uneven_phase_deg)
        third_mm = sensor.length_mm / 3
        parts = now.dye_near_percent, now.dye_middle_percent, now.dye_far_percent
        # Start and length of each piece in mm, and how much longer its path is.
        self._pieces = [
            (i * third_mm, third_mm, part / 100) for i, part in enumerate(parts) if part
        ]
        middle_mm = stretch.bend_at_percent / 100 * sensor.length_mm
        self._bent = (
            middle_mm - stretch.bend_mm / 2,
            stretch.bend_mm,
            stretch.bend_path_percent / 100,
        )
        self.is_even = not (self._swing or self._pieces or self._bent[2])

    def at(self, place_mm: float | np.ndarray, bend_deg: float) -> tuple:
        """Return the path to a place on the unstretched strip, and its derivative by the place."""
        start_mm, long_mm, longer = self._bent
        bent = start_mm, long_mm, longer * bend_deg / _BENT_DEG
        path_mm, slope = place_mm, 1.0
        for start_mm, long_mm, longer in (*self._pieces, bent):
            inside_mm = place_mm - start_mm
            path_mm = path_mm + longer * np.minimum(np.maximum(inside_mm, 0.0), long_mm)
            slope = slope + longer * ((inside_mm >= 0) & (inside_mm < long_mm))
        if self._swing:
            angle = self._per_mm * place_mm + self._phase
            swing_mm = self._swing / self._per_mm
            path_mm = path_mm + swing_mm * (math.cos(self._phase) - np.cos(angle))
            slope = slope + self._swing * np.sin(angle)
        return path_mm, slope
