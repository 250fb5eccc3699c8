"""A joint of two bars, and readings of its strip."""

from __future__ import annotations

from spots.calibrate.calibration_file import Joint
from spots.link.frames import Touch
from spots_device.reading import decode

JOINT = Joint(
    zero_deg=-20.0,
    deg_per_um=0.002,
    r2=0.9999,
    resolution_deg=0.03,
    accuracy_deg=0.0,
    backlash_deg=0.0,
    low=(0.0, 0.03),
    high=(85_000.0, 0.03),
)


PERIOD_S = 0.03


def touch(position_um, i=0, flags=decode.TOUCHING, time_s=None, start_us=0):
    t_us = (start_us + round(1e6 * PERIOD_S * i)) % 2**32
    return Touch(0, i % 65536, t_us, flags, 0, 0, round(position_um), 4000, time_s)
