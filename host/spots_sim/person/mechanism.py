"""A simulated five-bar linkage with backlash and errors of its lengths.

Each of its two base joints moves an indenter along a strip.

The true positions of this linkage test the digital twin (`spots_linkage.Twin`), which computes
positions from readings of the strips. This module shares no formula with `spots_linkage.fivebar`,
so that the test also finds a wrong formula.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from spots.errors import SettingError

from ..strip.change import NONE, Change
from ..strip.files import (
    JOINT_TRAVEL,
    LinkageFile,
    PathFile,
    SensorFile,
    Stroke,
)
from ..strip.scenario import Pose, Press

_STEP_S = 1e-3
_WIDTH_MM = 4.0
_CURVE_STEPS = 24  # steps between two points of a smooth stroke
_PAUSE_S = 0.2  # after each stroke, and before the next one


@dataclass(frozen=True)
class Motion:
    """A motion of a linkage's end point, sampled at ascending times; all arrays have shape (n,).

    `drawing` is False in pauses and on the way to the next stroke.
    """

    time_s: np.ndarray
    x_mm: np.ndarray
    y_mm: np.ndarray
    drawing: np.ndarray

    @property
    def seconds(self) -> float:
        """End of the motion: time of its last sample, in seconds."""
        return float(self.time_s[-1])

    def at(self, time_s) -> tuple[np.ndarray, np.ndarray]:
        """Return x and y of the end point in mm at times in s.

        Before and after the motion, the end point rests.
        """
        return np.interp(time_s, self.time_s, self.x_mm), np.interp(time_s, self.time_s, self.y_mm)


class Mechanism:
    """A simulated linkage as built, with its true lengths.

    `zero_rad` is for each joint the angle, as defined in Eqs. 3 and 4 of the paper, at which the
    joint's calibration has the angle 0. At `travel_deg`, the indenter is at the end of its travel;
    the table `joint` of the sensor file describes it. Joint 1 is at (0, 0) and joint 2 at
    (`base_mm`, 0).
    """

    def __init__(self, file: LinkageFile, sensor: SensorFile):
        self.bar_mm = tuple(
            bar * (1 + percent / 100) for bar, percent in zip(file.bar_mm, file.bar_error_percent)
        )
        self.base_mm = file.base_mm * (1 + file.base_error_percent / 100)
        self.zero_rad = tuple(
            math.radians(low + error) for low, error in zip(file.lowest_deg, file.mount_error_deg)
        )
        self._joint = sensor.joint
        self._first_mm = JOINT_TRAVEL[0] * sensor.length_mm
        self.travel_deg = sensor.joint_travel_deg

    def angles_deg(self, x_mm: ArrayLike, y_mm: ArrayLike) -> np.ndarray:
        """Return the angles of joint 1 and 2, as in the joint's calibration, for positions.

        The shape is (2, ...); NaN if the linkage cannot reach a position.
        """
        a1, b1, b2, a2 = self.bar_mm
        x_mm, y_mm = np.asarray(x_mm, dtype=float), np.asarray(y_mm, dtype=float)
        mirrored_mm = self.base_mm - x_mm
        angles = np.array([_turned(x_mm, y_mm, a1, b1), _turned(mirrored_mm, y_mm, a2, b2)])
        zero_rad = np.reshape(self.zero_rad, (2,) + (1,) * x_mm.ndim)
        return np.degrees(angles - zero_rad)

    def reaches(self, x_mm: ArrayLike, y_mm: ArrayLike) -> np.ndarray:
        """Return whether both indenters are within their travel at positions of the end point."""
        angles_deg = self.angles_deg(x_mm, y_mm)
        return ((angles_deg >= 0) & (angles_deg <= self.travel_deg)).all(axis=0)

    def drive(self, motion: Motion, again: bool = False) -> tuple[JointScenario, JointScenario]:
        """Return the scenarios of the two strips during a motion, which repeats with `again`.

        SettingError if the linkage cannot follow the motion.
        """
        angles_deg = self.angles_deg(motion.x_mm, motion.y_mm)
        off = ~((angles_deg >= 0) & (angles_deg <= self.travel_deg)).all(axis=0)
        if off.any():
            i = int(np.argmax(off))
            raise SettingError(
                f"the linkage cannot follow the path: ({motion.x_mm[i]:.1f}, {motion.y_mm[i]:.1f}) "
                "mm is out of reach of its bars, or beyond the travel of a joint: move the points "
                "of the path"
            )
        return tuple(self.turn(motion.time_s, of_joint, again) for of_joint in angles_deg)

    def turn(self, time_s: np.ndarray, angle_deg: np.ndarray, again: bool = False) -> JointScenario:
        """Return the scenario of one joint's strip for joint angles at ascending times.

        With `again`, the motion repeats without end; otherwise the joint stays at its last angle.
        """
        mm_per_deg = math.radians(self._joint.radius_mm)
        lagging_deg = _lag(angle_deg, self._joint.play_deg / 2)
        place_mm = self._first_mm + lagging_deg * mm_per_deg
        return JointScenario(time_s, place_mm, angle_deg, self._joint.force_mN, again)


class JointScenario:
    """Scenario of a strip in a joint: the joint bends the strip and slides an indenter on it.

    It has the methods of `scenario.Scenario`. The arrays have shape (n,); `place_mm` is the
    position of the indenter. With `again`, they repeat without end; otherwise the last values stay.
    """

    still = False
    unplugged = False

    def __init__(
        self,
        time_s: np.ndarray,
        place_mm: np.ndarray,
        bend_deg: np.ndarray,
        force_mN: float,
        again: bool = False,
    ):
        self._time_s, self._place_mm, self._bend_deg = time_s, place_mm, bend_deg
        self._force_mN = force_mN
        self._period_s = float(time_s[-1] - time_s[0]) if again else math.inf

    def pose(self, time_s: float) -> Pose:
        """Return the bend of the strip at `time_s` seconds; strain and leak are 0."""
        return Pose(bend_deg=float(self._at(time_s, self._bend_deg)))

    def presses(self, time_s: float) -> list[Press]:
        """Return a list of one press: that of the joint's indenter at `time_s` seconds."""
        place_mm = float(self._at(time_s, self._place_mm))
        return [Press(place_mm, self._force_mN, _WIDTH_MM, hand=False, skin=False)]

    def _at(self, time_s: float, values: np.ndarray) -> float:
        since_s = time_s - self._time_s[0]
        if since_s > self._period_s:
            since_s %= self._period_s
        return np.interp(self._time_s[0] + since_s, self._time_s, values)

    def change(self, time_s: float) -> Change:
        return NONE

    def is_dark(self, start_s: float, end_s: float) -> bool:
        """Return False: the indenter always presses, so light of the LED enters the strip."""
        return False

    def ambient_uW_cm2(self, start_s: float, end_s: float) -> float:
        """Return 0: no ambient light enters a joint."""
        return 0.0


