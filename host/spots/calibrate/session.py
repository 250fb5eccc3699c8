"""The raw material of a calibration: one JSON line a press, on disk before the next one begins."""

from __future__ import annotations

import os
from datetime import datetime, timezone
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np

from spots_device.calibration import Conditions

from ..bounded import SESSION_MAX_BYTES, read_bytes
from ..errors import SpotsError
from .presses import Presses
from .spectra import Reading

_SAME_UM, _SAME_SHARE = 1.0, 1e-3
Six = Annotated[tuple[float, ...], msgspec.Meta(min_length=6, max_length=6)]


class Wanted(msgspec.Struct, frozen=True, kw_only=True):
    """A press that a session asks for.

    Attributes
    ----------
    kind : str
    place_um : float
        Distance from the sensor's end in um, measured on the stretched strip.
    force_mN : float
    strain_ppm : int
    angle_deg : float or None
        Angle of the joint in degrees; None where no joint presses.
    direction : int
        Direction in which the joint came to the angle: 1 upwards, -1 downwards; 0 for no joint.
    """

    kind: Literal["choose", "position", "force", "strain", "joint", "mark"]
    place_um: float
    force_mN: float
    strain_ppm: int = 0
    angle_deg: float | None = None
    direction: int = 0

    def __str__(self) -> str:
        if self.angle_deg is not None:
            return f"the joint at {self.angle_deg:g} degrees"
        return f"{self.place_um / 1000:.1f} mm with {self.force_mN / 1000:.4g} N"


