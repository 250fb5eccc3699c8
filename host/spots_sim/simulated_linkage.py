"""A simulated linkage, whose two strips are read through two virtual boards in simulated time."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from spots.calibrate.calibration_file import CalibrationFile
from spots.calibrate.joint import fit_joint
from spots.link.board import Board
from spots.link.connect import prepare
from spots.link.frames import Touch
from spots.linkage.digital_twin import readings
from spots.linkage.encoder import Encoder
from spots.linkage.fivebar import Linkage

from .files import LinkageFile, PathFile, SensorFile
from .lockstep import LockstepLink
from .mechanism import Mechanism, Motion, closed, dwelling, guided
from .paced import PacedLink
from .rig import Rig
from .stage import set_led

PATH, EXPOSURE_US = "sust", 30_000  # unless others are named
START_S = 2.0  # by then the boards are open and stream
_ANGLES = 11  # as `spots calibrate joint` asks for, up and down
_WINDOW = 24  # readings of each
_MOVE_S = 0.1
_APART = 0.4  # of an exposure


class Turned(NamedTuple):
    """A joint that was turned to an angle and held, as `fit_joint` takes them."""

    angle_deg: float
    direction: int
    position_um: float
    position_sigma_um: float


@lru_cache(maxsize=16)
def calibrated(
    sensor: SensorFile, linkage: LinkageFile, seed: int, exposure_us: int
) -> CalibrationFile:
    """Calibrate a strip, then its joint, as a person would do before mounting both.

    Parameters
    ----------
    sensor : SensorFile
    linkage : LinkageFile
        For the travel of the indenter.
    seed : int
        Of the noise.
    exposure_us : int

    Returns
    -------
    CalibrationFile
        With a joint.
    """
    mechanism = Mechanism(linkage, sensor)
    angles_deg = np.linspace(0, mechanism.travel_deg, _ANGLES)
    points = []
    with Rig(sensor, seed, exposure_us, 1) as rig:
        sweep = np.concatenate([angles_deg, angles_deg[::-1]])
        ways = np.repeat([1, -1], _ANGLES)
        # From well below, so that the first angle is reached upwards, and the last ones downwards.
        scenario = mechanism.turn(
            np.arange(2 * _ANGLES + 2),
            np.concatenate([[-1.0], sweep[:_ANGLES], [mechanism.travel_deg + 1], sweep[_ANGLES:]]),
        )
        held = np.delete(np.arange(2 * _ANGLES + 2), [0, _ANGLES + 1])
        for angle, way, moment in zip(sweep.tolist(), ways.tolist(), held.tolist()):
            (press,) = scenario.presses(moment)
            rig.stage.held.bend_deg = angle
            touches, _ = rig.readings(1000 * press.position_mm, press.force_mN, _WINDOW)
            places_um = [touch.position_um for touch in touches]
            points.append(
                Turned(angle, way, float(np.mean(places_um)), float(np.std(places_um, ddof=1)))
            )
        return CalibrationFile.now(rig.conditions, rig.lines, [], fit_joint(points))


class Simulation:
    """Two boards on a linkage that goes through a motion once. Close it, or use ``with``.

    Parameters
    ----------
    sensor : SensorFile
    linkage : LinkageFile
    motion : Motion
        Begins at `START_S`.
    seed : int
        Of the noise, of which each board has its own. The same seed has the same two strips.
    exposure_us : int
    run : int
        Of the same strips: other noise.

    Attributes
    ----------
    mechanism : Mechanism
    strips : list of CalibrationFile
    boards : list of Board
    """

    def __init__(
        self,
        sensor: SensorFile,
        linkage: LinkageFile,
        motion: Motion,
        seed: int,
        exposure_us: int,
        run: int = 0,
    ):
        self.mechanism = Mechanism(linkage, sensor)
        self.motion = motion
        scenarios = self.mechanism.drive(motion)
        noise = _seeds(seed, run + 1)
        self.strips = _strips(sensor, linkage, seed, exposure_us)
        with ExitStack() as opened:
            self.boards: list[Board] = []
            for i, (strip, scenario, s) in enumerate(zip(self.strips, scenarios, noise)):
                # Two boards are not switched on at the same moment, and never read at the same.
                on_s = _APART * i * exposure_us * 1e-6
                link = LockstepLink(sensor, scenario, s, started_s=on_s)
                self.boards.append(opened.enter_context(Board(link)))
                set_led(self.boards[-1], sensor)
                prepare(self.boards[-1], strip.lines)
            self._opened = opened.pop_all()

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *exception) -> None:
        self.close()

    def close(self) -> None:
        """End both boards."""
        self._opened.close()

    def encoders(self, offset_rad=None) -> tuple[Encoder, Encoder]:
        """Return new encoders; with the true mounting unless given."""
        offset_rad = self.mechanism.zero_rad if offset_rad is None else offset_rad
        return tuple(Encoder(strip.joint, one) for strip, one in zip(self.strips, offset_rad))

    def readings(self) -> Iterator[tuple[int, Touch]]:
        """Yield (joint, reading) until the motion is over."""
        left_s = self.motion.seconds - max(board.now_s() for board in self.boards)
        return readings(self.boards, left_s)


class Endless:
    """A linkage that goes along a path again and again, in real time from now on.

    Parameters
    ----------
    sensor : SensorFile
    linkage : LinkageFile
    path : PathFile
    seed : int
    exposure_us : int

    Attributes
    ----------
    linkage : Linkage
        As it truly is.
    """

    def __init__(
        self,
        sensor: SensorFile,
        linkage: LinkageFile,
        path: PathFile,
        seed: int = 0,
        exposure_us: int = EXPOSURE_US,
    ):
        self._mechanism = Mechanism(linkage, sensor)
        self._sensor, self._seed = sensor, seed
        self._scenarios = self._mechanism.drive(guided(closed(path), START_S), again=True)
        self._strips = _strips(sensor, linkage, seed, exposure_us)
        self._epoch_s = time.monotonic()
        self.linkage = Linkage(self._mechanism.bar_mm, self._mechanism.base_mm)

    def encoders(self) -> tuple[Encoder, Encoder]:
        """Return new encoders, mounted as they truly are."""
        zeros = self._mechanism.zero_rad
        return tuple(Encoder(strip.joint, zero) for strip, zero in zip(self._strips, zeros))

    def open(self, joint: int) -> Board:
        """Power up the board of a joint and open it."""
        link = LockstepLink(
            self._sensor,
            self._scenarios[joint],
            _seeds(self._seed, 1)[joint],
            started_s=time.monotonic() - self._epoch_s,
        )
        board = Board(PacedLink(link, self._epoch_s))
        try:
            set_led(board, self._sensor)
            prepare(board, self._strips[joint].lines)
        except BaseException:
            board.close()
            raise
        return board


def _strips(
    sensor: SensorFile, linkage: LinkageFile, seed: int, exposure_us: int
) -> list[CalibrationFile]:
    return [calibrated(sensor, linkage, s, exposure_us) for s in _seeds(seed, 0)]


def _seeds(seed: int, what: int) -> list[int]:
    """Return a seed for each of the two strips, or for the noise of their boards in a run."""
    return [int(s) for s in np.random.SeedSequence((seed, what)).generate_state(2)]


def visited(
    sensor: SensorFile,
    linkage: LinkageFile,
    x_mm,
    y_mm,
    seed: int,
    exposure_us: int,
    run: int = 0,
) -> tuple[np.ndarray, np.ndarray]:
    """Stop the terminal at each place and take one reading of each joint there.

    Parameters
    ----------
    sensor : SensorFile
        Of both strips.
    linkage : LinkageFile
    x_mm, y_mm : array_like, shape (n,)
        Places of the terminal.
    seed : int
        Of the noise.
    exposure_us : int
        Of both strips.
    run : int
        Distinguishes the noise of runs with one seed.

    Returns
    -------
    angles_rad, sigmas_rad : numpy.ndarray, shape (2, n)
        By the joints' own calibration, with the backlash taken into account; and standard errors.
    """
    motion = dwelling(x_mm, y_mm, START_S, 2.5e-6 * exposure_us, _MOVE_S)
    found = np.full((2, 2, len(x_mm)), np.nan)
    with Simulation(sensor, linkage, motion, seed, exposure_us, run) as simulation:
        encoders = simulation.encoders((0.0, 0.0))
        half_s = 0.5e-6 * exposure_us
        for joint, touch in simulation.readings():
            angle = encoders[joint].take(touch)
            # Between two waypoints with the same place, for the whole of its exposure.
            i = int(np.searchsorted(motion.time_s, touch.time_s - half_s))
            if i % 2 and i < len(motion.time_s) and touch.time_s + half_s <= motion.time_s[i]:
                found[:, joint, i // 2] = angle.angle_rad, angle.sigma_rad
    return found[0], found[1]
