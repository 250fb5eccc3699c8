"""Programs, a text editor and a failing disk fight over one file, for each kind of file.

A schedule is a random sequence of steps: two programs read and write the file with the functions of
the package, a person edits it by hand, and the disk is full or reports errors. After each step, the
file has what the successful steps wrote, and the reader of the package can read it. A program may
replace only what it has read.
"""

from __future__ import annotations

import csv
import io
import random
import resource
from collections import Counter
from contextlib import ExitStack, contextmanager
from datetime import datetime, timedelta, timezone
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest import mock

import msgspec
import numpy as np
from msgspec.structs import replace
from support.frames import stream, touch
from support.reels import INFO, clock, record

from spots.calibrate import calibration_file
from spots.calibrate.fit.points import Point
from spots.calibrate.session.session_file import Session
from spots.controller import controller_settings
from spots.errors import SpotsError
from spots.keyboard import layout
from spots.recording.arrays import RecordingBlocks
from spots.recording.export import export
from spots.recording.writer import Writer
from spots.wearable import wearable
from spots_linkage import mounted, twin_points
from spots_web.user_file import UserFile

DATA = Path(__file__).parents[1] / "data"
STEPS = 30
_FAULTS = 0.2  # share of steps in which the disk is full or fails
_PROGRAMS = 2


class Fight:
    """A file, and the steps of a schedule; a subclass is a kind of file.

    Parameters
    ----------
    folder : Path
        Empty folder for the file.
    rng : random.Random
        Source of all random choices.

    Attributes
    ----------
    steps : tuple of str
        Names of the methods that are steps. A step may raise SpotsError, which is a refusal.
    """

    name = ""
    steps = ()

    def __init__(self, folder: Path, rng: random.Random):
        self.path, self.rng = folder / self.name, rng
        self.count = 0
        self.faulty = False
        self.stack = ExitStack()

    @property
    def bytes(self) -> bytes | None:
        """Content of the file; None if there is no file."""
        return self.path.read_bytes() if self.path.exists() else None

    def tag(self) -> int:
        """Return a number that no earlier step used."""
        self.count += 1
        return self.count

    def by_hand(self, data: bytes) -> None:
        """Write the file as a text editor does: in place, or to a new file that is renamed."""
        if self.rng.random() < 0.5:
            self.path.write_bytes(data)
        else:
            other = self.path.with_name("edited")
            other.write_bytes(data)
            other.replace(self.path)

    def check(self) -> None:
        """Check the file after a step."""
        raise NotImplementedError


class Replaced(Fight):
    """A file that is replaced as a whole."""

    steps = ("look", "write", "write", "edit", "drop")

    def __init__(self, folder, rng):
        super().__init__(folder, rng)
        self.known = [None] * _PROGRAMS  # what each program has read
        self.seen = [None] * _PROGRAMS
        self.written = None  # content that the file must have

    def read(self):
        """Return the content of the file as the package reads it; None without a file."""
        raise NotImplementedError

    def save(self, program, tag, before) -> None:
        """Replace the content `before` by another one, which has the number `tag`."""
        raise NotImplementedError

    def text(self, tag) -> bytes:
        """Return the bytes of a valid file."""
        raise NotImplementedError

    def look(self, program) -> None:
        self.known[program], self.seen[program] = self.read(), self.bytes

    def write(self, program) -> None:
        there, seen = self.bytes, self.seen[program]
        same = there is None or there == seen or self.read() == self.known[program]
        try:
            self.save(program, self.tag(), self.known[program])
        except SpotsError:
            assert self.bytes == there, "a refused write changed the file"
            assert self.faulty or not same, "a write was refused without a reason"
            raise
        assert same, "a program replaced what it had not read"
        self.written = self.bytes
        self.look(program)

    def edit(self, program) -> None:
        self.by_hand(self.text(self.tag()))
        self.written = self.bytes

    def drop(self, program) -> None:
        self.path.unlink(missing_ok=True)
        self.written = None

    def check(self):
        assert self.bytes == self.written
        assert (self.read() is None) == (self.written is None)


