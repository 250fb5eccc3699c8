"""The digital twin of a five-bar linkage: two encoders in, one terminal out (paper, Fig. 7D)."""

from __future__ import annotations

import heapq
import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise, repeat
from typing import NamedTuple

import numpy as np

from ..errors import SpotsError
from ..link.board import Board
from ..link.frames import Touch
from .encoder import Angle, Encoder
from .fivebar import Limit, LimitError, Linkage

_GAP_S = 1.0  # between two readings of a joint, that is not interpolated
_SILENT_S = 3.0  # without an angle, until a joint is reported
_TRAIL = 4096
_KEPT = 2048  # angles of a joint that wait for the other one
_SIGMAS = 3.0  # that a turn's beginning or end has to stand out of the noise
_NEAR_IN_LINE_RAD = math.radians(10)
_POLL_S = 0.005
_FAILING_S = 10.0  # for which a restarted board may refuse its commands


class Terminal(NamedTuple):
    """The terminal at one moment.

    Attributes
    ----------
    time_s : float
        By the clock of `Touch.time_s`.
    x_mm, y_mm : float or None
        None where `limit` says that the linkage cannot be there.
    velocity_mm_s : tuple of float or None
        Of x and y; None too as long as the encoders know none.
    covariance_mm2 : tuple of float or None
        Of x and x, x and y, y and y.
    theta_rad : tuple of float
        The joints at that moment.
    limit : Limit
    singular : bool
        Whether the outer bars are nearly in line: small errors of the angles become large ones.
    within : bool
        Whether both joints are where they were calibrated.
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
        """Root mean square error of the distance that is to be expected."""
        return None if self.covariance_mm2 is None else math.sqrt(sum(self.covariance_mm2[::2]))

    @property
    def ellipse(self) -> tuple[float, float, float] | None:
        """Half axes (mm) of the ellipse of one standard error, and the longer one's angle from +x.

        39 % of a normal scatter lie in it, 86 % in the one twice as large.
        """
        if self.covariance_mm2 is None:
            return None
        xx, xy, yy = self.covariance_mm2
        middle, half = (xx + yy) / 2, math.hypot((xx - yy) / 2, xy)
        angle_rad = math.atan2(2 * xy, xx - yy) / 2
        return math.sqrt(middle + half), math.sqrt(max(middle - half, 0.0)), angle_rad

    @property
    def remark(self) -> str:
        """Limit, singularity or extrapolation in words; empty if there is neither."""
        doubts = {"near singular": self.singular, "beyond what was calibrated": not self.within}
        return self.limit.sentence if self.limit else ", ".join(k for k, v in doubts.items() if v)

    def message(self) -> dict:
        """Return it as a JSON object; docs/page.md says what each key means."""
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
    """Follows the terminal of a linkage.

    Parameters
    ----------
    linkage : Linkage
    encoders : pair of Encoder
        Of joint 1 and joint 2, which give the angles of Eqs. 3 and 4.

    Attributes
    ----------
    trail : collections.deque of Terminal
        The last ones.

    Notes
    -----
    The joints are not read at the same moments. A terminal is that of the moment of one reading
    and of the other joint between two of its readings, so it comes as soon as the other joint's
    next reading is there, and nothing is extrapolated. Which of two readings came first to the
    program makes no difference: a recording gives the same terminals as the boards did.

    Examples
    --------
    >>> encoders = spots.Encoder("joint.toml"), spots.Encoder("joint.toml")
    >>> twin = spots.Twin(spots.Linkage(bar_mm=100, base_mm=80), encoders)
    >>> with spots.open_recording("run.spots", speed=float("inf")) as board:
    ...     readings = [(joint, touch) for touch in board.touches() for joint in (0, 1)]
    >>> terminals = list(twin.follow(readings))
    >>> len(terminals), terminals[0].x_mm
    (92, 40.0)
    """

    def __init__(self, linkage: Linkage, encoders: tuple[Encoder, Encoder]):
        if len(encoders) != 2:
            raise SpotsError("a five-bar linkage has two encoders")
        self.linkage = linkage
        self.encoders = tuple(encoders)
        self.trail: deque[Terminal] = deque(maxlen=_TRAIL)
        self._angles: list[deque[Angle]] = [deque(maxlen=_KEPT), deque(maxlen=_KEPT)]
        self._done_s = -math.inf  # all terminals up to then are returned

    def take(self, joint: int, touch: Touch) -> list[Terminal]:
        """Take a reading of a joint, and return the terminals that it completes.

        Parameters
        ----------
        joint : int
            0 or 1.
        touch : Touch
            Readings of one joint come in the order of their time.

        Returns
        -------
        list of Terminal
            In the order of their time; empty until the other joint's next reading.
        """
        angle = self.encoders[joint].take(touch)
        if angle is None:
            return []
        own = self._angles[joint]
        if own and angle.time_s <= own[-1].time_s - _GAP_S:
            self._forget()  # a recording that is played again
        elif own and angle.time_s <= own[-1].time_s:
            own.clear()  # after a restart its board's clock is compared with the host's again
        own.append(angle)
        found = []
        for time_s in self._moments():
            angles = [_between(angles, time_s) for angles in self._angles]
            if None not in angles:
                found.append(self._terminal(time_s, angles))
        self.trail.extend(found)
        return found

    def follow(self, readings: Iterable[tuple[int, Touch]]) -> Iterator[Terminal]:
        """Take pairs of joint and reading, live or from a recording, and yield the terminals."""
        for joint, touch in readings:
            yield from self.take(joint, touch)

    def silence(self, now_s: float) -> str:
        """Return a sentence about joints without an angle for some seconds, if there are any."""
        silent = [
            f"joint {number}"
            for number, angles in enumerate(self._angles, 1)
            if not angles or angles[-1].time_s < now_s - _SILENT_S
        ]
        return f"no angle of {' and '.join(silent)}: is its strip pressed?" if silent else ""

    def _forget(self) -> None:
        for angles in self._angles:
            angles.clear()
        self._done_s = -math.inf

    def _moments(self) -> list[float]:
        """Return when a joint was read, where the other one's readings reach as far; once each."""
        if not all(self._angles):
            return []
        until_s = min(angles[-1].time_s for angles in self._angles)
        moments = set()
        for angles in self._angles:
            for angle in reversed(angles):
                if angle.time_s <= self._done_s:
                    break
                if angle.time_s <= until_s:
                    moments.add(angle.time_s)
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
    """Return a joint at a moment up to its last reading; None if no two readings enclose it."""
    i = len(angles) - 1
    while i and angles[i - 1].time_s >= time_s:
        i -= 1
    new = angles[i]
    if new.time_s == time_s:
        return new
    if i == 0 or new.time_s > angles[i - 1].time_s + _GAP_S:
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


