"""Measures the error of a digital twin of a simulated linkage, over the workspace and on a path.

The twin (`spots_linkage.Twin`) computes the position of the end point from readings of the strips.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spots.errors import SettingError
from spots_linkage import kinematics
from spots_linkage.digital_twin import Terminal, Twin
from spots_linkage.encoder import Angle
from spots_linkage.fivebar import Linkage
from spots_linkage.twin_points import mean_angle

from ..person.mechanism import Mechanism, Motion, guided
from ..strip.files import LinkageFile, PathFile, SensorFile
from .simulated_linkage import EXPOSURE_US, Simulation, start_s, visited

# Smallest angle between the outer bars in the workspace; a usual limit for transmission angles.
LEAST_OUTER_RAD = np.radians(30)
CALIBRATION_PLACES = 40
PLACE_SIGMA_MM = 0.02  # standard deviation of the measured positions of the end point
# Frame in which these positions are measured: x and y of joint 1, and the rotation.
_GRID = {"frame_x_mm": 12.0, "frame_y_mm": -7.0, "frame_rad": 0.03, "frame_scale": 1.0}
_DRAWS = 2000  # number of random draws for the expected errors


@dataclass(frozen=True)
class Deviation:
    """Distances between estimated and true positions of the end point."""

    error_mm: np.ndarray

    @property
    def mean_mm(self) -> float:
        return float(np.mean(self.error_mm))

    @property
    def max_mm(self) -> float:
        return float(np.max(self.error_mm))


@dataclass(frozen=True)
class Survey:
    """Errors of a linkage's digital twin, measured at rest at positions of the workspace.

    `drawn` has the nominal lengths and mounting angles, `given` the true ones, `calibrated` those
    of a kinematic calibration that started from the nominal values; `rested` is `calibrated` with
    the mean of all readings at a position, not with one reading. The expected errors are those of
    the true lengths, from the standard errors of the joint angles.
    """

    x_mm: np.ndarray
    y_mm: np.ndarray
    drawn: Deviation
    given: Deviation
    calibrated: Deviation
    rested: Deviation
    expected_mean_mm: float
    expected_max_mm: float
    kinematics: kinematics.Kinematics


def survey(
    sensor: SensorFile,
    linkage: LinkageFile,
    seed: int = 0,
    exposure_us: int = 100_000,
    pitch_mm: float = 10.0,
    **condition: bool,
) -> Survey:
    """Calibrate a simulated five-bar linkage, then measure its digital twin's error on a grid.

    The digital twin (`spots_linkage.Twin`) computes the position of the end point from readings of
    the strips, of one exposure each. The grid covers the workspace. The conditions are those of
    `simulated_linkage.Simulation`. SpotsError if scipy is missing, or the sensor cannot be
    calibrated.
    """
    mechanism = Mechanism(linkage, sensor)
    rng = np.random.default_rng(seed)
    drawn = Linkage(linkage.bar_mm, linkage.base_mm)
    given = Linkage(mechanism.bar_mm, mechanism.base_mm)
    x_mm, y_mm = working(given, mechanism, *_grid(given, pitch_mm, rng))
    # The calibration uses other positions than the grid.
    few = working(given, mechanism, *_grid(given, pitch_mm, rng, jitter_mm=pitch_mm / 2))
    few = [axis[:CALIBRATION_PLACES] for axis in few]
    few, (_, (angles, sigmas)) = _read(sensor, linkage, few, seed, exposure_us, 0, **condition)
    seen = kinematics.framed(_GRID, *few)
    found = kinematics.calibrate(
        angles,
        *(axis + PLACE_SIGMA_MM * rng.standard_normal(len(axis)) for axis in seen),
        drawn,
        angle_sigma_rad=sigmas,
        place_sigma_mm=PLACE_SIGMA_MM,
        offset_rad=np.radians(linkage.lowest_deg),
    )
    (x_mm, y_mm), ((angles, sigmas), (means, _)) = _read(
        sensor, linkage, (x_mm, y_mm), seed, exposure_us, 1, **condition
    )
    theta = angles + np.reshape(mechanism.zero_rad, (2, 1))
    noise_mm = _expected(given, theta, sigmas, rng)
    return Survey(
        x_mm,
        y_mm,
        _deviation(
            drawn.forward(*(angles + np.radians(linkage.lowest_deg)[:, None])), (x_mm, y_mm)
        ),
        _deviation(given.forward(*theta), (x_mm, y_mm)),
        _deviation(found.terminal(angles), kinematics.framed(_GRID, x_mm, y_mm)),
        _deviation(found.terminal(means), kinematics.framed(_GRID, x_mm, y_mm)),
        float(noise_mm.mean()),
        float(noise_mm.max(axis=1).mean()),
        found,
    )


@dataclass(frozen=True)
class PathRun:
    """Estimates of a digital twin with the true lengths, during a motion on a path.

    `error_mm` leaves out the entries of `terminals` without a position, see `Terminal.limit`.
    `lost` counts frames.
    """

    motion: Motion
    linkage: Linkage
    terminals: list[Terminal]
    error_mm: np.ndarray
    lost: int

    def summary(self) -> dict:
        """Return the results of the run.

        ``beyond_limits`` counts the pairs of joint angles for which the linkage has no position;
        ``expected_rms_mm`` is that of the standard errors that the twin reports.
        """
        estimated = [terminal for terminal in self.terminals if not terminal.limit]
        span_s = estimated[-1].time_s - estimated[0].time_s
        expected_mm = np.sqrt(np.mean([terminal.sigma_mm**2 for terminal in estimated]))
        return {
            "seconds": round(span_s, 3),
            "terminals": len(estimated),
            "rate_hz": round((len(estimated) - 1) / span_s, 2),
            "beyond_limits": len(self.terminals) - len(estimated),
            "lost": self.lost,
            "error_mm": {
                "mean": round(float(self.error_mm.mean()), 4),
                "p95": round(float(np.percentile(self.error_mm, 95)), 4),
                "max": round(float(self.error_mm.max()), 4),
                "rms": round(float(np.sqrt(np.mean(self.error_mm**2))), 4),
            },
            "expected_rms_mm": round(float(expected_mm), 4),
        }


def follow(
    sensor: SensorFile,
    linkage: LinkageFile,
    path: PathFile,
    seed: int = 0,
    exposure_us: int = EXPOSURE_US,
    report=lambda terminal: None,
    **condition: bool,
) -> PathRun:
    """Move the end point of a simulated linkage along a path; compare path and digital twin.

    ``report(terminal)`` is called with each estimate. The conditions are ``rezeroed`` and
    ``misfits`` of `simulated_linkage.Simulation`. SpotsError if the linkage cannot follow the path,
    the path is too short for two estimates, or the sensor cannot be calibrated.
    """
    begin_s = start_s(sensor)
    motion = guided(path, begin_s)
    with Simulation(sensor, linkage, motion, seed, exposure_us, **condition) as simulation:
        true = Linkage(simulation.mechanism.bar_mm, simulation.mechanism.base_mm)
        twin = Twin(true, simulation.encoders())
        terminals = []
        for terminal in twin.follow(simulation.readings()):
            if begin_s <= terminal.time_s <= motion.seconds:
                terminals.append(terminal)
                report(terminal)
        lost = sum(board.stats.lost for board in simulation.boards)
    found = np.array([(t.time_s, t.x_mm, t.y_mm) for t in terminals if not t.limit]).T
    if found.size < 6:
        raise SettingError(
            "the path gives fewer than two positions of the end point: name the file of a longer "
            "path"
        )
    x_mm, y_mm = motion.at(found[0])
    return PathRun(motion, true, terminals, np.hypot(found[1] - x_mm, found[2] - y_mm), lost)


def working(
    linkage: Linkage, mechanism: Mechanism, x_mm: np.ndarray, y_mm: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return those positions that are in the workspace.

    In the workspace, y > 0, both joints are within their travel, and the angle between the outer
    bars is at least `LEAST_OUTER_RAD`.
    """
    theta = linkage.inverse(x_mm, y_mm)
    apart = np.ma.filled(linkage.outer_angle(*theta), 0.0)
    fit = (apart >= LEAST_OUTER_RAD) & mechanism.reaches(x_mm, y_mm) & (np.asarray(y_mm) > 0)
    return x_mm[fit], y_mm[fit]


