"""The digital twin of a five-bar linkage: computes its end point from the two joint angles.

See Fig. 7D of the paper. A strip in each joint measures the angle, see `encoder`.
"""

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import pairwise, takewhile
from typing import NamedTuple

from spots.errors import SettingError, SpotsError
from spots.link.board import Board
from spots.link.frames import Touch
from spots.link.lines import of_sensor

from .encoder import Angle, Encoder
from .fivebar import Linkage
from .limits import Limit, LimitError

_GAP_S = 1.0  # no interpolation between two readings of a joint that are farther apart
_SILENT_S = 3.0  # time without an angle of a joint after which the user is warned
_TRAIL = 4096  # number of stored positions
_KEPT = 2048  # number of stored angles of a joint, which wait for angles of the other joint
_SIGMAS = 3.0  # the curvature of a movement must exceed the noise by this factor
_NEAR_IN_LINE_RAD = math.radians(10)  # outer bars with a smaller angle are nearly in line
_POLL_S = 0.005  # longest wait for readings of one board before the other board is read
_FAILING_S = 10.0  # longest time for which a restarted board may refuse commands


class Terminal(NamedTuple):
    """Position, velocity and error of a linkage's end point at one moment.

    The paper calls the end point "terminal".

    Attributes
    ----------
    time_s : float
        Time in seconds, by the clock of `Touch.time_s`.
    x_mm, y_mm : float or None
        Position in mm; None if the linkage has no solution at these angles.
    velocity_mm_s : tuple of 2 floats or None
        Velocity in x and in y, in mm/s; None without a position, or while the velocity of a joint
        is unknown, see `Angle`.
    covariance_mm2 : tuple of 3 floats or None
        Variance of x, covariance of x and y, and variance of y, in mm**2; None without a position.
    theta_rad : tuple of 2 floats
        Angles of joint 1 and joint 2, in rad.
    limit : Limit
        Reason why there is no position; `Limit.NONE` if there is a position.
    singular : bool
        Whether the outer bars are within 10 degrees of a straight line, where small errors of the
        angles cause large errors of the position. Also True without a position.
    within : bool
        Whether both joints are inside their calibrated ranges.
    """

    time_s: float
    x_mm: float | None
    y_mm: float | None
    velocity_mm_s: tuple[float, float] | None
    covariance_mm2: tuple[float, float, float] | None
    theta_rad: tuple[float, float]
    limit: Limit
    singular: bool
    within: bool

    @property
    def sigma_mm(self) -> float | None:
        """Expected distance from the true position (root mean square) in mm; None if unknown."""
        return None if self.covariance_mm2 is None else math.sqrt(sum(self.covariance_mm2[::2]))

    @property
    def ellipse(self) -> tuple[float, float, float] | None:
        """Error ellipse of one standard error: both semi-axes in mm (major first), angle in rad.

        The angle is from +x to the major axis. For normally distributed errors, the ellipse
        contains 39 % of the positions; an ellipse twice as large contains 86 %.
        """
        if self.covariance_mm2 is None:
            return None
        xx, xy, yy = self.covariance_mm2
        middle, half = (xx + yy) / 2, math.hypot((xx - yy) / 2, xy)
        angle_rad = math.atan2(2 * xy, xx - yy) / 2
        return math.sqrt(middle + half), math.sqrt(max(middle - half, 0.0)), angle_rad

    @property
    def remark(self) -> str:
        """Warning for the user: no position, singularity, or joint out of range; may be empty."""
        doubts = {"near singular": self.singular, "beyond the calibrated range": not self.within}
        return self.limit.sentence if self.limit else ", ".join(k for k, v in doubts.items() if v)

    def message(self) -> dict:
        """Return the position as a dict for JSON, see docs/extend/web-messages.md."""
        return {
            "time_s": self.time_s,
            "x_mm": self.x_mm,
            "y_mm": self.y_mm,
            "velocity_mm_s": self.velocity_mm_s,
            "cov": self.covariance_mm2,
            "sigma_mm": self.sigma_mm,
            "theta1_rad": self.theta_rad[0],
            "theta2_rad": self.theta_rad[1],
            "limit": self.limit.sentence if self.limit else None,
            "singular": self.singular,
            "within": self.within,
        }


