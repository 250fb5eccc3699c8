"""Places of a five-bar linkage, as a camera and two strips see them."""

from __future__ import annotations

import numpy as np

from spots_linkage import Linkage, kinematics

TRUE = Linkage((101.0, 99.3, 100.8, 99.0), 80.7)


OFFSET = np.array([[-1.88], [-1.90]])


GAIN = np.array([[1.002], [0.997]])


FRAME = {"frame_x_mm": 12.0, "frame_y_mm": -7.0, "frame_rad": 0.03, "frame_scale": 1.0}


FOUND = dict(zip(kinematics.LENGTHS, (*TRUE.bar_mm, TRUE.base_mm))) | {
    "offset1_rad": -1.88,
    "offset2_rad": -1.90,
    "gain1": 1.002,
    "gain2": 0.997,
    **FRAME,
}


def places(count, seed=0, noise=0.0, frame=FRAME):
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-80, 160, 20 * count), rng.uniform(60, 195, 20 * count)
    theta = TRUE.inverse(x, y)
    fit = np.ma.filled(TRUE.outer_angle(*theta), 0) > np.radians(30)
    theta = np.array([np.ma.getdata(one)[fit][:count] for one in theta])
    angles = (theta - OFFSET) / GAIN + noise * 2e-4 * rng.standard_normal(theta.shape)
    seen = np.array(kinematics.framed(frame, x[fit][:count], y[fit][:count]))
    return angles, seen + noise * 0.02 * rng.standard_normal(seen.shape)
