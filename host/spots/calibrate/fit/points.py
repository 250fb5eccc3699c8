"""Presses that a session asks for, and those that were taken, as they stand in a session file."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
import numpy as np

from spots_device.reading.calibration import Conditions

from .presses import Presses


def _ranged(low: float, high: float) -> msgspec.Meta:
    """Return the limits of a number in a file, which also exclude infinite numbers."""
    return msgspec.Meta(ge=low, le=high)


# Limits of the numbers in session files and calibration files: each is beyond what can be measured.
PlaceUm = Annotated[float, _ranged(-1e5, 2e6)]  # a strip has at most 1 m, stretched by 50 %
ForceMN = Annotated[float, _ranged(0, 1e6)]
Ppm = Annotated[int, _ranged(0, 1_000_000)]
Degrees = Annotated[float, _ranged(-1e5, 1e5)]
Sigma = Annotated[float, _ranged(0, 1e9)]
LengthUm = Annotated[float, _ranged(1, 1e6)]
Seconds = Annotated[float, _ranged(0, 1e12)]
_BEYOND_UM = 1000.0  # largest distance of a press beyond an end of the strip
_LEAST_MN = 0.1  # a smaller force was not typed by a person, nor set by a stage
_Count = Annotated[float, _ranged(-1e6, 1e6)]
_Number = Annotated[float, _ranged(-1e12, 1e12)]
_Counts = Annotated[tuple[_Count, ...], msgspec.Meta(min_length=6, max_length=6)]
_Six = Annotated[tuple[_Number, ...], msgspec.Meta(min_length=6, max_length=6)]
_Baseline = Annotated[tuple[_Number, ...], msgspec.Meta(max_length=6)]
_Seven = Annotated[tuple[_Number, ...], msgspec.Meta(min_length=7, max_length=7)]
Plan = Annotated[tuple[str, ...], msgspec.Meta(min_length=6, max_length=6)]
Gain = Annotated[int, _ranged(0, 10)]
ExposureUs = Annotated[int, _ranged(1, 10_000_000)]
LedMA = Annotated[int, _ranged(0, 1000)]


class Wanted(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A press that a session asks for.

    - `kind`: ``choose`` is for the choice of exposure and channels, ``mark`` for a re-zero,
      ``hand`` for a press by hand. ``position``, ``force``, ``strain`` and ``joint`` are steps of
      ``spots calibrate``.
    - `place_um`: distance from the strip's end at the sensor, measured while the strip has its
      strain. 0 for a joint that a person turns.
    - `force_mN`: 0 if the force is unknown.
    - `strain_ppm`: elongation over length at rest.
    - `angle_deg`: angle of the joint; None without a joint.
    - `direction`: in which the joint was turned: 1 upwards, -1 downwards; 0 for other kinds.
    - `then_mN`: second force, to which the person changes without a release; 0 for one force.
    - `hold_s`: least time for which the person must hold `force_mN`.
    """

    kind: Literal["choose", "position", "force", "strain", "joint", "mark", "hand"]
    place_um: PlaceUm
    force_mN: ForceMN
    strain_ppm: Ppm = 0
    angle_deg: Degrees | None = None
    direction: Literal[-1, 0, 1] = 0
    then_mN: ForceMN = 0.0
    hold_s: Seconds = 0.0

    def __str__(self) -> str:
        if self.angle_deg is not None:
            return f"the joint at {self.angle_deg:g} degrees"
        force = f" with {self.force_mN / 1000:.4g} N" if self.force_mN else ""
        return f"{self.place_um / 1000:.1f} mm{force}"


class Point(Wanted, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A press that was taken, with its reading, board and settings.

    - `counts`, `variance`, `saturated`: see `spectra.Reading`.
    - `position_um`, `position_sigma_um`: mean and standard deviation of the positions that the
      calibrated board reported; None if the kind is not ``joint``.
    - `length_um`: length of the strip at rest; None for a joint.
    - `board`, `plan`, `gain`, `exposure_us`, `led_mA`: see
      `spots_device.reading.calibration.Conditions`.
    - `time`: date and time in UTC, ISO 8601.
    - `trace`: all readings of a press by hand with a known force: time in s by the clock of
      `Board.now_s`, then the six counts.
    - `holds`: start and end of the time in which each force was steady, in s by the same clock.
    - `baseline`: light of the untouched strip in counts of a sample, which was subtracted from
      `counts`; empty if the strip had no such light.
    """

    counts: _Counts
    variance: _Six
    saturated: bool
    position_um: PlaceUm | None = None
    position_sigma_um: Sigma | None = None
    length_um: LengthUm | None = None
    board: str
    plan: Plan
    gain: Gain
    exposure_us: ExposureUs
    led_mA: LedMA
    time: str
    trace: tuple[_Seven, ...] = ()
    holds: tuple[tuple[Seconds, Seconds], ...] = ()
    baseline: _Baseline = msgspec.field(default=(), name="rest")  # its name in a file

    def __post_init__(self):
        # msgspec reports a ValueError as a wrong value of the file.
        if self.kind == "joint":
            if None in (self.angle_deg, self.position_um, self.position_sigma_um):
                raise ValueError("a joint needs angle_deg, position_um and position_sigma_um")
        elif self.kind != "choose" and min(self.counts) <= 0:
            raise ValueError("the counts of a press must be above 0")
        if 0 < self.force_mN < _LEAST_MN:
            raise ValueError("force_mN is too small for a press")
        longest_um = (self.length_um or np.inf) * (1 + self.strain_ppm * 1e-6)
        if not -_BEYOND_UM <= self.place_um <= longest_um + _BEYOND_UM:
            raise ValueError("place_um is not on the strip")

    @property
    def conditions(self) -> Conditions:
        """Board and settings of the reading."""
        return Conditions(self.board, self.plan, self.gain, self.exposure_us, self.led_mA)


def presses(points: list[Point]) -> Presses:
    """Return points as arrays, sorted by force and then by place."""
    points = sorted(points, key=lambda p: (p.force_mN, p.place_um))
    names = ("place_um", "force_mN", "counts", "variance", "saturated")
    return Presses(*(np.array([getattr(p, name) for p in points]) for name in names))