class Calibration(Replaced):
    name = "calibration.toml"
    made = calibration_file.load(DATA / "joint.toml")

    def _of(self, tag):
        date = datetime(2026, 1, 1, tzinfo=timezone.utc) + timedelta(seconds=tag)
        return replace(self.made, date=date)

    def read(self):
        return calibration_file.KIND.present(self.path)

    def save(self, program, tag, before):
        calibration_file.save(self._of(tag), self.path, before)

    def text(self, tag):
        other = self.path.with_name("other.toml")
        calibration_file.save(self._of(tag), other, None)
        text = other.read_bytes()
        other.unlink()
        return text


class Controller(Replaced):
    name = "controller.toml"

    def read(self):
        return controller_settings.KIND.present(self.path)

    def save(self, program, tag, before):
        settings = controller_settings.ControllerSettings(hold_ms=float(tag))
        controller_settings.save(settings, self.path, before)

    def text(self, tag):
        return f"# by hand\nhold_ms = {tag}.0\n".encode()


class Linkage(Replaced):
    name = "linkage.toml"
    drawn = mounted.load(DATA / "linkage.toml")

    def read(self):
        return mounted.KIND.present(self.path)

    def save(self, program, tag, before):
        new = replace(self.drawn, base_mm=80 + tag / 1000)
        mounted.save(new, self.path, before, "measured")

    def text(self, tag):
        return (DATA / "linkage.toml").read_bytes().replace(b"80.72", b"%d.5" % (100 + tag))


class _Edited(Replaced):
    """A file that the web UI edits."""

    usual: Path

    def __init__(self, folder, rng):
        super().__init__(folder, rng)
        self.files = [UserFile(self.path, "layout") for _ in range(_PROGRAMS)]

    def read(self):
        return self.path.read_text() if self.path.exists() else None

    def look(self, program):
        self.files[program].read()
        super().look(program)

    def save(self, program, tag, before):
        with self.files[program].replacing(self.text(tag).decode()):
            pass

    def text(self, tag):
        return self.usual.read_bytes() + b"# %d\n" % tag


class Layout(_Edited):
    name = "layout.toml"
    usual = DATA / "layout.toml"

    def check(self):
        super().check()
        if self.path.exists():
            layout.load(self.path)


class Gestures(_Edited):
    name = "gestures.toml"
    usual = wearable.DEFAULT

    def check(self):
        super().check()
        if self.path.exists():
            wearable.Mapping(self.path)


class Appended(Fight):
    """A file to which programs append rows; each row has a number."""

    steps = ("add", "add", "add", "edit")

    def __init__(self, folder, rng):
        super().__init__(folder, rng)
        self.expected: list[int] = []

    def append(self, program, tag) -> None:
        """Append the row with the number `tag`."""
        raise NotImplementedError

    def rows(self) -> list[int]:
        """Return the numbers of all rows, as the package reads the file."""
        raise NotImplementedError

    def row(self, tag) -> bytes:
        """Return a row as a person writes it, without its line end."""
        raise NotImplementedError

    def body(self) -> tuple[list[bytes], list[bytes]]:
        """Return the lines above the rows, and the lines of all complete rows."""
        return [], [self.row(tag) for tag in self.expected]

    def add(self, program) -> None:
        tag = self.tag()
        self.append(program, tag)
        self.expected.append(tag)

    def edit(self, program) -> None:
        if not self.expected:
            return
        head, rows = self.body()
        if self.rng.random() < 0.5:
            gone = self.rng.randrange(len(rows))
            del rows[gone], self.expected[gone]
        else:
            self.expected.append(tag := self.tag())
            rows.append(self.row(tag))
        lines = head + rows
        end = b"\n" if lines and self.rng.random() < 0.7 else b""
        self.by_hand(b"\n".join(lines) + end)

    def check(self):
        assert (rows := self.rows()) == self.expected, (rows, self.expected)


