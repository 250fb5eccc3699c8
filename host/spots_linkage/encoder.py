"""The absolute encoder of a joint: a strip that a sliding indenter presses (paper, section IV)."""

import math
from collections import deque
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np

from spots.calibrate.calibration_file import Joint, load
from spots.errors import CalibrationError, SettingError
from spots.link.clockmap import ClockMap
from spots.link.frames import Touch

_WINDOW_LEAST, _WINDOW = 3, 8  # least and largest number of readings for a velocity
_CLEAR = 10.0  # a velocity of more than this number of standard errors needs no more readings
_WINDOW_S = 2.0  # after a longer pause, a velocity uses only the readings after the pause
_MEAN = 4  # number of readings that are averaged to detect a slow movement
_SIGMAS = 4.0  # a movement must exceed the noise by this factor
_MARGIN = 0.05  # a joint may exceed its calibrated range by this share of the range


class Angle(NamedTuple):
    """Angle of a joint at one moment, with velocity and standard errors.

    Attributes
    ----------
    time_s : float
        Time in seconds: `Touch.time_s`, or `device_s` if that is None.
    device_s : float
        Time in seconds by the board's clock, which wraps every 71 minutes; here the wraps are
        removed.
    angle_rad : float
        Angle in rad.
    sigma_rad : float
        Standard error of the angle, in rad. It includes the noise and the error of the calibrated
        line (angle over position). If the joint rests or `direction` is 0, it also includes the
        backlash.
    systematic_rad : float
        Part of `sigma_rad` that averaging does not reduce: everything except the noise.
    velocity_rad_s, velocity_sigma_rad_s : float or None
        Angular velocity and its standard error in rad/s, from times of the board's clock. The
        velocity is the mean over the last 3 readings in a fast movement, and over up to 8 in a slow
        movement. None before the third reading, and before the third one after a pause of 2 s or
        a restart of the board.
    direction : int
        Direction of the last movement: 1 towards larger angles, -1 towards smaller angles, 0 if
        unknown.
    within : bool
        Whether the angle is inside the calibrated range, extended by 5 % at both ends. Always true
        if the calibration file does not contain the noise of the angle.
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
    """Computes the angle of a joint from the readings of its strip.

    Parameters
    ----------
    joint : str, Path or calibrate.calibration_file.Joint
        Path of a calibration file that ``spots calibrate joint`` wrote, or the attribute ``joint``
        of a loaded calibration file.
    offset_rad, gain : float
        Mounting of the strip: the returned angle is ``offset_rad + gain * angle``, where ``angle``
        is computed with the calibration (the calibrated angle). `kinematics.calibrate` can measure
        offset and gain.

    Raises
    ------
    CalibrationError, SettingError
        If the calibration file cannot be read or is not that of a joint, or `offset_rad` or `gain`
        is invalid.

    Examples
    --------
    >>> encoder = spots_linkage.Encoder("joint.toml")
    >>> with spots.open_recording("run.spots", speed=float("inf")) as board:
    ...     angles = [encoder.take(touch) for touch in board.touches()]
    >>> sum(angle is not None for angle in angles)  # untrusted readings give None
    237

    Notes
    -----
    The joint moves an indenter, which presses the strip. With backlash between joint and indenter,
    the moving indenter lags behind the joint by half the backlash. When the indenter has moved by
    more than the noise, the direction of movement is known. From then on, half the backlash is
    added to the angle or subtracted from it.
    """

    def __init__(
        self, joint: Joint | str | PathLike[str] | None, offset_rad: float = 0.0, gain: float = 1.0
    ):
        source = "the given file"
        if isinstance(joint, (str, PathLike)):
            source, joint = joint, load(Path(joint)).joint
        if not isinstance(joint, Joint):
            raise CalibrationError(
                f"{source} is not the calibration of a joint: run 'spots calibrate joint'"
            )
        numbers = all(isinstance(one, (int, float)) for one in (offset_rad, gain))
        if not (numbers and math.isfinite(offset_rad) and math.isfinite(gain) and gain):
            raise SettingError(
                "offset and gain of an encoder must be finite numbers, and the gain must not be 0"
            )
        self.joint = joint
        self.offset_rad, self.gain = offset_rad, gain
        self._clock = ClockMap()
        self._recent: deque[tuple[float, float]] = deque(maxlen=_WINDOW)  # (device s, deg)
        self._since: list[float] = []  # first and last angles in deg since the last movement
        self._still_for = 0  # number of readings since the last movement
        self._direction = 0

    def take(self, touch: Touch) -> Angle | None:
        """Compute the joint's angle from a reading; return None if `touch.trusted` is false."""
        if not touch.trusted:
            return None
        joint = self.joint
        device_s = 1e-6 * self._clock.unwrap(touch.t_us)
        indenter_deg = joint.zero_deg + joint.deg_per_um * touch.position_um
        noise_deg = self._noise_deg(touch.position_um)
        if self._recent and not 0 < device_s - self._recent[-1][0] < _WINDOW_S:
            self._recent.clear()  # the board restarted, or no touch for a long time
        self._recent.append((device_s, indenter_deg))
        self._follow(indenter_deg, noise_deg)
        # A joint at rest may be anywhere in its backlash: a uniform distribution.
        moving = self._direction and self._still_for < _WINDOW
        backlash_var = 0.0 if moving else joint.backlash_deg**2 / 12
        # The accuracy is a mean absolute error: for normal errors, sqrt(pi / 2) times this value is
        # the standard error. Half the backlash is corrected below.
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
        """Return the standard deviation of angles from single readings at a position, in degrees.

        The noise grows exponentially with the distance from the sensor.
        """
        (low_um, low_deg), (high_um, high_deg) = self.joint.low, self.joint.high
        logs = np.log((low_deg, high_deg))
        return float(np.exp(np.interp(position_um, (low_um, high_um), logs)))

    def _within(self, position_um: float) -> bool:
        low_um, high_um = self.joint.low[0], self.joint.high[0]
        slack_um = _MARGIN * (high_um - low_um)
        return low_um - slack_um <= position_um <= high_um + slack_um

    def _follow(self, indenter_deg: float, noise_deg: float) -> None:
        """Update the direction of movement if the indenter has moved by more than the noise.

        A large movement is detected in one reading, a small one in means of up to 4 readings.
        """
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
        """Return velocity and its standard error in degrees per second; None if unknown.

        The velocity is the slope of a line through the last 3 readings. If it is not more than 10
        times its standard error, a fourth reading is added, and so on, up to 8. `noise_deg` is the
        standard deviation of the angles of single readings, in degrees.
        """
        slope = sigma = None
        for count in range(_WINDOW_LEAST, len(self._recent) + 1):
            time_s, deg = np.array(self._recent)[-count:].T
            from_middle_s = time_s - time_s.mean()
            spread = from_middle_s @ from_middle_s
            slope, sigma = float(from_middle_s @ deg / spread), noise_deg / math.sqrt(spread)
            if abs(slope) > _CLEAR * sigma:
                break
        return slope, sigma
