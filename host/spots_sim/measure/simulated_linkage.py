"""A simulated five-bar linkage with a strip in each base joint, read through virtual boards."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from spots.calibrate.calibration_file import CalibrationFile, now
from spots.calibrate.session.joint import fit_joint, joint_marks
from spots.calibrate.session.rezero import rezero
from spots.link.board import Board
from spots.link.connect import prepare
from spots.link.frames import Touch
from spots_device.reading import decode
from spots_linkage.digital_twin import readings
from spots_linkage.encoder import Angle, Encoder
from spots_linkage.fivebar import Linkage
from spots_linkage.twin_points import LASTS_S

from ..board.identity import board_id
from ..board.lockstep import LockstepLink
from ..board.paced import PacedLink
from ..person.kept import kept
from ..person.mechanism import (
    Mechanism,
    Motion,
    closed,
    dwelling,
    guided,
)
from ..person.stage import WARM_S, board_lines, set_as_calibrated, strip_lines
from ..person.stage_presser import StagePresser
from ..strip.files import LinkageFile, PathFile, SensorFile
from .rezeroed import silent_bench
from .rig import Rig

PATH, EXPOSURE_US = "sust", 30_000  # defaults
START_S = 2.0  # start of a motion; by then the boards are open and stream
_ANGLES = 11  # angles in each direction, as in `spots calibrate joint`
_WINDOW = 24  # readings at each angle
_MOVE_S = 0.1
_APART = 0.4  # delay between the two boards' exposures, as a share of an exposure


class Turned(NamedTuple):
    """Measurement of a joint at one angle, for `spots.calibrate.session.joint.fit_joint`.

    `direction` is 1 if the angle was reached from below, -1 if from above. `counts` are the six
    dark-subtracted means.
    """

    angle_deg: float
    direction: int
    position_um: float
    position_sigma_um: float
    counts: np.ndarray


@kept(CalibrationFile)
def calibrated(
    sensor: SensorFile, seed: int, exposure_us: int, rezeroed: bool = False
) -> CalibrationFile:
    """Calibrate a simulated strip and the joint in which it is mounted.

    The strip is calibrated before the change of the table ``[change]``. With `rezeroed`, the
    calibration is corrected after it, at three angles of the joint.
    """
    up = np.linspace(0, sensor.joint_travel_deg, _ANGLES).tolist()
    points = []
    with Rig(sensor, seed, exposure_us, 1) as rig:
        for angle, way in [(one, 1) for one in up] + [(one, -1) for one in reversed(up)]:
            touches, counts = rig.turned(angle, way, _WINDOW)
            places_um = [touch.position_um for touch in touches]
            points.append(
                Turned(
                    angle,
                    way,
                    float(np.mean(places_um)),
                    float(np.std(places_um, ddof=1)),
                    counts.mean(axis=0),
                )
            )
        made = CalibrationFile(
            date=now(),
            **rig.conditions._asdict(),
            lines=rig.lines,
            joint=fit_joint(points),
            joint_marks=joint_marks(points),
        )
        if rezeroed:
            rig.stage.held.changed = sensor.change
            made = rezero(silent_bench(rig.stage, StagePresser(rig.stage)), made, joint=True)
        return made


class Simulation:
    """A linkage that follows a motion one time; virtual boards read the strips in its two joints.

    Call `close` at the end, or use a ``with`` statement. The motion must begin at
    ``start_s(sensor)``. The same seed gives the same two strips; runs of another number differ in
    noise only. With `rezeroed`, the calibrations were corrected after the table ``[change]``; with
    `misfits`, readings are used even if their spectrum does not fit the calibration. With
    `one_board`, both strips have one board, which is twice in `boards`. `mechanism` is the true
    linkage.
    """

    def __init__(
        self,
        sensor: SensorFile,
        linkage: LinkageFile,
        motion: Motion,
        seed: int,
        exposure_us: int,
        run: int = 0,
        rezeroed: bool = False,
        misfits: bool = False,
        one_board: bool = False,
    ):
        self.mechanism = Mechanism(linkage, sensor)
        self.motion = motion
        self._misfits = decode.MISFIT if misfits else 0
        scenarios = self.mechanism.drive(motion)
        noise = _seeds(seed, run + 1)
        numbers = _seeds(seed, 0)
        if one_board:
            numbers = numbers[:1] * 2
        self.strips = [
            of_board(strip, board_id(sensor, number))
            for strip, number in zip(_strips(sensor, seed, exposure_us, rezeroed), numbers)
        ]
        on_s = start_s(sensor) - START_S
        self._sensors = (0, 1) if one_board else (0, 0)
        with ExitStack() as opened:
            self.boards: list[Board] = []
            if one_board:
                second = scenarios[1], noise[1]
                link = LockstepLink(
                    sensor,
                    scenarios[0],
                    noise[0],
                    started_s=on_s,
                    second=second,
                    number=numbers[0],
                )
                self.boards = [opened.enter_context(Board(link))] * 2
                self.strips[1] = moved(self.strips[1], 1)
                for i, strip in enumerate(self.strips):
                    set_as_calibrated(self.boards[i], sensor, i)
                    prepare(self.boards[i], strip.lines, i)
                scenarios = ()
            for i, (strip, scenario, s) in enumerate(zip(self.strips, scenarios, noise)):
                # Real boards do not start at the same moment, so their exposures are shifted.
                started_s = on_s + _APART * i * exposure_us * 1e-6
                link = LockstepLink(sensor, scenario, s, started_s=started_s, number=numbers[i])
                self.boards.append(opened.enter_context(Board(link)))
                set_as_calibrated(self.boards[-1], sensor)
                prepare(self.boards[-1], strip.lines)
            self._opened = opened.pop_all()

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *exception) -> None:
        self.close()

    def close(self) -> None:
        """Stop the boards."""
        self._opened.close()

    def encoders(self, offset_rad: Sequence[float] | None = None) -> tuple[Encoder, Encoder]:
        """Return an `Encoder` for each joint; the mounting angles are the true ones by default."""
        offset_rad = self.mechanism.zero_rad if offset_rad is None else offset_rad
        return tuple(Encoder(strip.joint, one) for strip, one in zip(self.strips, offset_rad))

    def readings(self) -> Iterator[tuple[int, Touch]]:
        """Yield pairs of joint index (0 or 1) and reading until the end of the motion."""
        left_s = self.motion.seconds - max(board.now_s() for board in self.boards)
        for joint, touch in readings(self.boards, self._sensors, left_s):
            yield joint, touch._replace(flags=touch.flags & ~self._misfits)


class Endless:
    """A simulated five-bar linkage that repeats a path without end, in real time.

    `linkage` has its true lengths.
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
        self._numbers = _seeds(seed, 0)
        self._strips = [
            of_board(strip, board_id(sensor, number))
            for strip, number in zip(_strips(sensor, seed, exposure_us), self._numbers)
        ]
        self._epoch_s = time.monotonic()
        self.linkage = Linkage(self._mechanism.bar_mm, self._mechanism.base_mm)

    def encoders(self) -> tuple[Encoder, Encoder]:
        """Return an `Encoder` for each joint, with the true mounting angle of its strip."""
        zeros = self._mechanism.zero_rad
        return tuple(Encoder(strip.joint, zero) for strip, zero in zip(self._strips, zeros))

    def open(self, joint: int) -> Board:
        """Start the board of a joint (0 or 1) and return it; the caller must close it."""
        link = LockstepLink(
            self._sensor,
            self._scenarios[joint],
            _seeds(self._seed, 1)[joint],
            started_s=time.monotonic() - self._epoch_s,
            number=self._numbers[joint],
        )
        board = Board(PacedLink(link, self._epoch_s))
        try:
            set_as_calibrated(board, self._sensor)
            prepare(board, self._strips[joint].lines)
        except BaseException:
            board.close()
            raise
        return board


