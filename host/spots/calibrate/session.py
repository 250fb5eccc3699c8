"""Session files: each line is a press and its reading in JSON.

A line is on disk before the session asks for the next press. A session asks for the presses of a
calibration. For a press *by hand*, the person then reads its true position off a ruler, and its
force off a scale. Marks are positions that a re-zero (``spots rezero``) presses again, to measure
drift.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from datetime import datetime, timezone
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np

from spots_device.reading.calibration import Conditions

from ..common import atomic, kinds, locks
from ..common.bounded import SESSION_MAX_BYTES, read_bytes
from ..errors import FileError, InUseError
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
_Rest = Annotated[tuple[_Number, ...], msgspec.Meta(max_length=6)]
_Seven = Annotated[tuple[_Number, ...], msgspec.Meta(min_length=7, max_length=7)]
Plan = Annotated[tuple[str, ...], msgspec.Meta(min_length=6, max_length=6)]
Gain = Annotated[int, _ranged(0, 10)]
ExposureUs = Annotated[int, _ranged(1, 10_000_000)]
LedMA = Annotated[int, _ranged(0, 1000)]
_WANTED = "a session file"
_KIND = atomic.Kind("a session", lambda path: read_bytes(path, SESSION_MAX_BYTES))


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
        Length of the strip at rest in um; None for a joint.
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
    rest : tuple of float
        Light of the untouched strip in counts of a sample, which was subtracted from `counts`;
        empty if the strip had no such light.
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
    rest: _Rest = ()

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
        rest=tuple(reading.rest.round(4).tolist()) if reading.rest.any() else (),
        time=datetime.now(timezone.utc).isoformat(timespec="seconds"),
        **measured,
    )


class Session:
    """A session file and its points: the presses that were taken, with their readings.

    The file is the truth: `add` and `remove` change the file as it is now, also if somebody edited
    it in the meantime, and then read it again.

    Parameters
    ----------
    path : Path
        Name of the file, which need not exist. An incomplete last line, which a killed program
        leaves, is ignored, and replaced by `add`.

    Attributes
    ----------
    points : list of Point
        Points of the file, as `refer` changes them.
    removed : list of Point
        Presses by hand that were removed, to ask for again.

    Raises
    ------
    SpotsError
        If the file cannot be read, or a complete line is not a point.
    """

    def __init__(self, path: Path):
        self.path = path
        self.points: list[Point] = []
        self.removed: list[Point] = []
        self._stored: list[Point] = []  # `points` as the file has them
        self._data = b""
        self._is_locked = False
        self._refer: Callable[[Point], Point] = lambda point: point
        self._parse(self._read())

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other programs from changing the session; may be nested.

        Raises
        ------
        InUseError
            If another program uses the session, or its folder cannot be written.
        """
        if self._is_locked:
            yield
            return
        with ExitStack() as stack:
            try:
                stack.enter_context(locks.held(self.path))
            except InUseError:
                raise InUseError(
                    f"the session {self.path} is in use by another program: end that program, or "
                    "name another file with --session",
                    self.path,
                ) from None
            except OSError as error:
                raise atomic.not_written(self.path, error) from None
            stack.callback(setattr, self, "_is_locked", False)
            self._is_locked = True
            self._update()
            yield

    def refer(self, change: Callable[[Point], Point]) -> None:
        """Change all points, also later ones, but not the file; for example to remove a drift.

        Parameters
        ----------
        change : callable
            ``change(point)`` returns the `Point` to use.
        """
        self._refer = change
        self._parse(self._data)

    def referred(self, wanted: Wanted, reading: Reading, conditions: Conditions) -> Point:
        """Return the point of a press that is not added yet, changed as `refer` demands.

        Parameters
        ----------
        wanted : Wanted
            The press.
        reading : Reading
            Reading of the press.
        conditions : Conditions
            Board and settings of the reading.

        Returns
        -------
        Point
        """
        return self._refer(point(wanted, reading, conditions))

    def progress(self) -> str:
        """Return how many presses are stored, and how to go on with them."""
        if not self.points:
            return "nothing is stored; the same command begins again"
        count = len(self.points)
        presses = "1 press" if count == 1 else f"{count} presses"
        return f"{self.path} has {presses}; the same command goes on after the last one"

    def add(self, taken: Point) -> None:
        """Append a point to the file, and wait until the point is on disk.

        Raises
        ------
        FileError
            If the point cannot be written, or somebody has damaged a line of the file. Then the
            point is stored nevertheless.
        """
        line = msgspec.json.encode(taken)
        with self.locked():
            data = self._read()
            whole, last = _cut(data)
            # An editor may omit the end of the last line.
            added = (b"\n" if last else b"") + line + b"\n"
            try:
                atomic.append(self.path, added, len(whole + last))
            except OSError as error:
                raise FileError(
                    f"cannot write {self.path} ({error.strerror or error}): the last press is not "
                    f"stored, all presses before it are; make room, and run the same command again",
                    self.path,
                ) from None
            if data != self._data:  # somebody has edited the file
                self._parse(whole + last + added)
                return
            self.points.append(self._refer(taken))
            self._stored.append(taken)
            self._data = whole + last + added

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
        stored = self._stored[next(i for i, p in enumerate(self.points) if p is point)]
        with self.locked():
            data = self._read()
            lines = data.splitlines(keepends=True)
            known = [_decoded(line) for line in lines]
            if stored in known:  # nobody else has removed it
                del lines[len(known) - 1 - known[::-1].index(stored)]
                with atomic.replacing(self.path, _KIND, was=data, locked=True) as file:
                    file.write(b"".join(lines))
            self._parse(b"".join(lines))
        if point.kind == "hand":
            self.removed.append(point)

    def _read(self) -> bytes:
        try:
            return read_bytes(self.path, SESSION_MAX_BYTES) if self.path.exists() else b""
        except OSError as error:
            raise kinds.not_read(self.path, error, _WANTED) from None

    def _update(self) -> None:
        if (data := self._read()) != self._data:
            self._parse(data)

    def _parse(self, data: bytes) -> None:
        whole, last = _cut(data)
        stored = []
        for number, line in enumerate((whole + last).split(b"\n"), 1):
            if not line.strip():
                continue
            try:
                stored.append(msgspec.json.decode(line, type=Point))
            except (msgspec.DecodeError, UnicodeDecodeError) as error:
                kinds.check(self.path, data, _WANTED)
                if _WANTED not in kinds.kinds_of(data):
                    raise FileError(
                        f"{self.path} is not {_WANTED}: name another file with --session", self.path
                    ) from None
                raise FileError(
                    f"line {number} of the session {self.path} is damaged ({error}): remove that "
                    "line to repeat its press, or begin another session",
                    self.path,
                    f"line {number}",
                ) from None
        self.points = [self._refer(point) for point in stored]
        self._stored, self._data = stored, data

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
    def rest(self) -> tuple[float, ...]:
        """Light of the untouched strip that the last press was taken with, see `Point`."""
        fixed = [p for p in self.points if p.kind not in ("choose", "strain", "joint")]
        return fixed[-1].rest if fixed else ()

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
        FileError
            If the session has another board, other settings, or a strip of another length.
        """
        made = self.conditions
        if made is None:
            return
        if made.board != present.board:
            raise FileError(
                f"the session {self.path} belongs to board {made.board}, but this is board "
                f"{present.board}: name another file with --session",
                self.path,
            )
        if self.plan_is_open:
            present = present._replace(plan=made.plan)
        if present != made:
            raise FileError(
                f"the session {self.path} was made at other settings: restore them with "
                f"'spots command set {settings(made)}', or name another file with --session",
                self.path,
            )
        made_um = self.length_um
        if None not in (made_um, length_um) and abs(made_um - length_um) > _SAME_LENGTH_UM:
            raise FileError(
                f"the session {self.path} belongs to a strip of {made_um / 1000:g} mm, not of "
                f"{length_um / 1000:g} mm: correct the length, or name another file with --session",
                self.path,
            )


def _cut(data: bytes) -> tuple[bytes, bytes]:
    """Return the complete lines of a session file, and its last line if only its end is missing.

    What a killed program left of a last line is in neither.
    """
    whole = data[: data.rfind(b"\n") + 1]
    last = data[len(whole) :]
    # A program was killed while it wrote a line, or the power failed before the line was on disk.
    if (last.startswith(b"{") or not last.strip(b"\0")) and _decoded(last) is None:
        last = b""
    return whole, last


def _decoded(line: bytes) -> Point | None:
    try:
        return msgspec.json.decode(line, type=Point)
    except (msgspec.DecodeError, UnicodeDecodeError):
        return None


def presses(points: list[Point]) -> Presses:
    """Return points as arrays, sorted by force and then by place."""
    points = sorted(points, key=lambda p: (p.force_mN, p.place_um))
    names = ("place_um", "force_mN", "counts", "variance", "saturated")
    return Presses(*(np.array([getattr(p, name) for p in points]) for name in names))


def settings(conditions: Conditions) -> str:
    """Return the arguments of the board's command ``set`` that restore `conditions`."""
    c = conditions
    return f"plan={','.join(c.plan)} gain={c.gain} exposure_us={c.exposure_us} led_mA={c.led_mA}"
