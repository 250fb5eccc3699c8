"""A five-bar linkage with backlash and wrong lengths that moves an indenter along two strips.

The truth to compare a twin with. It shares no formula with `linkage.fivebar`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec
import numpy as np

from spots.errors import SpotsError

from .change import NONE, Change
from .files import LinkageFile, PathFile, SensorFile, Stroke
from .scenario import Pose, Press

TRAVEL = (0.1, 0.9)  # of the strip, that the indenter travels
_STEP_S = 1e-3
_WIDTH_MM = 4.0
_CURVE_STEPS = 24  # from one point of a smooth stroke to the next
_PAUSE_S = 0.2  # after each stroke, and after each way to the next


@dataclass(frozen=True)
class Motion:
    """A motion of the terminal, in steps of time.

    Attributes
    ----------
    time_s, x_mm, y_mm : numpy.ndarray, shape (n,)
    drawing : numpy.ndarray of bool, shape (n,)
        Whether the terminal is on a stroke, or goes from one to the next.
    """

    time_s: np.ndarray
    x_mm: np.ndarray
    y_mm: np.ndarray
    drawing: np.ndarray

    @property
    def seconds(self) -> float:
        """How long it takes."""
        return float(self.time_s[-1])

    def at(self, time_s) -> tuple[np.ndarray, np.ndarray]:
        """Return where the terminal was; before and after the motion, where that began or ended."""
        return np.interp(time_s, self.time_s, self.x_mm), np.interp(time_s, self.time_s, self.y_mm)


class Mechanism:
    """A linkage as it came out.

    Parameters
    ----------
    file : LinkageFile
    sensor : SensorFile
        Of both strips; its `joint` has radius, force and backlash of the indenters.

    Attributes
    ----------
    bar_mm, base_mm : tuple of float, float
        The true lengths.
    zero_rad : tuple of float
        Of each joint, the angle of Eqs. 3 and 4 where its own calibration has 0.
    travel_deg : float
        Of either indenter.
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
        self._first_mm, last_mm = (share * sensor.length_mm for share in TRAVEL)
        self.travel_deg = math.degrees((last_mm - self._first_mm) / self._joint.radius_mm)

    def angles_deg(self, x_mm, y_mm) -> np.ndarray:
        """Return the angles of the joints, by their own calibration, for places of the terminal.

        Parameters
        ----------
        x_mm, y_mm : array_like
            Places in mm, in the frame of the base joints; of one shape.

        Returns
        -------
        numpy.ndarray, shape (2, ...)
            NaN where the terminal cannot be.
        """
        a1, b1, b2, a2 = self.bar_mm
        x_mm, y_mm = np.asarray(x_mm, dtype=float), np.asarray(y_mm, dtype=float)
        mirrored_mm = self.base_mm - x_mm
        angles = np.array([_turned(x_mm, y_mm, a1, b1), _turned(mirrored_mm, y_mm, a2, b2)])
        zero_rad = np.reshape(self.zero_rad, (2,) + (1,) * x_mm.ndim)
        return np.degrees(angles - zero_rad)

    def reaches(self, x_mm, y_mm) -> np.ndarray:
        """Return whether both indenters stay on their travel for places of the terminal.

        Parameters
        ----------
        x_mm, y_mm : array_like
            Places in mm, in the frame of the base joints; of one shape.

        Returns
        -------
        numpy.ndarray of bool
            Shape of `x_mm`.
        """
        angles_deg = self.angles_deg(x_mm, y_mm)
        return ((angles_deg >= 0) & (angles_deg <= self.travel_deg)).all(axis=0)

    def drive(self, motion: Motion, again: bool = False) -> tuple[JointScenario, JointScenario]:
        """Return what happens to the two strips in a motion.

        Parameters
        ----------
        motion : Motion
        again : bool
            Whether it restarts at its end.

        Returns
        -------
        tuple of JointScenario
            Of joint 1 and joint 2.

        Raises
        ------
        SpotsError
            If the linkage cannot follow it.
        """
        angles_deg = self.angles_deg(motion.x_mm, motion.y_mm)
        off = ~((angles_deg >= 0) & (angles_deg <= self.travel_deg)).all(axis=0)
        if off.any():
            i = int(np.argmax(off))
            raise SpotsError(
                f"the linkage cannot follow the path: ({motion.x_mm[i]:.1f}, {motion.y_mm[i]:.1f}) "
                "mm is beyond its bars, or beyond the travel of a joint"
            )
        return tuple(self.turn(motion.time_s, of_joint, again) for of_joint in angles_deg)

    def turn(self, time_s: np.ndarray, angle_deg: np.ndarray, again: bool = False) -> JointScenario:
        """Return the scenario of the strip of one joint.

        Parameters
        ----------
        time_s : numpy.ndarray, shape (n,)
            Ascending, in seconds.
        angle_deg : numpy.ndarray, shape (n,)
            Angle of the joint at these times, in degrees.
        again : bool
            Whether it restarts at its end, instead of staying there.

        Returns
        -------
        JointScenario
        """
        mm_per_deg = math.radians(self._joint.radius_mm)
        lagging_deg = _lag(angle_deg, self._joint.play_deg / 2)
        place_mm = self._first_mm + lagging_deg * mm_per_deg
        return JointScenario(time_s, place_mm, angle_deg, self._joint.force_mN, again)