def guided(file: PathFile, start_s: float = 0.0) -> Motion:
    """Return the motion of an end point that a hand guides along a path, from `start_s` on."""
    legs = []
    for i, stroke in enumerate(file.stroke):
        line = _line(stroke)
        if i:
            legs.append((np.array([legs[-1][0][-1], line[0]]), False))
        legs.append((line, True))
    places, drawing = [legs[0][0][:1]], [np.array([False])]
    for line, draws in legs:
        lengths = np.append(0, np.cumsum(np.hypot(*np.diff(line, axis=0).T)))
        # Minimum-jerk motion from rest to rest, with the mean speed of the file.
        seconds = max(lengths[-1] / file.speed_mm_s, 10 * _STEP_S)
        share = np.arange(1, round(seconds / _STEP_S) + 1) * _STEP_S / seconds
        share = np.minimum(share, 1)
        way = lengths[-1] * share**3 * (10 - 15 * share + 6 * share**2)
        leg = np.array([np.interp(way, lengths, line[:, axis]) for axis in (0, 1)]).T
        rest = np.repeat(leg[-1:], round(_PAUSE_S / _STEP_S), axis=0)
        for part, on in ((leg, draws), (rest, False)):
            places.append(part)
            drawing.append(np.full(len(part), on))
    x_mm, y_mm = np.concatenate(places).T
    time_s = start_s + _STEP_S * np.arange(len(x_mm))
    phase = 2 * np.pi * file.tremor_hz * time_s
    return Motion(
        time_s,
        x_mm + file.tremor_mm * np.sin(phase),
        y_mm + file.tremor_mm * np.sin(1.3 * phase),  # a different frequency avoids a circle
        np.concatenate(drawing),
    )