class Twin:
    """Digital twin: computes the end point of a linkage from the readings of both joints.

    Parameters
    ----------
    linkage : Linkage
        Geometry of the linkage.
    encoders : pair of Encoder
        Encoder of joint 1 and encoder of joint 2. Their angles are the joint angles of Eqs. 3 and 4
        of the paper.

    Attributes
    ----------
    trail : collections.deque of Terminal
        The latest 4096 values that `take` returned, oldest first; also values without a position.

    Notes
    -----
    The two boards sample at different times. For each reading of one joint, the angle of the other
    joint is interpolated between two readings. So a position is complete only when the next reading
    of the other joint arrives; nothing is extrapolated. The order in which readings of the two
    joints arrive does not matter: recordings give the same positions as the live boards.

    Examples
    --------
    >>> encoders = spots_linkage.Encoder("joint.toml"), spots_linkage.Encoder("joint.toml")
    >>> twin = spots_linkage.Twin(spots_linkage.Linkage(bar_mm=100, base_mm=80), encoders)
    >>> with spots.open_recording("run.spots", speed=float("inf")) as board:
    ...     readings = [(joint, touch) for touch in board.touches() for joint in (0, 1)]
    >>> terminals = list(twin.follow(readings))
    >>> len(terminals), terminals[0].x_mm
    (237, 40.0)
    """

    def __init__(self, linkage: Linkage, encoders: tuple[Encoder, Encoder]):
        if not isinstance(encoders, Sequence) or len(encoders) != 2:
            count = len(encoders) if isinstance(encoders, Sequence) else repr(encoders)
            raise SettingError(
                f"a linkage needs two encoders, not {count}: give one encoder per joint"
            )
        self.linkage = linkage
        self.encoders = tuple(encoders)
        self.trail: deque[Terminal] = deque(maxlen=_TRAIL)
        self._angles: list[deque[Angle]] = [deque(maxlen=_KEPT), deque(maxlen=_KEPT)]
        self._done_s = -math.inf  # time up to which all positions are returned

    def take(self, joint: int, touch: Touch) -> list[Terminal]:
        """Add a reading of a joint, and return the positions that are now complete.

        Parameters
        ----------
        joint : int
            Index of the joint: 0 for joint 1, 1 for joint 2.
        touch : Touch
            The next reading of this joint, in order of time.

        Returns
        -------
        list of Terminal
            Positions in order of time; empty while a reading of the other joint is missing.

        Raises
        ------
        SettingError
            If `joint` is neither 0 nor 1.
        """
        if joint not in (0, 1):
            raise SettingError(
                f"the index of a joint must be 0 or 1, not {joint}: pass only the readings of the "
                "linkage's two strips"
            )
        angle = self.encoders[joint].take(touch)
        if angle is None:
            return []
        own = self._angles[joint]
        if own and angle.time_s <= own[-1].time_s - _GAP_S:
            for angles in self._angles:  # time has jumped back: a recording is played again
                angles.clear()
            self._done_s = -math.inf
        elif own and angle.time_s <= own[-1].time_s:
            own.clear()  # the board restarted, and the new map of its clock is slightly different
        own.append(angle)
        found = []
        for time_s in self._moments():
            angles = [_between(angles, time_s) for angles in self._angles]
            if None not in angles:
                found.append(self._terminal(time_s, angles))
        self.trail.extend(found)
        return found

    def follow(self, readings: Iterable[tuple[int, Touch]]) -> Iterator[Terminal]:
        """Yield the end point's positions, computed from pairs of joint index and reading."""
        for joint, touch in readings:
            yield from self.take(joint, touch)

    def silence(self, now_s: float) -> str:
        """Return a warning that names each joint without an angle in the last 3 s; may be empty.

        `now_s` is the present time in seconds, by the clock of `Touch.time_s`.
        """
        silent = [
            f"joint {number}"
            for number, angles in enumerate(self._angles, 1)
            if not angles or angles[-1].time_s < now_s - _SILENT_S
        ]
        names = " and ".join(silent)
        return f"no angle of {names}: check that the indenter presses the strip" if silent else ""

    def _moments(self) -> list[float]:
        """Return the times for which positions are now complete, in order of time.

        They are the times of new readings, up to the earlier one of the two joints' latest angles.
        No time is returned twice.
        """
        if not all(self._angles):
            return []
        until_s = min(angles[-1].time_s for angles in self._angles)
        moments = {
            angle.time_s
            for angles in self._angles
            for angle in takewhile(lambda one: one.time_s > self._done_s, reversed(angles))
            if angle.time_s <= until_s
        }
        self._done_s = max(self._done_s, until_s)
        return sorted(moments)

    def _terminal(self, time_s: float, angles: list[Angle]) -> Terminal:
        theta = tuple(angle.angle_rad for angle in angles)
        within = all(angle.within for angle in angles)
        try:
            x_mm, y_mm = self.linkage.forward(*theta)
            jacobian = self.linkage.jacobian(*theta)
        except LimitError as error:
            return Terminal(time_s, None, None, None, None, theta, error.limit, True, within)
        cov = (jacobian * [angle.sigma_rad**2 for angle in angles]) @ jacobian.T
        speeds = [angle.velocity_rad_s for angle in angles]
        velocity = None if None in speeds else tuple((jacobian @ speeds).tolist())
        return Terminal(
            time_s,
            x_mm,
            y_mm,
            velocity,
            (float(cov[0, 0]), float(cov[0, 1]), float(cov[1, 1])),
            theta,
            Limit.NONE,
            bool(abs(self.linkage.outer_angle(*theta)) < _NEAR_IN_LINE_RAD),
            within,
        )