class SessionFile(Appended):
    name = "calibration.jsonl"
    steps = ("add", "add", "add", "edit", "undo", "use", "leave", "kill", "restart")
    lines = (DATA / "joint.jsonl").read_bytes().splitlines()

    def __init__(self, folder, rng):
        super().__init__(folder, rng)
        self.sessions = [Session(self.path) for _ in range(_PROGRAMS)]
        self.users = [self.stack.enter_context(ExitStack()) for _ in range(_PROGRAMS)]

    def row(self, tag):
        point = msgspec.json.decode(self.lines[0])
        return msgspec.json.encode(point | {"place_um": float(tag)})

    def append(self, program, tag):
        self.sessions[program].add(msgspec.json.decode(self.row(tag), type=Point))

    def rows(self):
        return [int(p.place_um) for p in Session(self.path).points]

    def undo(self, program):
        dropped = self.sessions[program].undo()
        if dropped is not None and int(dropped.place_um) in self.expected:
            self.expected.remove(int(dropped.place_um))

    def use(self, program):
        self.users[program].enter_context(self.sessions[program].locked())

    def leave(self, program):
        self.users[program].close()

    def restart(self, program):
        self.leave(program)
        self.sessions[program] = Session(self.path)

    def kill(self, program):
        """Leave a part of a line, as a program that was killed."""
        data = self.bytes
        if data is not None and data.endswith(b"\n"):
            self.path.write_bytes(data + self.row(0)[: self.rng.randrange(1, 90)])


class Points(Appended):
    name = "points.csv"

    def __init__(self, folder, rng):
        super().__init__(folder, rng)
        self.columns = ["note", *twin_points.COLUMNS]
        rng.shuffle(self.columns)
        self.path.write_text(",".join(self.columns) + "\n")

    def row(self, tag):
        cells = {"note": "", **dict.fromkeys(twin_points.COLUMNS, "1"), "x_mm": str(tag)}
        out = io.StringIO()
        csv.writer(out, lineterminator="").writerow(cells[name] for name in self.columns)
        return out.getvalue().encode()

    def body(self):
        _, rows = super().body()
        return [",".join(self.columns).encode()], rows

    def append(self, program, tag):
        twin_points._append(self.path, (tag, 150, 1, 2, 0.1, 0.2))

    def rows(self):
        return twin_points._read(self.path)[0][:, 0].astype(int).tolist()


class Recording(Fight):
    """A recording, which no other program may replace; a person moves it away."""

    name = "run.spots"
    steps = ("start", "take", "take", "take", "stop", "move")

    def __init__(self, folder, rng):
        super().__init__(folder, rng)
        self.recorders: list[Writer | None] = [None] * _PROGRAMS
        self.files: dict[Writer, tuple[Path, list[int]]] = {}
        self.begun = False

    def start(self, program):
        if self.recorders[program] is not None:
            return
        there = self.bytes
        known = clock()

        def describe():
            return {"info": INFO, "clock": known.state(), "calibration": ["a line"]}

        try:
            new = Writer(lambda: 1000.0 + 0.01 * self.count, self.path, describe)
        except SpotsError:
            assert there is None or self.bytes == there
            if there is None:  # the disk is full; nobody else has written the file
                self.path.unlink(missing_ok=True)
            raise
        assert there is None, "a recording was replaced"
        self.stack.callback(new.stop)
        self.recorders[program] = new
        self.files[new] = self.path, []

    def take(self, program):
        if (recorder := self.recorders[program]) is None:
            return
        try:
            recorder.take(touch(self.tag(), position_um=self.count), 1000.0 + 0.01 * self.count)
        except SpotsError:
            self.recorders[program] = None
            raise
        self.files[recorder][1].append(self.count)

    def stop(self, program):
        recorder, self.recorders[program] = self.recorders[program], None
        if recorder is not None:
            recorder.stop()

    def move(self, program):
        if not self.path.exists():
            return
        away = self.path.with_name(f"moved{self.tag()}.spots")
        self.path.rename(away)
        for recorder, (path, taken) in self.files.items():
            if path == self.path:
                self.files[recorder] = away, taken

    def check(self):
        for path, taken in self.files.values():
            found = [block.touches["position_um"] for block in RecordingBlocks(path)]
            assert [int(x) for part in found for x in part] == taken