class JointScenario:
    """An indenter on a strip that its joint bends; a scenario as `scenario.Scenario` is one.

    Parameters
    ----------
    time_s, place_mm, bend_deg : numpy.ndarray, shape (n,)
    force_mN : float
    again : bool
        Whether it restarts at its end, instead of staying there.
    """

    still = False
    unplugged = False

    def __init__(self, time_s, place_mm, bend_deg, force_mN: float, again: bool = False):
        self._time_s, self._place_mm, self._bend_deg = time_s, place_mm, bend_deg
        self._force_mN = force_mN
        self._period_s = float(time_s[-1] - time_s[0]) if again else math.inf

    def pose(self, time_s: float) -> Pose:
        """Return how the joint bends the strip."""
        return Pose(bend_deg=float(self._at(time_s, self._bend_deg)))

    def presses(self, time_s: float) -> list[Press]:
        """Return the indenter."""
        place_mm = float(self._at(time_s, self._place_mm))
        return [Press(place_mm, self._force_mN, _WIDTH_MM)]

    def _at(self, time_s: float, values: np.ndarray) -> float:
        since_s = time_s - self._time_s[0]
        if since_s > self._period_s:
            since_s %= self._period_s
        return np.interp(self._time_s[0] + since_s, self._time_s, values)

    def change(self, time_s: float) -> Change:
        return NONE

    def ambient_uW_cm2(self, start_s: float, end_s: float) -> float:
        """Return 0: a joint is covered."""
        return 0.0


def guided(file: PathFile, start_s: float = 0.0) -> Motion:
    """Return the motion of a hand along a path.

    Parameters
    ----------
    file : PathFile
    start_s : float
        When it begins.

    Returns
    -------
    Motion
    """
    legs = []
    for i, stroke in enumerate(file.stroke):
        line = _line(stroke)
        if i:
            legs.append((np.array([legs[-1][0][-1], line[0]]), False))
        legs.append((line, True))
    places, drawing = [legs[0][0][:1]], [np.array([False])]
    for line, draws in legs:
        lengths = np.append(0, np.cumsum(np.hypot(*np.diff(line, axis=0).T)))
        # From rest to rest with the least jerk; the mean speed is that of the file.
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
        y_mm + file.tremor_mm * np.sin(1.3 * phase),  # an open figure, not a circle
        np.concatenate(drawing),
    )


def dwelling(x_mm, y_mm, start_s: float, dwell_s: float, move_s: float) -> Motion:
    """Return a motion that stops at each place; between two places each joint turns evenly.

    Parameters
    ----------
    x_mm, y_mm : array_like, shape (n,)
        Places of the terminal.
    start_s : float
        Arrival at the first place.
    dwell_s, move_s : float
        Time at a place, and to the next one.

    Returns
    -------
    Motion
    """
    count = len(x_mm)
    begin_s = start_s + (dwell_s + move_s) * np.arange(count)
    time_s = np.stack([begin_s, begin_s + dwell_s], axis=1).ravel()
    return Motion(time_s, np.repeat(x_mm, 2), np.repeat(y_mm, 2), np.ones(2 * count, bool))


def closed(file: PathFile) -> PathFile:
    """Return a path with a last stroke that leads back to its first point."""
    back = Stroke(points=[file.stroke[-1].points[-1], file.stroke[0].points[0]])
    return msgspec.structs.replace(file, stroke=[*file.stroke, back])


def _line(stroke: Stroke) -> np.ndarray:
    points = np.array(stroke.points)
    if not stroke.smooth or len(points) < 3:
        return points
    # Catmull and Rom's cubic: through each point, parallel to the line between its neighbours.
    ends = [2 * points[:1] - points[1:2], points, 2 * points[-1:] - points[-2:-1]]
    p0, p1, p2, p3 = (np.concatenate(ends)[i : i + len(points) - 1] for i in range(4))
    t = np.linspace(0, 1, _CURVE_STEPS, endpoint=False)[:, None, None]
    curve = p1 + t / 2 * (
        p2 - p0 + t * (2 * p0 - 5 * p1 + 4 * p2 - p3 + t * (3 * (p1 - p2) + p3 - p0))
    )
    return np.concatenate([curve.transpose(1, 0, 2).reshape(-1, 2), points[-1:]])


def _turned(x_mm, y_mm, inner: float, outer: float) -> np.ndarray:
    """Return the angle of an arm from +y, by where circles about joint and terminal cross."""
    reach2 = x_mm**2 + y_mm**2
    with np.errstate(all="ignore"):
        along = (reach2 + inner**2 - outer**2) / (2 * reach2)
        off = np.sqrt(inner**2 / reach2 - along**2)
    return np.arctan2(along * x_mm - off * y_mm, along * y_mm + off * x_mm)


def _lag(angle_deg: np.ndarray, half_deg: float) -> np.ndarray:
    """Return where the indenter stands: it moves only when the joint has passed its backlash."""
    lagging = np.empty(len(angle_deg))
    at = angle_deg[0]
    for i, angle in enumerate(angle_deg.tolist()):
        at = min(max(at, angle - half_deg), angle + half_deg)
        lagging[i] = at
    return lagging
