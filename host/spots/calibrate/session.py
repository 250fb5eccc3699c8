"""Session files: each line is a press and its reading in JSON.

A line is on disk before the session asks for the next press. A session asks for the presses of a
calibration. For a press *by hand*, the person then reads its true position off a ruler, and its
force off a scale. Marks are positions that a re-zero (``spots rezero``) presses again, to measure
drift.
"""

from __future__ import annotations

import os
from datetime import datetime, timezone
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np

from spots_device.reading.calibration import Conditions

from .. import atomic
from ..bounded import SESSION_MAX_BYTES, read_bytes
from ..errors import SpotsError
from .presses import Presses
from .spectra import Reading

_SAME_UM, _SAME_SHARE = 1.0, 1e-3  # limits for the same press: position, share of the force
_SAME_LENGTH_UM = 100.0  # resolution of a ruler


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
_Seven = Annotated[tuple[_Number, ...], msgspec.Meta(min_length=7, max_length=7)]
Plan = Annotated[tuple[str, ...], msgspec.Meta(min_length=6, max_length=6)]
Gain = Annotated[int, _ranged(0, 10)]
ExposureUs = Annotated[int, _ranged(1, 10_000_000)]
LedMA = Annotated[int, _ranged(0, 1000)]


class Wanted(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A press that a session asks for.

    Attributes
    ----------
    kind : str
        Purpose of the press. ``choose`` is for the choice of exposure and channels, ``mark`` for a
        re-zero, ``hand`` for a press by hand. ``position``, ``force``, ``strain`` and ``joint`` are
        steps of ``spots calibrate``.
    place_um : float
        Distance from the strip's end at the sensor in um, measured while the strip has its strain.
        0 for a joint that a person turns.
    force_mN : float
        Force in mN; 0 if the force is unknown.
    strain_ppm : int
        Strain of the strip: elongation over length at rest, in ppm.
    angle_deg : float or None
        Angle of the joint in degrees; None without a joint.
    direction : int
        Direction in which the joint was turned: 1 upwards, -1 downwards; 0 if the kind is not
        ``joint``.
    then_mN : float
        Second force in mN, to which the person changes without a release; 0 for a press with one
        force.
    hold_s : float
        Least time for which the person must hold `force_mN`, in s.
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
    """A press that was taken, with its reading.

    Attributes
    ----------
    counts, variance, saturated
        Reading of the press, see `spectra.Reading`.
    position_um, position_sigma_um : float or None
        Mean and standard deviation of the positions that the calibrated board reported, in um; None
        if the kind is not ``joint``.
    length_um : float or None
        Length of the strip at rest in um; None for a joint and in files of older versions.
    board, plan, gain, exposure_us, led_mA
        Board and settings; `plan` is the choice of the six channels. See
        `spots_device.reading.calibration.Conditions`.
    time : str
        Date and time in UTC, ISO 8601.
    trace : tuple of tuple of float
        All readings of a press by hand with a known force: time in s by the clock of `Board.now_s`,
        then the six counts.
    holds : tuple of (float, float)
        Start and end of the time in which each force was steady, in s by the same clock.
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


def point(wanted: Wanted, reading: Reading, conditions: Conditions, **measured) -> Point:
    """Return the `Point` of a press, with its reading and the present time.

    Parameters
    ----------
    wanted : Wanted
        The press.
    reading : Reading
        Reading of the press.
    conditions : Conditions
        Board and settings of the reading.
    **measured
        Further fields of `Point`, such as ``length_um``.

    Returns
    -------
    Point
    """
    return Point(
        **msgspec.structs.asdict(wanted),
        **conditions._asdict(),
        counts=tuple(reading.counts.tolist()),
        variance=tuple(reading.variance.tolist()),
        saturated=reading.saturated,
        time=datetime.now(timezone.utc).isoformat(timespec="seconds"),
        **measured,
    )


class Session:
    """A session file and its points: the presses that were taken, with their readings.

    Parameters
    ----------
    path : Path
        Name of the file, which need not exist. An incomplete last line is ignored, and replaced by
        `add`.

    Raises
    ------
    SpotsError
        If the file cannot be read, or a complete line is not a point.
    """

    def __init__(self, path: Path):
        self.path = path
        self.points: list[Point] = []
        self.removed: list[Point] = []  # presses by hand to ask for again
        try:
            data = read_bytes(path, SESSION_MAX_BYTES) if path.exists() else b""
        except OSError as error:
            raise SpotsError(
                f"cannot read the session {path} ({error.strerror}): name another file"
            ) from None
        lines = data.split(b"\n")
        self._whole = len(data) - len(lines[-1])
        for number, line in enumerate(lines[:-1], 1):
            try:
                self.points.append(msgspec.json.decode(line, type=Point))
            except (msgspec.DecodeError, UnicodeDecodeError) as error:
                raise SpotsError(
                    f"line {number} of the session {path} is damaged ({error}): remove that line "
                    "to repeat its press, or begin another session"
                ) from None

    def add(self, taken: Point) -> None:
        """Append a point to the file, and wait until the point is on disk.

        Raises
        ------
        SpotsError
            If the point cannot be written.
        """
        try:
            with open(self.path, "ab") as file:
                file.truncate(self._whole)
                file.write(msgspec.json.encode(taken) + b"\n")
                atomic.sync(file)
                self._whole = file.seek(0, os.SEEK_END)
        except OSError as error:
            raise atomic.not_written(self.path, error) from None
        self.points.append(taken)

    def undo(self) -> Point | None:
        """Remove and return the last point; return None if the session has no point."""
        if self.points:
            self.remove(last := self.points[-1])
            return last
        return None

    def remove(self, point: Point) -> None:
        """Remove a point from the session; the file is replaced atomically.

        Raises
        ------
        SpotsError
            If the file cannot be written.
        """
        kept = [p for p in self.points if p is not point]
        text = "".join(msgspec.json.encode(p).decode() + "\n" for p in kept)
        atomic.write_text(text, self.path)
        self.points, self._whole = kept, len(text.encode())
        if point.kind == "hand":
            self.removed.append(point)

    def of(self, kind: str, strain_ppm: int = 0) -> list[Point]:
        """Return the points of one kind of press at one strain.

        Parameters
        ----------
        kind : str
            Kind of the presses, see `Wanted.kind`.
        strain_ppm : int
            Strain of the strip in ppm.

        Returns
        -------
        list of Point
            Points in the order in which they were taken.
        """
        return [p for p in self.points if p.kind == kind and p.strain_ppm == strain_ppm]

    def has(self, wanted: Wanted, plan: tuple[str, ...]) -> bool:
        """Return whether the session already has a point for a press.

        Parameters
        ----------
        wanted : Wanted
            The press to look for.
        plan : tuple of str
            Channels that the reading must have.

        Returns
        -------
        bool
        """
        return any(
            abs(p.place_um - wanted.place_um) < _SAME_UM
            and abs(p.force_mN - wanted.force_mN) < _SAME_SHARE * wanted.force_mN
            and p.plan == plan
            for p in self.of(wanted.kind, wanted.strain_ppm)
        )

    @property
    def length_um(self) -> float | None:
        """Length of the strip at rest in um; None if the session does not contain the length."""
        known = [p.length_um for p in self.points if p.length_um is not None]
        if known:
            return known[-1]
        # Older versions stored no length, but took ``force`` presses only after all ``position``
        # presses, of which the last one is at the strip's end.
        whole = self.of("position") if self.of("force") else []
        return max((p.place_um for p in whole), default=None)

    @property
    def conditions(self) -> Conditions | None:
        """Board and settings of the session; None if the session has no point.

        The channels can still change while all points are of the kind ``choose``.
        """
        fixed = [p for p in self.points if p.kind != "choose"] or self.points
        return fixed[0].conditions if fixed else None

    @property
    def plan_is_open(self) -> bool:
        """Whether the channels can still change: all presses until now were made to choose them."""
        return all(p.kind == "choose" for p in self.points)

    def check(self, present: Conditions, length_um: float | None = None) -> None:
        """Check that the present board, settings and strip are those of the session.

        Parameters
        ----------
        present : Conditions
            Present board and settings.
        length_um : float, optional
            Length of the strip at rest in um; not checked if not given.

        Raises
        ------
        SpotsError
            If the session has another board, other settings, or a strip of another length.
        """
        made = self.conditions
        if made is None:
            return
        if made.board != present.board:
            raise SpotsError(
                f"the session {self.path} belongs to board {made.board}, but this is board "
                f"{present.board}: name another file with --session"
            )
        if self.plan_is_open:
            present = present._replace(plan=made.plan)
        if present != made:
            raise SpotsError(
                f"the session {self.path} was made at other settings: restore them with "
                f"'spots command set {settings(made)}', or name another file with --session"
            )
        made_um = self.length_um
        if None not in (made_um, length_um) and abs(made_um - length_um) > _SAME_LENGTH_UM:
            raise SpotsError(
                f"the session {self.path} belongs to a strip of {made_um / 1000:g} mm, not of "
                f"{length_um / 1000:g} mm: correct the length, or name another file with --session"
            )


def presses(points: list[Point]) -> Presses:
    """Return points as arrays, sorted by force and then by place."""
    points = sorted(points, key=lambda p: (p.force_mN, p.place_um))
    names = ("place_um", "force_mN", "counts", "variance", "saturated")
    return Presses(*(np.array([getattr(p, name) for p in points]) for name in names))


def settings(conditions: Conditions) -> str:
    """Return the arguments of the board's command ``set`` that restore `conditions`."""
    c = conditions
    return f"plan={','.join(c.plan)} gain={c.gain} exposure_us={c.exposure_us} led_mA={c.led_mA}"
