"""A strip under a sliding indenter as the absolute encoder of a joint (paper, section IV)."""

from __future__ import annotations

import math
from collections import deque
from os import PathLike
from pathlib import Path
from typing import NamedTuple

from ..calibrate.calibration_file import Joint, load
from ..errors import SpotsError
from ..link.clockmap import ClockMap
from ..link.frames import Touch

_WINDOW_LEAST, _WINDOW = 3, 8  # readings that make a velocity
_CLEAR = 10.0  # standard errors, from which on a velocity needs no more readings
_WINDOW_S = 2.0  # older ones do not count
_MEAN = 4  # readings that are averaged to notice a slow movement
_SIGMAS = 4.0  # that a movement has to stand out of the noise
_MARGIN = 0.05  # of the range that a joint was calibrated over


class Angle(NamedTuple):
    """A joint at one moment.

    Attributes
    ----------
    time_s : float
        As `Touch.time_s`, or `device_s` where the link does not know that.
    device_s : float
        The same by the board's clock, which does not wrap here.
    angle_rad : float
    sigma_rad : float
        Standard error: noise, what the joint's line leaves, and the backlash unless it is known
        to be taken up.
    systematic_rad : float
        Of this, what does not average out over readings: all but the noise.
    velocity_rad_s, velocity_sigma_rad_s : float or None
        By the board's clock, over the last 3 to 8 readings, so that of a moment in their middle:
        fewer the faster it is. None with fewer than three.
    direction : int
        In which the backlash was last taken up: 1 towards larger angles, -1 towards smaller ones, 0
        if that is not known yet.
    within : bool
        Whether the joint was calibrated there.
    """

    time_s: float
    device_s: float
    angle_rad: float
    sigma_rad: float
    systematic_rad: float
    velocity_rad_s: float | None
    velocity_sigma_rad_s: float | None
    direction: int
    within: bool