def _grid(linkage: Linkage, pitch_mm: float, rng, jitter_mm: float = 0.0):
    """Return x and y in mm of a grid that covers a linkage's reach, in random order.

    Each position is moved by a random distance of at most `jitter_mm` along x and y.
    """
    a1, b1, b2, a2 = linkage.bar_mm
    left, right = linkage.base_mm - a2 - b2, a1 + b1
    x_mm, y_mm = (
        axis.ravel()
        for axis in np.meshgrid(
            np.arange(left, right, pitch_mm), np.arange(pitch_mm / 2, a1 + b1, pitch_mm)
        )
    )
    order = rng.permutation(len(x_mm))
    x_mm, y_mm = x_mm[order], y_mm[order]
    if jitter_mm:
        x_mm, y_mm = (axis + rng.uniform(-jitter_mm, jitter_mm, len(axis)) for axis in (x_mm, y_mm))
    return x_mm, y_mm


def _read(sensor, linkage, places, *arguments, **condition):
    """Read both joints at rest at `places` (x, y in mm), with further arguments of `visited`.

    Returns the positions, then two pairs of joint angles and standard errors, shape (2, n): one for
    the middle reading of each stop, one for the mean of the readings of each stop. A position is
    left out if its stop has no reading, because the LED was off for a dark frame.
    """
    read = visited(sensor, linkage, *places, *arguments, **condition)
    there = np.array([[bool(angles) for angles in joint] for joint in read]).all(axis=0)
    pairs = []
    for chosen in (_middle, list):
        means = [
            [mean_angle(chosen(angles)) for angles, is_there in zip(joint, there) if is_there]
            for joint in read
        ]
        pairs.append(np.moveaxis(np.array(means), -1, 0))
    return [axis[there] for axis in places], pairs


def _middle(angles: list[Angle]) -> list[Angle]:
    # The first reading may contain a part of the movement if the board's clock is fast.
    return angles[len(angles) // 2 :][:1]


def _deviation(found, truth) -> Deviation:
    return Deviation(np.ma.filled(np.hypot(found[0] - truth[0], found[1] - truth[1]), np.inf))


def _expected(linkage: Linkage, theta, sigmas, rng) -> np.ndarray:
    """Return position errors in mm that random angle errors cause, shape (`_DRAWS`, n).

    `theta` are joint angles and `sigmas` their standard errors in rad, shape (2, n) for n
    positions. `_DRAWS` is the number of random errors at each position; `rng` generates them.
    """
    jacobian = np.asarray(linkage.jacobian(*theta))
    draws = sigmas.T * rng.standard_normal((_DRAWS, *sigmas.T.shape))
    return np.hypot(*np.moveaxis(np.einsum("nij,dnj->dni", jacobian, draws), -1, 0))