def dwelling(
    x_mm: ArrayLike, y_mm: ArrayLike, start_s: float, dwell_s: float, move_s: float
) -> Motion:
    """Return a motion that stops at each position; in between, the joints turn at constant speed.

    It arrives at the first position at `start_s`.
    """
    count = len(x_mm)
    begin_s = start_s + (dwell_s + move_s) * np.arange(count)
    time_s = np.stack([begin_s, begin_s + dwell_s], axis=1).ravel()
    return Motion(time_s, np.repeat(x_mm, 2), np.repeat(y_mm, 2), np.ones(2 * count, bool))


def closed(file: PathFile) -> PathFile:
    """Return a path with an additional last stroke to its first point, so that it can repeat."""
    back = Stroke(points=[file.stroke[-1].points[-1], file.stroke[0].points[0]])
    return msgspec.structs.replace(file, stroke=[*file.stroke, back])


def _line(stroke: Stroke) -> np.ndarray:
    points = np.array(stroke.points)
    if not stroke.smooth or len(points) < 3:
        return points
    # Catmull-Rom spline: passes through each point, parallel to the line between its neighbours.
    ends = [2 * points[:1] - points[1:2], points, 2 * points[-1:] - points[-2:-1]]
    p0, p1, p2, p3 = (np.concatenate(ends)[i : i + len(points) - 1] for i in range(4))
    t = np.linspace(0, 1, _CURVE_STEPS, endpoint=False)[:, None, None]
    curve = p1 + t / 2 * (
        p2 - p0 + t * (2 * p0 - 5 * p1 + 4 * p2 - p3 + t * (3 * (p1 - p2) + p3 - p0))
    )
    return np.concatenate([curve.transpose(1, 0, 2).reshape(-1, 2), points[-1:]])


def _turned(x_mm, y_mm, inner: float, outer: float) -> np.ndarray:
    """Return the angle of an inner bar in rad, from the y axis towards the x axis.

    `x_mm` and `y_mm` are the position of the end point relative to the joint; `inner` and `outer`
    are the lengths of the bars in mm. The elbow is where two circles intersect: one around the
    joint with the radius `inner`, one around the end point with the radius `outer`. Of the two
    intersections, it is the left one, looking from the joint to the end point.
    """
    reach2 = x_mm**2 + y_mm**2
    with np.errstate(all="ignore"):
        along = (reach2 + inner**2 - outer**2) / (2 * reach2)
        off = np.sqrt(inner**2 / reach2 - along**2)
    return np.arctan2(along * x_mm - off * y_mm, along * y_mm + off * x_mm)


def _lag(angle_deg: np.ndarray, half_deg: float) -> np.ndarray:
    """Return the angles of an indenter that lags behind a joint with the angles `angle_deg`.

    `half_deg` is half of the backlash between joint and indenter.
    """
    lagging = np.empty(len(angle_deg))
    at = angle_deg[0]
    for i, angle in enumerate(angle_deg.tolist()):
        at = min(max(at, angle - half_deg), angle + half_deg)
        lagging[i] = at
    return lagging