class Point(Wanted, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A press that was taken, with all that was read.

    Attributes
    ----------
    counts, variance : tuple of float
        See `spectra.Reading`.
    saturated : bool
    position_um, position_sigma_um : float or None
        What the calibrated board reported, and its scatter from reading to reading; for a joint.
    length_um : float or None
        Length of the strip in um; None in files of older versions.
    board, plan, gain, exposure_us, led_mA
        See `spots_device.calibration.Conditions`.
    time : str
        UTC.
    """

    counts: Six
    variance: Six
    saturated: bool
    position_um: float | None = None
    position_sigma_um: float | None = None
    length_um: float | None = None
    board: str
    plan: tuple[str, ...]
    gain: int
    exposure_us: int
    led_mA: int
    time: str

    @property
    def conditions(self) -> Conditions:
        """What it was read with."""
        return Conditions(self.board, self.plan, self.gain, self.exposure_us, self.led_mA)


def point(wanted: Wanted, reading: Reading, conditions: Conditions, **measured) -> Point:
    """Return the point that a reading of a wanted press makes.

    Parameters
    ----------
    wanted : Wanted
    reading : Reading
    conditions : Conditions
    **measured
        Other fields of `Point`.

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
    """A session file and its points.

    Parameters
    ----------
    path : Path
        Need not exist yet. A last line that was cut short is dropped, and taken away before the
        next one is written.

    Raises
    ------
    SpotsError
        If the file cannot be read, or a line before the last is not a point.
    """

    def __init__(self, path: Path):
        self.path = path
        self.points: list[Point] = []
        try:
            data = read_bytes(path, SESSION_MAX_BYTES) if path.exists() else b""
        except OSError as error:
            raise SpotsError(f"cannot read the session {path}: {error.strerror}") from None
        lines = data.split(b"\n")
        self._whole = len(data) - len(lines[-1])
        for number, line in enumerate(lines[:-1], 1):
            try:
                self.points.append(msgspec.json.decode(line, type=Point))
            except (msgspec.DecodeError, UnicodeDecodeError) as error:
                raise SpotsError(
                    f"line {number} of the session {path} is damaged ({error}): remove that line "
                    "to take its press again, or begin another session"
                ) from None

    def add(self, taken: Point) -> None:
        """Store a point; it is on disk when this returns.

        Raises
        ------
        SpotsError
            If it cannot be written.
        """
        try:
            with open(self.path, "ab") as file:
                file.truncate(self._whole)
                file.write(msgspec.json.encode(taken) + b"\n")
                file.flush()
                os.fsync(file.fileno())
                self._whole = file.seek(0, os.SEEK_END)
        except OSError as error:
            raise SpotsError(f"cannot write the session {self.path}: {error.strerror}") from None
        self.points.append(taken)

    def of(self, kind: str, strain_ppm: int = 0) -> list[Point]:
        """Return the points of a kind at a strain.

        Parameters
        ----------
        kind : str
            As `Wanted.kind`, for example ``position``.
        strain_ppm : int
            Elongation over length at rest, in millionths.

        Returns
        -------
        list of Point
            Points in the order in which they were taken.
        """
        return [p for p in self.points if p.kind == kind and p.strain_ppm == strain_ppm]

    def has(self, wanted: Wanted, plan: tuple[str, ...]) -> bool:
        """Return whether a press was taken already.

        Parameters
        ----------
        wanted : Wanted
        plan : tuple of str
            The channels that it has to have been read with.

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
        """Length of the strip; None if no point has it."""
        known = [p.length_um for p in self.points if p.length_um is not None]
        if known:
            return known[-1]
        # Forces came after all places, the last of which is the strip's end.
        whole = self.of("position") if self.of("force") else []
        return max((p.place_um for p in whole), default=None)

    @property
    def strains_ppm(self) -> list[int]:
        """Strains other than 0 that there are points of."""
        return sorted({p.strain_ppm for p in self.points if p.kind == "strain"})

    @property
    def conditions(self) -> Conditions | None:
        """What the session was made with; None without a point.

        Points that served to choose the channels leave these open.
        """
        fixed = [p for p in self.points if p.kind != "choose"] or self.points
        return fixed[0].conditions if fixed else None

    @property
    def plan_is_open(self) -> bool:
        """Whether the channels are still to be chosen."""
        return all(p.kind == "choose" for p in self.points)

    def check(self, present: Conditions) -> None:
        """Check that the board is as the session was made.

        Raises
        ------
        SpotsError
            If the session belongs to another board, or other settings.
        """
        made = self.conditions
        if made is None:
            return
        if made.board != present.board:
            raise SpotsError(
                f"the session {self.path} belongs to board {made.board}, this is {present.board}: "
                "name another file with --session"
            )
        now = (present.plan, present.gain, present.exposure_us, present.led_mA)
        then = (made.plan, made.gain, made.exposure_us, made.led_mA)
        if now != then and not (self.plan_is_open and now[1:] == then[1:]):
            raise SpotsError(
                f"the session {self.path} was made at other settings: bring them back with "
                f"'spots command set {settings(made)}', or name another file with --session"
            )
        if {p.conditions for p in self.points if p.kind != "choose"} - {made}:
            raise SpotsError(
                f"the session {self.path} mixes boards or settings: name another with --session"
            )

    def presses(self, kind: str, strain_ppm: int = 0) -> Presses:
        """Return the points of a kind at a strain as arrays, sorted by force and then place.

        Parameters
        ----------
        kind : str
            As `Wanted.kind`, for example ``position``.
        strain_ppm : int
            Elongation over length at rest, in millionths.

        Returns
        -------
        Presses
            Arrays over the points.
        """
        return presses(self.of(kind, strain_ppm))


def presses(points: list[Point]) -> Presses:
    """Return points as arrays, by force and place."""
    points = sorted(points, key=lambda p: (p.force_mN, p.place_um))
    names = ("place_um", "force_mN", "counts", "variance", "saturated")
    return Presses(*(np.array([getattr(p, name) for p in points]) for name in names))


def settings(conditions: Conditions) -> str:
    """Return what to `set` to have these conditions."""
    c = conditions
    return f"plan={','.join(c.plan)} gain={c.gain} exposure_us={c.exposure_us} led_mA={c.led_mA}"