class Encoder:
    """The angle of a joint from the readings of its strip.

    Parameters
    ----------
    joint : str, Path or calibrate.calibration_file.Joint
        The calibration file that ``spots calibrate joint`` wrote, or its ``joint``.
    offset_rad, gain : float
        The angle is ``offset_rad + gain * angle`` of the joint's own calibration: how it is
        mounted, see `kinematics`.

    Raises
    ------
    SpotsError
        If there is no joint in the calibration, or the gain is 0.

    Examples
    --------
    >>> encoder = spots.Encoder("joint.toml")
    >>> with spots.open_recording("run.spots", speed=float("inf")) as board:
    ...     angles = [encoder.take(touch) for touch in board.touches()]
    >>> sum(angle is not None for angle in angles)  # None without a trusted touch
    92

    Notes
    -----
    With backlash between joint and indenter, the indenter lags by half of it in either direction.
    As soon as the position has moved by more than its noise, the backlash is known to be taken up
    that way, and half of it is added or subtracted.
    """

    def __init__(
        self,
        joint: Joint | str | PathLike[str] | None,
        offset_rad: float = 0.0,
        gain: float = 1.0,
    ):
        if isinstance(joint, (str, PathLike)):
            joint = load(Path(joint)).joint
        if joint is None:
            raise SpotsError("the calibration holds no joint: run 'spots calibrate joint'")
        if not (math.isfinite(offset_rad) and math.isfinite(gain) and gain):
            raise SpotsError("an encoder's offset and gain are finite, and the gain is not 0")
        self.joint = joint
        self.offset_rad, self.gain = offset_rad, gain
        self._clock = ClockMap()
        self._recent: deque[tuple[float, float]] = deque(maxlen=_WINDOW)  # (device s, deg)
        self._since: list[float] = []  # first and last readings since it was seen to move
        self._still_for = 0  # readings
        self._direction = 0

    def take(self, touch: Touch) -> Angle | None:
        """Take a reading and return the angle; None if the reading is untrusted."""
        if not touch.trusted:
            return None
        joint = self.joint
        device_s = 1e-6 * self._clock.unwrap(touch.t_us)
        indenter_deg = joint.zero_deg + joint.deg_per_um * touch.position_um
        noise_deg = self._noise_deg(touch.position_um)
        if self._recent and not 0 < device_s - self._recent[-1][0] < _WINDOW_S:
            self._recent.clear()  # the board restarted, or nothing was felt for long
        self._recent.append((device_s, indenter_deg))
        self._follow(indenter_deg, noise_deg)
        # A joint at rest may stand anywhere in its backlash.
        moving = self._direction and self._still_for < _WINDOW
        backlash_var = 0.0 if moving else joint.backlash_deg**2 / 12
        # Mean absolute error to standard error, if normal; half the backlash is subtracted below.
        line_var = max(math.pi / 2 * joint.accuracy_deg**2 - joint.backlash_deg**2 / 4, 0.0)
        systematic_deg = math.sqrt(line_var + backlash_var)
        angle_deg = indenter_deg + self._direction * joint.backlash_deg / 2
        velocity, velocity_sigma = self._velocity(noise_deg)
        scale = math.radians(self.gain)
        return Angle(
            device_s if touch.time_s is None else touch.time_s,
            device_s,
            self.offset_rad + scale * angle_deg,
            abs(scale) * math.hypot(noise_deg, systematic_deg),
            abs(scale) * systematic_deg,
            None if velocity is None else scale * velocity,
            None if velocity is None else abs(scale) * velocity_sigma,
            self._direction if self.gain > 0 else -self._direction,
            self._within(touch.position_um),
        )

    def _noise_deg(self, position_um: float) -> float:
        """Return the noise of a reading at a position; it grows exponentially with the distance."""
        joint = self.joint
        if joint.low is None:
            return joint.resolution_deg
        (low_um, low_deg), (high_um, high_deg) = joint.low, joint.high
        share = min(max((position_um - low_um) / (high_um - low_um), 0.0), 1.0)
        return low_deg ** (1 - share) * high_deg**share

    def _within(self, position_um: float) -> bool:
        if self.joint.low is None:
            return True
        low_um, high_um = self.joint.low[0], self.joint.high[0]
        slack_um = _MARGIN * (high_um - low_um)
        return low_um - slack_um <= position_um <= high_um + slack_um

    def _follow(self, indenter_deg: float, noise_deg: float) -> None:
        """Record which way the indenter moved: at once if far, else from means of some readings."""
        self._still_for += 1
        last_deg = self._since[-1] if self._since else indenter_deg
        moved_deg, least_deg = indenter_deg - last_deg, _SIGMAS * math.sqrt(2) * noise_deg
        if abs(moved_deg) <= least_deg:
            self._since.append(indenter_deg)
            begun, now = self._since[:_MEAN], self._since[_MEAN:][-_MEAN:]
            if not now:
                return
            moved_deg = sum(now) / len(now) - sum(begun) / len(begun)
            least_deg = _SIGMAS * math.sqrt(1 / len(now) + 1 / len(begun)) * noise_deg
            if abs(moved_deg) <= least_deg:
                del self._since[_MEAN:-_MEAN]
                return
        self._direction = 1 if moved_deg > 0 else -1
        self._since, self._still_for = [indenter_deg], 0

    def _velocity(self, noise_deg: float) -> tuple[float | None, float | None]:
        """Return the slope over the last readings, as few as make it stand out of the noise."""
        recent = list(self._recent)
        slope = sigma = None
        for count in range(_WINDOW_LEAST, len(recent) + 1):
            last = recent[-count:]
            middle_s = sum(s for s, _ in last) / count
            spread = sum((s - middle_s) ** 2 for s, _ in last)
            slope = sum((s - middle_s) * deg for s, deg in last) / spread
            sigma = noise_deg / math.sqrt(spread)
            if abs(slope) > _CLEAR * sigma:
                break
        return slope, sigma