def start_s(sensor: SensorFile) -> float:
    """Return the earliest start of a motion in s: by then, boards stream and the LED is warm."""
    return START_S + (WARM_S if sensor.temperature.led_K_per_mA else 0.0)


def moved(strip: CalibrationFile, number: int) -> CalibrationFile:
    """Return a copy of strip 0's calibration that is valid for another strip of the same board."""
    lines = tuple(strip_lines(strip.lines, number))
    return msgspec.structs.replace(strip, board=f"{strip.board}-{number}", lines=lines)


def of_board(strip: CalibrationFile, board: str) -> CalibrationFile:
    """Return a copy of a calibration that is valid for another board."""
    lines, original = (tuple(board_lines(one, board)) for one in (strip.lines, strip.original))
    return msgspec.structs.replace(strip, board=board, lines=lines, original=original)


def _strips(
    sensor: SensorFile, seed: int, exposure_us: int, rezeroed: bool = False
) -> list[CalibrationFile]:
    return [calibrated(sensor, s, exposure_us, rezeroed) for s in _seeds(seed, 0)]


def _seeds(seed: int, what: int) -> list[int]:
    """Return a random seed for each of the two strips.

    The seeds are for the strips' properties if `what` is 0; otherwise, for the noise of a run.
    """
    return [int(s) for s in np.random.SeedSequence((seed, what)).generate_state(2)]


def visited(
    sensor: SensorFile,
    linkage: LinkageFile,
    x_mm: ArrayLike,
    y_mm: ArrayLike,
    seed: int,
    exposure_us: int,
    run: int = 0,
    **condition: bool,
) -> list[list[list[Angle]]]:
    """Stop the end point at each position for a second; return angles by joint and position.

    The angles are corrected for backlash, and counted from the zero of the joint's calibration.
    Runs of one seed have the same strips, but different noise. The conditions are those of
    `Simulation`.
    """
    dwell_s = LASTS_S + 1.5e-6 * exposure_us
    motion = dwelling(x_mm, y_mm, start_s(sensor), dwell_s, _MOVE_S)
    read: list[list[list[Angle]]] = [[[] for _ in x_mm] for _ in range(2)]
    with Simulation(sensor, linkage, motion, seed, exposure_us, run, **condition) as simulation:
        encoders = simulation.encoders((0.0, 0.0))
        half_s = 0.5e-6 * exposure_us
        for joint, touch in simulation.readings():
            angle = encoders[joint].take(touch)
            if angle is None:
                continue
            # Use only readings whose whole exposure lies within a stop.
            i = int(np.searchsorted(motion.time_s, touch.time_s - half_s))
            if i % 2 and i < len(motion.time_s) and touch.time_s + half_s <= motion.time_s[i]:
                read[joint][i // 2].append(angle)
    return read
