"""Calibration of a joint: a straight line that converts positions on the strip to angles.

The joint moves an indenter, which always presses the strip.
"""

from __future__ import annotations

import numpy as np

from ...errors import CalibrationError
from ..calibration_file import Joint, Marks
from ..fit.points import Point

ANGLES_MIN = 4  # least number of angles in each direction
# Largest distance of an angle from the straight line, as a share of the joint's travel.
_OFF_MAX = 0.05
_LEAST_UM = 0.1  # lower limit of standard deviations, because readings are in whole um


def fit_joint(points: list[Point]) -> Joint:
    """Fit a straight line to the points of both directions of turning, and compute its errors.

    The points are in the order of the session. For `Joint.accuracy_deg`, a line is fitted to every
    second point of each direction; the other points give its error. CalibrationError if there are
    too few points, if two points of one direction have equal angles, or if the position does not
    rise or fall steadily with the angle, or is far from a straight line.
    """
    ways = [[p for p in points if p.direction == way] for way in (1, -1)]
    if min(len(way) for way in ways) < ANGLES_MIN:
        raise CalibrationError(f"a joint needs {ANGLES_MIN} angles or more in each direction")
    angle, position, sigma = (
        np.array([getattr(p, name) for way in ways for p in way])
        for name in ("angle_deg", "position_um", "position_sigma_um")
    )
    up = np.repeat([True, False], [len(way) for way in ways])
    learn = np.concatenate([np.arange(len(way)) % 2 == 0 for way in ways])
    order = np.lexsort((angle, up))
    same_way = np.diff(up[order].astype(int)) == 0
    if (np.diff(angle[order])[same_way] == 0).any():
        raise CalibrationError(
            "two points have the same angle and direction of turn: begin another session"
        )
    steps = np.diff(position[order])[same_way]
    if not ((steps > 0).all() or (steps < 0).all()):
        raise CalibrationError(
            "the position does not rise or fall steadily with the angle: check the angles, and "
            "that the indenter does not slip; then begin another session"
        )
    error = np.polyval(np.polyfit(position[learn], angle[learn], 1), position) - angle
    slope, zero = np.polyfit(position, angle, 1)
    residual = slope * position + zero - angle
    # A constant difference between the directions is the backlash.
    off = np.abs(residual - np.where(up, residual[up].mean(), residual[~up].mean()))
    if off.max() > _OFF_MAX * np.ptp(angle):
        raise CalibrationError(
            f"the angle {angle[np.argmax(off)]:g} differs by {off.max():.2g} degrees from a "
            "straight line through all angles: check this angle, and that the indenter slides "
            "along the strip; then begin another session"
        )
    ends_um = position.min(), position.max()
    # The light decreases exponentially along the strip, so the noise grows exponentially.
    growth = np.polyfit(position, np.log(np.maximum(sigma, _LEAST_UM)), 1)
    low, high = (
        (round(float(end), 1), round(abs(float(slope)) * float(np.exp(np.polyval(growth, end))), 5))
        for end in ends_um
    )
    r2 = 1 - (residual**2).sum() / ((angle - angle.mean()) ** 2).sum()
    return Joint(
        zero_deg=round(float(zero), 5),
        deg_per_um=float(f"{slope:.9g}"),
        r2=round(float(r2), 7),
        resolution_deg=round(abs(float(slope)) * float(sigma.mean()), 5),
        accuracy_deg=round(float(np.abs(error[~learn]).mean()), 5),
        backlash_deg=round(abs(float(residual[up].mean() - residual[~up].mean())), 5),
        low=low,
        high=high,
    )


def joint_marks(points: list[Point]) -> Marks:
    """Return the marks for a re-zero: lowest, middle and highest angle of the upward turn.

    At least `ANGLES_MIN` of the points must have direction 1 (upwards).
    """
    way = sorted((p for p in points if p.direction > 0), key=lambda p: p.angle_deg)
    stops = sorted((way[0], way[len(way) // 2], way[-1]), key=lambda p: p.position_um)
    return Marks(
        place_um=tuple(p.position_um for p in stops),
        force_mN=0.0,
        logs=tuple(tuple(np.log2(p.counts).round(6).tolist()) for p in stops),
        angle_deg=tuple(p.angle_deg for p in stops),
    )