class Export(Fight):
    """An export of a recording, which may replace no file."""

    name = "run.npz"
    steps = ("csv", "npz", "edit", "drop")

    def __init__(self, folder, rng):
        super().__init__(folder, rng)
        self.source = folder / "source.spots"
        record(self.source, stream(20))
        self.tables = folder / "run-touch.csv", folder / "run-header.json"
        self.written: dict[Path, bytes] = {}

    def _export(self, kind, *paths):
        try:
            export(self.source, kind, self.path.with_suffix(f".{kind}"))
        except SpotsError:
            assert self.faulty or not self.written.keys().isdisjoint(paths)
            raise
        assert self.written.keys().isdisjoint(paths), "an export replaced a file"
        self.written |= {path: path.read_bytes() for path in paths}
        if kind == "npz":
            with np.load(*paths) as found:
                assert len(found["touch"]) == 20
        else:
            assert paths[0].read_text().count("\n") == 21

    def csv(self, program):
        self._export("csv", *self.tables)

    def npz(self, program):
        self._export("npz", self.path)

    def edit(self, program):
        path = self.rng.choice((self.path, *self.tables))
        path.write_bytes(text := b"mine %d" % self.tag())
        self.written[path] = text

    def drop(self, program):
        for path in (self.path, *self.tables):
            path.unlink(missing_ok=True)
        self.written.clear()

    def check(self):
        there = {path for path in self.path.parent.iterdir() if path != self.source}
        assert {path: path.read_bytes() for path in there} == self.written


KINDS = (
    *(Calibration, SessionFile, Layout, Controller, Gestures, Linkage, Points),
    *(Recording, Export),
)


@contextmanager
def _failing(fight: Fight):
    """Let the disk be full, or let it fail at the next sync."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    if fight.rng.random() < 0.3:
        with mock.patch("os.fsync", side_effect=OSError(5, "Input/output error")):
            yield
        return
    resource.setrlimit(
        resource.RLIMIT_FSIZE, (fight.rng.randrange(len(fight.bytes or b"") + 200), hard)
    )
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def run(kind: type[Fight], seed: int, folder: Path) -> Counter:
    """Run one schedule; return how often each step succeeded, was refused, or met a failing disk.

    Parameters
    ----------
    kind : type
        One of `KINDS`.
    seed : int
        Seed of the schedule.
    folder : Path
        Empty folder.

    Raises
    ------
    AssertionError
        If somebody's work is lost, or the file cannot be read.
    """
    rng, found = random.Random(f"{kind.name} {seed}"), Counter()
    # Without waiting for a disk; files of a folder in memory would have the same content.
    with mock.patch("os.fsync"), mock.patch("spots.common.atomic._WAIT_S", 0.0):
        fight = kind(folder, rng)
        with fight.stack:
            for number in range(STEPS):
                step, program = rng.choice(fight.steps), rng.randrange(_PROGRAMS)
                by_hand = step in ("edit", "drop", "move", "kill")
                fight.faulty = not by_hand and rng.random() < _FAULTS
                try:
                    with _failing(fight) if fight.faulty else ExitStack():
                        getattr(fight, step)(program)
                    found["done"] += 1
                except SpotsError:
                    found["disk" if fight.faulty else "refused"] += 1
                try:
                    fight.check()
                    left = [one.name for one in folder.iterdir() if one.name.startswith(".spots-")]
                    assert not left, left
                except (AssertionError, SpotsError) as error:
                    raise AssertionError(
                        f"{kind.name}, seed {seed}, step {number} ({step} of program {program}"
                        f"{', failing disk' * fight.faulty}): {error}"
                    ) from error
    return found


def fight(schedules: int, say=print) -> None:
    """Run `schedules` random schedules for each kind of file, and print what happened."""
    for kind in KINDS:
        found = Counter()
        for seed in range(schedules):
            with TemporaryDirectory() as folder:
                found += run(kind, seed, Path(folder))
        say(
            f"{kind.name}: {schedules} schedules, {found['done']} steps done, {found['refused']} "
            f"refused, {found['disk']} stopped by the disk; nothing lost"
        )