def _bow(last: tuple[Angle, Angle, Angle], time_s: float) -> float:
    """Return how far a parabola through three readings is off the line through the last two.

    0 unless it stands out of the noise, which a parabola would only let in.
    """
    first, old, new = last
    before_s, since_s = old.time_s - first.time_s, new.time_s - old.time_s
    if before_s > _GAP_S:
        return 0.0
    slopes = [(b.angle_rad - a.angle_rad) / (b.time_s - a.time_s) for a, b in pairwise(last)]
    bend = (slopes[1] - slopes[0]) / (before_s + since_s)
    noise_rad = math.sqrt(max(new.sigma_rad**2 - new.systematic_rad**2, 0.0))
    if abs(bend) * before_s * since_s < _SIGMAS * math.sqrt(1.5) * noise_rad:
        return 0.0
    return bend * (time_s - old.time_s) * (time_s - new.time_s)


def merged(first: Iterable[Touch], second: Iterable[Touch]) -> Iterator[tuple[int, Touch]]:
    """Yield the readings of two joints in order of time.

    Parameters
    ----------
    first, second : iterable of Touch
        Of joint 1 and of joint 2, by one clock and each in order of time, as in two recordings.

    Yields
    ------
    joint : int
        0 or 1.
    touch : Touch
    """
    pairs = zip(repeat(0), first), zip(repeat(1), second)
    return heapq.merge(*pairs, key=lambda pair: pair[1].time_s)


def readings(
    boards: list[Board],
    seconds: float | None = None,
    restarted: Callable[[Board], None] = lambda board: None,
) -> Iterator[tuple[int, Touch]]:
    """Yield (joint, reading) of two boards with a sensor each, or of one board with two.

    Parameters
    ----------
    boards : list of Board
        Streaming is switched on.
    seconds : float, optional
        End after so long by the links' clock; never, if not given.
    restarted : callable
        Given a board that has restarted and streams again: it has forgotten all that was not
        saved. Called again for some seconds if it raises SpotsError.

    Yields
    ------
    joint : int
        0 or 1.
    touch : Touch
    """
    for board in boards:
        board.command("stream touch")
    # Boards of one machine have one clock, though in simulated time one may be ahead of it.
    begins_s = max(board.now_s() for board in boards)
    ends_s = math.inf if seconds is None else begins_s + seconds
    # The board that is behind is read next: in real time they take turns, and in simulated time,
    # where each board has a clock of its own, these go on together.
    read_s = [board.now_s() for board in boards]
    watched = [_Restarts(board, restarted) for board in boards]
    while True:
        one = int(np.argmin(read_s))
        board = boards[one]
        if read_s[one] >= ends_s:
            return
        for frame in board.frames(_POLL_S):
            if isinstance(frame, Touch):
                yield (frame.sensor if len(boards) == 1 else one), frame
        watched[one].look()
        read_s[one] = board.now_s()


class _Restarts:
    def __init__(self, board: Board, action: Callable[[Board], None]):
        self._board, self._action = board, action
        self._seen = board.stats.restarts
        self._failing_s: float | None = None

    def look(self) -> None:
        seen = self._board.stats.restarts
        if seen == self._seen:
            return
        try:
            self._action(self._board)
        except SpotsError:
            # It may have restarted once more.
            now_s = self._board.now_s()
            self._failing_s = now_s if self._failing_s is None else self._failing_s
            if now_s - self._failing_s >= _FAILING_S:
                raise
            return
        self._seen, self._failing_s = seen, None
