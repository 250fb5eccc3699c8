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

import msgspec

from spots_device.reading.calibration import Conditions

from ...common import atomic, kinds, locks
from ...common.bounded import SESSION_MAX_BYTES, read_bytes
from ...errors import ChangedError, FileError, InUseError
from ..fit.points import Point, Wanted
from .spectra import Reading

_SAME_UM, _SAME_SHARE = 1.0, 1e-3  # limits for the same press: position, share of the force
_SAME_LENGTH_UM = 100.0  # resolution of a ruler


_WANTED = "a session file"
_KIND = atomic.Kind("a session", lambda path: read_bytes(path, SESSION_MAX_BYTES))


def point(wanted: Wanted, reading: Reading, conditions: Conditions, **measured) -> Point:
    """Return the `Point` of a press, with its reading and the present time.

    `measured` has further fields of `Point`, such as ``length_um``.
    """
    return Point(
        **msgspec.structs.asdict(wanted),
        **conditions._asdict(),
        counts=tuple(reading.counts.tolist()),
        variance=tuple(reading.variance.tolist()),
        saturated=reading.saturated,
        baseline=tuple(reading.baseline.round(4).tolist()) if reading.baseline.any() else (),
        time=datetime.now(timezone.utc).isoformat(timespec="seconds"),
        **measured,
    )


class Session:
    """A session file and its points: the presses that were taken, with their readings.

    The file is read again whenever `locked` begins. What somebody changes in it until `locked`
    ends makes `add` and `remove` raise ChangedError, and stays as it is. The file need not exist.
    An incomplete last line, which a killed program leaves, is ignored, and replaced by `add`.
    `points` are those of the file, as `refer` changes them; `removed` are presses by hand to ask
    for again. `begun` is how many presses by hand there were when `locked` began. FileError if the
    file cannot be read, or a complete line is not a point.
    """

    def __init__(self, path: Path):
        self.path = path
        self.points: list[Point] = []
        self.removed: list[Point] = []
        self.begun = 0
        self._stored: list[Point] = []  # `points` as the file has them
        self._data = b""  # the complete lines of the file
        self._is_locked = False
        self._refer: Callable[[Point], Point] = lambda point: point
        self._parse(self._read())

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other programs from changing the session; may be nested.

        InUseError if another program uses the session, or its folder cannot be written.
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
            self._parse(self._read())
            self.begun = len(self.of("hand"))
            yield

    def refer(self, change: Callable[[Point], Point]) -> None:
        """Change all points, also later ones, but not the file; for example to remove a drift."""
        self._refer = change
        self._parse(self._data)

    def referred(self, taken: Point) -> Point:
        """Return the point of a press that is not added yet, changed as `refer` demands."""
        return self._refer(taken)

    def progress(self) -> str:
        """Return how many presses are stored, and how to go on with them."""
        if not self.points:
            return "nothing is stored; the same command begins again"
        count = len(self.points)
        presses = "1 press" if count == 1 else f"{count} presses"
        return f"{self.path} has {presses}; the same command goes on after the last one"

    def add(self, taken: Point) -> None:
        """Append a point to the file, and wait until the point is on disk.

        FileError if the point cannot be written, or somebody has changed the file.
        """
        line = msgspec.json.encode(taken)
        with self.locked():
            self._check_unchanged()
            # An editor may omit the end of the last line.
            unended = self._data and not self._data.endswith(b"\n")
            added = (b"\n" if unended else b"") + line + b"\n"
            try:
                atomic.append(self.path, added, len(self._data))
            except OSError as error:
                raise FileError(
                    f"cannot write {self.path} ({error.strerror or error}): the last press is not "
                    f"stored, all presses before it are; make room, and run the same command again",
                    self.path,
                ) from None
            self.points.append(self._refer(taken))
            self._stored.append(taken)
            self._data += added

    def undo(self) -> Point | None:
        """Remove and return the last point; return None if the session has no point."""
        if self.points:
            self.remove(last := self.points[-1])
            return last
        return None

    def remove(self, point: Point) -> None:
        """Remove a point from the session; the file is replaced atomically."""
        stored = self._stored[next(i for i, p in enumerate(self.points) if p is point)]
        with self.locked():
            data = self._check_unchanged()
            lines = self._data.splitlines(keepends=True)
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

    def _check_unchanged(self) -> bytes:
        """Return the bytes of the file; raise ChangedError if somebody has changed its lines."""
        data = self._read()
        if _complete(data) != self._data:
            raise ChangedError(
                f"{self.path} was changed during its session, and stays as it is now: close the "
                "session before you edit this file; the same command goes on with it",
                self.path,
            )
        return data

    def _parse(self, data: bytes) -> None:
        complete, stored = _complete(data), []
        for number, line in enumerate(complete.split(b"\n"), 1):
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
        self._stored, self._data = stored, complete

    def of(self, kind: str, strain_ppm: int = 0) -> list[Point]:
        """Return the points of one kind of press at one strain, oldest first."""
        return [p for p in self.points if p.kind == kind and p.strain_ppm == strain_ppm]

    def has(self, wanted: Wanted, plan: tuple[str, ...]) -> bool:
        """Return whether the session already has a point for a press, with a plan's channels."""
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
        return known[-1] if known else None

    @property
    def baseline(self) -> tuple[float, ...]:
        """Light of the untouched strip that the last press was taken with, see `Point`."""
        fixed = [p for p in self.points if p.kind not in ("choose", "strain", "joint")]
        return fixed[-1].baseline if fixed else ()

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

        The length of the strip at rest is not checked if not given. FileError otherwise.
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


def _complete(data: bytes) -> bytes:
    """Return a session file without what a killed program has left of a last line."""
    whole = data[: data.rfind(b"\n") + 1]
    last = data[len(whole) :]
    # A program was killed while it wrote a line, or the power failed before the line was on disk.
    if (last.startswith(b"{") or not last.strip(b"\0")) and _decoded(last) is None:
        return whole
    return data


def _decoded(line: bytes) -> Point | None:
    try:
        return msgspec.json.decode(line, type=Point)
    except (msgspec.DecodeError, UnicodeDecodeError):
        return None


def settings(conditions: Conditions) -> str:
    """Return the arguments of the board's command ``set`` that restore `conditions`."""
    c = conditions
    return (
        f"channels={','.join(c.plan)} gain={c.gain} exposure_us={c.exposure_us} led_mA={c.led_mA}"
    )