def _between(angles: deque[Angle], time_s: float) -> Angle | None:
    """Return a joint's angle at `time_s`, interpolated between `angles`.

    None if there is no angle before `time_s`, or if the angles before and after `time_s` are too
    far apart in time, see `_is_gap`.
    """
    i = len(angles) - 1
    while i and angles[i - 1].time_s >= time_s:
        i -= 1
    new = angles[i]
    if new.time_s == time_s:
        return new
    if i == 0 or _is_gap(angles[i - 1], new):
        return None
    old = angles[i - 1]
    share = (time_s - old.time_s) / (new.time_s - old.time_s)
    bow_rad = _bow((angles[i - 2], old, new), time_s) if i > 1 else 0.0
    variance_rad2 = (
        (1 - share) ** 2 * (old.sigma_rad**2 - old.systematic_rad**2)
        + share**2 * (new.sigma_rad**2 - new.systematic_rad**2)
        + max(old.systematic_rad, new.systematic_rad) ** 2
    )
    return new._replace(
        angle_rad=old.angle_rad + share * (new.angle_rad - old.angle_rad) + bow_rad,
        sigma_rad=math.sqrt(variance_rad2),
        within=old.within and new.within,
    )


def _is_gap(old: Angle, new: Angle) -> bool:
    """Return whether the angles `old` and `new` are too far apart in time to interpolate.

    Also return True if the board has restarted between them.
    """
    # At a restart, a board's clock starts from 0 again.
    return not 0 < new.device_s - old.device_s <= _GAP_S


def _bow(last: tuple[Angle, Angle, Angle], time_s: float) -> float:
    """Return a correction for linear interpolation between the last two angles, in rad.

    The correction is the difference, at `time_s`, between a parabola through the three angles and
    the line through the last two. It is 0 if the curvature is within the noise.
    """
    first, old, new = last
    before_s, since_s = old.time_s - first.time_s, new.time_s - old.time_s
    if _is_gap(first, old):
        return 0.0
    slopes = [(b.angle_rad - a.angle_rad) / (b.time_s - a.time_s) for a, b in pairwise(last)]
    bend = (slopes[1] - slopes[0]) / (before_s + since_s)
    noise_rad = math.sqrt(max(new.sigma_rad**2 - new.systematic_rad**2, 0.0))
    if abs(bend) * before_s * since_s < _SIGMAS * math.sqrt(1.5) * noise_rad:
        return 0.0
    return bend * (time_s - old.time_s) * (time_s - new.time_s)


def readings(
    boards: list[Board],
    sensors: Sequence[int],
    seconds: float | None = None,
    restarted: Callable[[Board], None] = lambda board: None,
) -> Iterator[tuple[int, Touch]]:
    """Start the streams of both joints' boards, and yield the joint's index with each reading.

    One board is in `boards` twice if it has both strips. `seconds` is by `Board.now_s`; without it,
    boards are read without a limit, and recordings until all of them have ended. `restarted` is
    called with a board that has restarted and streams again: it has lost all settings and
    calibrations that were not saved. If the function raises SpotsError, the call is repeated for up
    to 10 s.
    """
    joints = list(zip(boards, sensors))
    boards = [board for i, board in enumerate(boards) if board not in boards[:i]]
    touches = [board.touches() for board in boards]
    for board, sensor in joints:
        board.command(of_sensor("stream touch", sensor))
    read_s = [board.now_s() for board in boards]
    ends_s = math.inf if seconds is None else max(read_s) + seconds
    restarts = [board.stats.restarts for board in boards]
    failing_s = [math.inf] * len(boards)  # time of the first failed call of `restarted`
    # Read the board that was read longest ago. In real time the boards alternate; in simulated
    # time and in recordings, where each board has its own clock, the clocks stay together.
    while min(read_s) < ends_s:
        i = read_s.index(min(read_s))
        board = boards[i]
        for touch in touches[i].within(_POLL_S):
            if (board, touch.sensor) in joints:
                yield joints.index((board, touch.sensor)), touch
        seen = board.stats.restarts
        if seen != restarts[i]:
            try:
                restarted(board)
                restarts[i], failing_s[i] = seen, math.inf
            except SpotsError:  # the board may have restarted again
                failing_s[i] = min(failing_s[i], board.now_s())
                if board.now_s() - failing_s[i] >= _FAILING_S:
                    raise
        read_s[i] = math.inf if board.ended else board.now_s()
