"""Complete calibration sessions on the virtual board: real firmware, simulated time."""

import argparse
import io
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from datetime import datetime, timezone
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from rich.console import Console
from support.hand_session import LONG
from support.refusals import refusal
from support.sensors import replaced

from spots import SpotsError, cli
from spots.calibrate import calibration_file as file
from spots.calibrate.fit.decoded import Decoded, bounds_of, coarse_of, segments_of
from spots.calibrate.fit.points import Point, Wanted
from spots.calibrate.fit.presses import FULL_MN
from spots.calibrate.session import hand, steps
from spots.calibrate.session.bench import Bench
from spots.calibrate.session.guide import Guide
from spots.calibrate.session.joint import fit_joint
from spots.calibrate.session.make import make
from spots.calibrate.session.presser import Presser
from spots.calibrate.session.session_file import Session, settings
from spots.errors import (
    BoardError,
    CalibrationError,
    ChangedError,
    FileError,
    InUseError,
    StateError,
)
from spots.keyboard.layout import FOLDER as LAYOUTS
from spots.link.connect import upload
from spots.link.frames import Spectrum, Touch
from spots_device.board.settings import checksum
from spots_device.reading.calibration import Calibration, Conditions
from spots_device.reading.decode import DARK_SAMPLES
from spots_sim.measure.bound import Bound
from spots_sim.person.stage import Stage
from spots_sim.person.stage_presser import StagePresser
from spots_sim.strip.files import DATA
from spots_sim.strip.scenario import Press

STRAIN_PPM = 100_000
OTHER = "--sensor", "dim"  # another board


def run(*arguments):
    return cli.main(["calibrate", *map(str, arguments), "--port", "virtual"])


@pytest.fixture(scope="module")
def full(staged, tmp_path_factory):
    """Session file and calibration file (attributes `session`, `out`) of a complete calibration."""
    path = tmp_path_factory.mktemp("full") / "session.jsonl"
    for suffix in (".jsonl", ".toml"):
        shutil.copy(staged / f"a{suffix}", path.with_suffix(suffix))
    return SimpleNamespace(session=path, out=path.with_suffix(".toml"))


class Touched:
    """A simulated board with a given calibration file, and a stage that presses its strip."""

    def __init__(self, sensor, path, folder=None):
        self.stage = Stage(sensor, seed=11)
        self.made = file.load(path)
        self.board = self.stage.board
        self.board.command("set " + settings(self.made.conditions))

    def __enter__(self):
        file.send(self.board, self.made)
        self.board.command("dark", timeout_s=5)
        self.board.command("stream touch spectrum")
        return self

    def __exit__(self, *exception):
        self.board.close()

    def lift(self):
        """Lift the indenter, and wait until the board has noticed it."""
        self.stage.release()
        for _ in self.board.frames(0.1):
            pass

    def readings(self, position_um, force_mN, count):
        """Press the strip; return the TOUCH and the SPECTRUM frame of each of `count` readings."""
        self.stage.press(position_um, force_mN)
        begun_s = self.board.now_s() + 0.5e-6 * self.made.exposure_us
        pairs, touch = [], None
        for frame in self.board.frames():
            if frame.time_s < begun_s:
                continue
            if isinstance(frame, Touch):
                touch = frame
            elif isinstance(frame, Spectrum) and touch and touch.t_us == frame.t_us:
                pairs.append((touch, frame))
                if len(pairs) == count:
                    return pairs


@pytest.mark.board
def test_touches_on_the_board_are_where_they_are(sensor, full):
    with Touched(sensor, full.out) as touched:
        for position_um in np.linspace(3000, 82_000, 9):
            for force_mN in (3000.0, 8000.0):
                pairs = touched.readings(position_um, force_mN, 10)
                errors = [touch.position_um - position_um for touch, _ in pairs]
                assert all(touch.trusted for touch, _ in pairs)
                assert abs(np.mean(errors)) < 100
                assert np.mean(np.abs(errors)) < 100  # of single readings, at 10 ms
                forces = [touch.force_mN for touch, _ in pairs]
                assert np.mean(forces) == pytest.approx(force_mN, rel=0.03)


@pytest.mark.board
def test_touches_on_the_stretched_strip_are_where_they_are(sensor, full):
    with Touched(sensor, full.out) as touched:
        touched.stage.held.strain = STRAIN_PPM * 1e-6
        touched.board.command(f"set strain_ppm={STRAIN_PPM}")
        positions_um = np.linspace(3000, 90_000, 7)
        errors_um = []
        for _ in range(3):  # at the far end, the noise of one dark frame shifts up to 100 um
            touched.board.command("dark", timeout_s=5)
            for position_um in positions_um:
                pairs = touched.readings(position_um, 5000.0, 10)
                errors_um.append(np.mean([t.position_um for t, _ in pairs]) - position_um)
        assert np.all(abs(np.reshape(errors_um, (3, -1)).mean(axis=0)) < 100)


def test_the_file_has_the_measured_residuals_and_joint(sensor, full):
    made = file.load(full.out)
    assert [r.strain_ppm for r in made.residuals] == [0, STRAIN_PPM]
    assert all(0 < r.position_rms_um < 50 for r in made.residuals)
    assert 0 < made.residuals[0].force_rms_mN < 100
    assert made.residuals[1].force_rms_mN is None
    joint = made.joint
    assert joint.deg_per_um == pytest.approx(np.degrees(1 / (1000 * sensor.joint.radius_mm)), 1e-3)
    assert joint.r2 > 0.99999
    assert joint.backlash_deg == pytest.approx(sensor.joint.play_deg, abs=0.03)
    assert 0 < joint.accuracy_deg < 0.1
    assert 0 < joint.resolution_deg < 0.3


def test_a_joint_with_more_play_has_more_backlash(full):
    points = Session(full.session).of("joint")
    um_per_deg = 1 / file.load(full.out).joint.deg_per_um
    loose = [
        msgspec.structs.replace(p, position_um=p.position_um - p.direction * um_per_deg)
        for p in points
    ]
    assert fit_joint(loose).backlash_deg == pytest.approx(2.0, abs=0.1)


def test_a_joint_that_slips_or_lacks_a_direction_is_refused(full):
    points = Session(full.session).of("joint")
    slipped = msgspec.structs.replace(points[5], position_um=points[3].position_um)
    twice = msgspec.structs.replace(points[5], angle_deg=points[4].angle_deg)
    for wrong, says in [
        (points[:13], "4 angles or more in each direction"),
        ([*points[:5], slipped, *points[6:]], "does not rise or fall steadily with the angle"),
        ([*points[:5], twice, *points[6:]], "the same angle"),
    ]:
        with pytest.raises(CalibrationError, match=says):
            fit_joint(wrong)


# ---- the session file


@pytest.mark.board
def test_a_session_cut_at_any_byte_keeps_every_whole_line(full, tmp_path):
    data = full.session.read_bytes()
    known = Session(full.session).points
    lengths = np.cumsum([len(line) + 1 for line in data.split(b"\n")[:-1]])
    for cut in range(lengths[1] - 2, lengths[3] + 2):
        path = tmp_path / "cut.jsonl"
        path.write_bytes(data[:cut])
        session = Session(path)
        whole = int((lengths - 1 <= cut).sum())  # an editor may omit the end of the last line
        assert session.points == known[:whole]
        assert path.read_bytes() == data[:cut]  # reading changes nothing
        with session.locked():
            session.add(known[whole])
            session.add(known[whole + 1])
        assert path.read_bytes() == data[: lengths[whole + 1]]


def test_a_damaged_line_in_the_middle_is_named(full, tmp_path):
    lines = full.session.read_bytes().split(b"\n")
    path = tmp_path / "damaged.jsonl"
    for damage in (lines[4][:-9], b"\xff" + lines[4], b"{}", b"\0"):
        path.write_bytes(b"\n".join([*lines[:4], damage, *lines[5:]]))
        with refusal(FileError, place="line 5", file="damaged.jsonl"):
            Session(path)


def test_a_session_in_a_folder_that_does_not_exist_names_the_folder(full, tmp_path):
    lost = Session(tmp_path / "none" / "a.jsonl")
    with refusal(FileError, file="none"):
        lost.add(Session(full.session).points[0])
    assert not lost.points


# Script of another program that works with a session until its input ends.
HOLDER = """
import sys
from pathlib import Path
from spots.calibrate.session.session_file import Session
with Session(Path(sys.argv[1])).locked():
    print("locked", flush=True)
    sys.stdin.read()
"""


@pytest.mark.board
def test_a_session_in_use_is_refused_and_free_when_its_program_is_killed(full, tmp_path, capsys):
    path = tmp_path / "calibration.jsonl"
    path.write_bytes(before := full.session.read_bytes())
    command = [sys.executable, "-c", HOLDER, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        try:
            assert other.stdout.readline() == b"locked\n"
            said = refused(capsys, "position", "--session", path)
            assert "in use by another program" in said
            assert "name another file with --session" in said
            with refusal(InUseError, file="calibration.jsonl"):
                Session(path).add(Session(path).points[0])
            assert path.read_bytes() == before
        finally:
            other.kill()
    session = Session(path)
    session.add(session.points[-1])
    assert path.read_bytes() == before + before.splitlines(keepends=True)[-1]
    assert os.listdir(tmp_path) == ["calibration.jsonl"]


@pytest.mark.parametrize("by_rename", [False, True])
@pytest.mark.parametrize("change", ["remove", "append", "damage", "delete"])
@pytest.mark.parametrize("then", ["add", "remove"])
def test_what_a_person_edits_during_a_session_stays_and_the_session_is_refused(
    full, tmp_path, by_rename, change, then
):
    path, lines = tmp_path / "a.jsonl", full.session.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(lines[:6]))
    session = Session(path)
    with session.locked():
        edited = {
            "remove": b"".join(lines[:2] + lines[3:6]),
            "append": b"".join(lines[:7]),
            "damage": b"".join([*lines[:5], b"x"]),
            "delete": b"",
        }[change]
        there = tmp_path / "edited" if by_rename else path
        there.write_bytes(edited)
        there.replace(path)
        with refusal(ChangedError, file="a.jsonl") as said:
            if then == "add":
                session.add(msgspec.json.decode(lines[8], type=Point))
            else:
                session.remove(session.points[3])
        assert "close the session before you edit this file" in str(said.value)
        assert path.read_bytes() == edited
    if change != "damage":  # the same command goes on with the file as it is
        session.add(msgspec.json.decode(lines[8], type=Point))
        assert path.read_bytes() == edited + lines[8]


@pytest.mark.parametrize("begun", [b"", b'{"kind":"pos'])
def test_a_press_that_cannot_be_written_is_reported_and_the_others_are_stored(
    full, tmp_path, monkeypatch, begun
):
    path, lines = tmp_path / "a.jsonl", full.session.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(lines[:3]) + begun)
    session = Session(path)
    more = msgspec.json.decode(lines[3], type=Point)

    def refused():
        with refusal(FileError, file="a.jsonl"):
            session.add(more)
        assert path.read_bytes() == b"".join(lines[:3])

    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 40, hard))
    try:
        refused()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", lambda handle: (_ for _ in ()).throw(OSError(5, "I/O error")))
        refused()
    session.add(more)
    assert path.read_bytes() == b"".join(lines[:4])
    assert session.points == Session(path).points


@pytest.mark.parametrize("text", ["mine = 1", "mine = 1\n"])
def test_a_file_of_another_kind_is_no_session(tmp_path, text):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with refusal(FileError, file="mine.toml"):
        Session(path)
    assert path.read_text() == text


@pytest.mark.board
def test_a_calibration_replaces_no_file_of_another_kind(full, tmp_path, capsys):
    session, out = tmp_path / "mine.jsonl", tmp_path / "mine.toml"
    session.write_bytes(full.session.read_bytes())
    damaged = full.out.read_bytes().replace(b"gain = ", b"gain = 1")
    for text in ((LAYOUTS / "mini.toml").read_bytes(), session.read_bytes(), damaged, b"x"):
        out.write_bytes(text)
        said = refused(capsys, "force", "--session", session)
        assert "mine.toml would be replaced, but it is not a calibration file, or it is" in said
        assert out.read_bytes() == text
    out.write_bytes(b"")
    assert run("force", "--session", session) == 0
    assert file.load(out).original == file.load(full.out).original


def test_the_calibration_of_another_board_is_not_replaced(full, tmp_path, capsys):
    out = tmp_path / "calibration.toml"
    out.write_bytes(before := full.out.read_bytes())
    said = refused(capsys, "position", "--session", tmp_path / "a.jsonl", "--out", out, *OTHER)
    assert "calibration.toml is the calibration of board" in said
    assert out.read_bytes() == before


def test_a_calibration_that_another_program_has_changed_is_not_replaced(full, tmp_path):
    path = tmp_path / "calibration.toml"
    made = file.load(full.out)
    other = msgspec.structs.replace(made, joint=None)
    path.write_bytes(full.out.read_bytes())
    file.save(other, path, made)
    before = path.read_bytes()
    with refusal(ChangedError, file="calibration.toml"):
        file.save(made, path, made)
    with refusal(ChangedError, file="calibration.toml"):
        file.save(made, path, None)
    assert path.read_bytes() == before


@pytest.mark.board
def test_a_step_of_another_session_carries_the_joint_over(full, tmp_path, capsys):
    path, out = tmp_path / "new.jsonl", tmp_path / "calibration.toml"
    # From before all presses of the session.
    early = datetime(2020, 1, 1, tzinfo=timezone.utc)
    file.save(msgspec.structs.replace(file.load(full.out), date=early), out, None)
    lines = full.session.read_bytes().splitlines(keepends=True)
    other = b'"kind":"joint"', b'"kind":"strain"'
    path.write_bytes(b"".join(one for one in lines if not any(kind in one for kind in other)))
    assert run("force", "--session", path, "--out", out) == 0
    said = " ".join(capsys.readouterr().out.split())
    before, made = file.load(full.out), file.load(out)
    assert made.joint == before.joint
    assert made.joint_marks is None
    assert "run 'spots calibrate joint' to make them" in said
    assert "calibration at 10 % strain is not taken over" in said


@pytest.mark.board
def test_a_killed_session_goes_on_where_it_was(tmp_path):
    path = tmp_path / "killed.jsonl"
    words = [
        "position",
        "--channels",
        "F3,F4,F5,F6,F7,F8",
        "--places",
        "40",
        "--session",
        str(path),
    ]
    process = subprocess.Popen(
        [sys.executable, "-m", "spots", "calibrate", *words, "--port", "virtual"],
        stdout=subprocess.DEVNULL,
        start_new_session=True,
    )
    end_s = time.monotonic() + 20
    while time.monotonic() < end_s and (not path.exists() or path.read_bytes().count(b"\n") < 4):
        time.sleep(0.002)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    data = path.read_bytes()
    before = data[: data.rfind(b"\n") + 1]
    assert 4 <= before.count(b"\n") < 40
    path.write_bytes(data + b'{"kind":"pos')
    assert run(*words) == 0
    assert path.read_bytes().startswith(before)
    places = [point.place_um for point in Session(path).points]
    assert len(places) == len(set(places)) == 40


@pytest.mark.board
def test_a_session_that_is_whole_takes_no_press_again(full, capsys):
    before = full.session.read_bytes()
    calibration = file.load(full.out)
    assert run("force", "--session", full.session) == 0
    assert full.session.read_bytes() == before
    again = file.load(full.out)
    assert (again.lines, again.joint) == (calibration.lines, calibration.joint)
    assert "the board uses calibration" in capsys.readouterr().out


@pytest.mark.board
def test_an_unfinished_joint_is_left_out_until_it_is_finished(full, tmp_path, capsys):
    path, out = tmp_path / "a.jsonl", tmp_path / "a.toml"
    lines = full.session.read_bytes().splitlines(keepends=True)
    others = [line for line in lines if b'"kind":"joint"' not in line]
    path.write_bytes(b"".join([*others, *lines[len(others) :][:3]]))
    assert run("force", "--session", path) == 0
    said = capsys.readouterr().out
    without = "the calibration is written without the joint: a joint needs 4 angles or more"
    assert said.count(without) == 1
    assert file.load(out).original == file.load(full.out).original
    assert file.load(out).joint is None
    assert run("joint", "--session", path) == 0
    assert file.load(out).joint is not None


@pytest.mark.board
def test_no_angle_of_a_joint_is_taken_twice(full, tmp_path, capsys):
    path, out = tmp_path / "a.jsonl", tmp_path / "a.toml"
    lines = full.session.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(line for line in lines if b'"kind":"joint"' not in line))
    out.write_bytes(full.out.read_bytes())
    assert run("joint", "--places", 4, "--session", path) == 0
    # Some of the seven angles were measured already; the session asks to turn the joint further.
    assert run("joint", "--places", 7, "--session", path) == 0
    assert (
        capsys.readouterr().out.count("degrees was measured already: turn the joint further") == 4
    )
    for direction in (1, -1):
        angles = [p.angle_deg for p in Session(path).of("joint") if p.direction == direction]
        assert len(angles) == len(set(angles)) == 5


def test_an_interrupted_session_has_the_length_of_the_strip(full, sensor, tmp_path):
    path = tmp_path / "a.jsonl"
    length_um = 1000 * sensor.length_mm
    lines = full.session.read_bytes().splitlines(keepends=True)
    kinds = [json.loads(line)["kind"] for line in lines]
    assert Session(full.session).length_um == length_um
    path.write_bytes(b"".join(lines[: kinds.index("position") + 14]))
    cut = Session(path)
    assert cut.length_um == length_um
    assert "calibrate position" in steps.missing_step(cut)
    path.write_bytes(b"".join(lines[: kinds.index("force") + 1]))
    assert Session(path).length_um == length_um
    assert "calibrate force" in steps.missing_step(Session(path))


@pytest.mark.board
def test_more_places_add_to_those_there_are(full, tmp_path):
    path = tmp_path / "more.jsonl"
    path.write_bytes(full.session.read_bytes())
    assert run("position", "--places", 25, "--session", path) == 0
    places = [p.place_um for p in Session(path).of("position")]
    assert len(places) == len(set(places)) > 25


# ---- mistakes


def refused(capsys, *words):
    assert run(*words) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    return said


@pytest.mark.board
def test_one_kind_alone_says_which_comes_next(tmp_path, capsys):
    path = tmp_path / "a.jsonl"
    words = ["--session", path, "--keep-settings", "--channels", "F3,F4,F5,F6,F7,F8"]
    assert run("force", *words) == 0
    assert f"next: 'spots calibrate position --session {path}'" in capsys.readouterr().out
    assert not path.with_suffix(".toml").exists()
    assert "first run 'spots calibrate position" in refused(
        capsys, "strain", "--strain-percent", 10, "--session", path
    )


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["strain"], "--strain-percent belong together: give both"),
        (["position", "--strain-percent", 5], "'spots calibrate strain' and --strain-percent"),
        (["position", "--places", 5], "must be from 12 to 1000 for 'position'"),
        (["force", "--places", 5], "must be from 14 to 1000 for 'force'"),
        (["position", "--places", 0], "must be from 12 to 1000 for 'position'"),
        (["strain", "--strain-percent", 10], "calibrate position and force before strain"),
        (["joint"], "there is no file"),
        (["position", "--channels", "F1,F2"], "six different diodes"),
        (["position", "--sensor", "nosuch"], "cannot read the sensor file"),
    ],
)
def test_a_mistake_is_one_sentence_and_changes_nothing(tmp_path, capsys, words, says):
    path = tmp_path / "a.jsonl"
    assert says in refused(capsys, *words, "--session", path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.board
def test_a_calibration_is_never_written_over_its_session(full, tmp_path, capsys):
    before = full.session.read_bytes()
    named = tmp_path / "s.toml"
    named.write_bytes(before)
    assert "--session and --out name the same file" in refused(capsys, "force", "--session", named)
    other = tmp_path / "s.jsonl"
    other.write_bytes(before)
    out = tmp_path.parent / tmp_path.name / ".." / tmp_path.name / "s.jsonl"
    said = refused(capsys, "force", "--session", other, "--out", out)
    assert "--session and --out name the same file" in said
    assert named.read_bytes() == other.read_bytes() == before


def test_a_session_of_another_board_or_setting_is_refused(full, sensor, tmp_path, capsys):
    before = full.session.read_bytes()
    session = Session(full.session)
    made = session.conditions
    for name, value, says in (
        ("board", "0123", f"belongs to board {made.board}, but this is board 0123"),
        ("plan", ("F1", *made.plan[1:]), "made at other settings: restore them with 'spots com"),
        ("gain", 4, "set channels=F3,F4,F5,F6,F7,F8 gain=9"),
        ("exposure_us", 20_000, "exposure_us=10000"),
    ):
        with pytest.raises(SpotsError, match=re.escape(says)):
            session.check(Conditions(**made._asdict() | {name: value}))
    session.check(made)
    other = tmp_path / "other.toml"
    text = (DATA / "sensors" / "default.toml").read_text()
    other.write_text(text.replace("length_mm = 85.0", "length_mm = 60.0"))
    said = refused(capsys, "position", "--session", full.session, "--sensor", other)
    assert "belongs to board" in said
    plan = refused(capsys, "position", "--session", full.session, "--channels", "F1,F2,F3,F4,F5,F6")
    assert "was made with channels F3,F4,F5,F6,F7,F8" in plan
    assert full.session.read_bytes() == before


class Wrong(StagePresser):
    """A presser that makes a mistake at the tenth position, one time or always."""

    def __init__(self, stage, mistake, times):
        super().__init__(stage)
        self.mistake, self.times, self.presses = mistake, times, 0

    def press(self, wanted):
        self.presses += 1
        super().press(wanted)
        held = self._stage.held
        if 10 <= self.presses < 10 + self.times:
            self.mistake(held, held.press)

    def release(self):
        held = self._stage.held
        for name in ("presses", "ambient_uW_cm2"):
            vars(held).pop(name, None)
        super().release()


def elsewhere(held, press):
    held.press = Press(press.position_mm - 20, press.force_mN, press.width_mm)


def lightly(held, press):
    held.press = Press(press.position_mm, 3000.0, press.width_mm)


def barely(held, press):
    held.press = Press(press.position_mm, 152.5, press.width_mm)


def not_at_all(held, press):
    held.press = None


def in_a_flood_of_light(held, press):
    held.ambient_uW_cm2 = lambda start_s, end_s: 1e4


def harder_and_harder(held, press):
    def presses(time_s):
        return [Press(press.position_mm, 2000 + 1500 * (time_s % 4), press.width_mm)]

    held.presses = presses


def trembling(held, press):
    def presses(time_s):
        at_mm = press.position_mm + 2 * np.sin(2 * np.pi * 13 * time_s)
        return [Press(at_mm, press.force_mN, press.width_mm)]

    held.presses = presses


MISTAKES = [
    (elsewhere, "the colour does not fit the neighbouring presses"),
    (lightly, "the brightness does not fit the neighbouring presses"),
    (barely, "too dark: press harder"),
    (not_at_all, "no press is seen"),
    (in_a_flood_of_light, "a channel is saturated"),
    (harder_and_harder, "the light changes: hold still"),
    (trembling, "hold still"),  # light and colour change; it is random which is noticed first
]


def session_of(stage, presser, path, guide, kind="position", **options):
    bench = Bench(stage.reader, presser, guide, stage.length_um, path.with_suffix(".toml"))
    options = argparse.Namespace(
        **{"channels": "F3,F4,F5,F6,F7,F8", "keep_settings": True, **options}
    )
    count = {"position": 17, "force": 16, "joint": 5}[kind]
    steps.calibrate(bench, Session(path), kind, count, None, options)


def guide():
    out = io.StringIO()
    return Guide(Console(file=out, width=200)), out


@pytest.mark.board
@pytest.mark.parametrize(("mistake", "says"), MISTAKES)
@pytest.mark.parametrize("times", [1, 99])
def test_a_bad_press_is_said_and_repeated_and_given_up_in_the_end(
    sensor, tmp_path, mistake, says, times
):
    path = tmp_path / "a.jsonl"
    shown, out = guide()
    with Stage(sensor, seed=2) as stage:
        if times == 1:
            session_of(stage, Wrong(stage, mistake, times), path, shown)
            assert says in out.getvalue()
            assert out.getvalue().count("; try again") == 1
            assert len(Session(path).points) == 17
        else:
            with pytest.raises(
                SpotsError, match=f"^47.8 mm with 6 N: .*{says}.*start the session again"
            ):
                session_of(stage, Wrong(stage, mistake, times), path, shown)
            assert len(Session(path).points) == 9
            assert stage.held.press is None
    counts = np.array([p.counts for p in Session(path).points])
    assert (np.diff(counts.mean(axis=1)) < 0).all()  # the bad presses were not recorded


@pytest.mark.board
def test_light_that_does_not_grow_with_the_force_is_no_force(sensor, tmp_path):
    def softer(held, press):
        held.press = Press(press.position_mm, 0.5 * press.force_mN, press.width_mm)

    shown, out = guide()
    with Stage(sensor, seed=2) as stage:
        session_of(stage, Wrong(stage, softer, 1), tmp_path / "a.jsonl", shown, "force")
    assert "the brightness does not increase with the force" in out.getvalue()


@pytest.mark.board
def test_a_strip_whose_colour_does_not_change_is_refused(sensor, tmp_path):
    clear = replaced(sensor, dye={"strength_per_mm": 0.0})
    shown, _ = guide()
    with Stage(clear, seed=2, settings=LONG) as stage:
        session_of(stage, StagePresser(stage), tmp_path / "a.jsonl", shown)
        with refusal(CalibrationError):
            session_of(stage, StagePresser(stage), tmp_path / "a.jsonl", shown, "force")
        assert stage.board.command("hello")["calibration"] is None
    assert not (tmp_path / "a.toml").exists()


def test_a_session_of_a_stage_with_one_force_goes_on_by_hand_with_another_force(full):
    session = Session(full.session)
    session.points = session.of("position")
    surface = hand._surface(session, session.length_um)
    assert hand._next(session, surface, session.length_um, False, 0.0).force_mN == 2000
    session.points += Session(full.session).of("force")
    surface = hand._surface(session, session.length_um)
    assert hand._next(session, surface, session.length_um, False, 0.0).force_mN != 2000


# ---- the calibration that the board stores


@pytest.mark.board
def test_power_lost_before_save_leaves_the_calibration_before(sensor, full):
    with Touched(sensor, full.out) as touched:
        old = checksum(list(touched.made.lines))
        session = Session(full.session)
        session.points = [p for p in session.points if p.kind != "strain"]
        new = make(session)
        upload(touched.board, new.lines)
        assert touched.board.command("hello")["calibration"] == checksum(list(new.lines)) != old
        touched.board.command("reboot")
        for _ in touched.board.frames(0.5):
            pass
        assert touched.board.command("hello")["calibration"] == old


def test_an_upload_that_breaks_off_leaves_the_calibration_before(sensor, full):
    with Touched(sensor, full.out) as touched:
        old = checksum(list(touched.made.lines))
        touched.board.command("cal begin")
        for line in touched.made.lines[:50]:
            touched.board.command("cal " + line)
        with refusal(BoardError, why="bad_calibration"):
            touched.board.command("cal end " + old)
        assert touched.board.command("hello")["calibration"] == old


def test_a_calibration_of_something_else_is_refused_and_the_board_keeps_its_own(sensor, full):
    with Touched(sensor, full.out) as touched:
        old = checksum(list(touched.made.lines))
        for name, value, says in (
            ("board ", "board 0123", "made on board 0123"),
            ("made ", "made 8 10000 20", "made at gain=8"),
            ("plan ", "plan F1 F4 F5 F6 F7 F8", "made with channels=F1"),
        ):
            lines = [value if line.startswith(name) else line for line in touched.made.lines]
            foreign = msgspec.structs.replace(touched.made, lines=tuple(lines))
            with pytest.raises(SpotsError, match=says):
                file.send(touched.board, foreign)
            assert touched.board.command("hello")["calibration"] == old


# ---- a simulated person


class Person(io.StringIO):
    """A simulated person who reads the output, presses the strip, and answers questions."""

    def __init__(self, held, sensor):
        super().__init__()
        self._held, self._sensor = held, sensor
        self._angle = 0
        self.asked = []

    def write(self, text):
        if found := re.search(r"press at ([\d.]+) mm with ([\d.]+) N and hold", text):
            self._held.press = Press(float(found[1]), 1000 * float(found[2]), 4.0)
        elif text.startswith("release"):
            self._held.press = None
        elif text.strip().endswith("?") or "draw marks" in text:
            self.asked.append(text)
        return super().write(text)

    def readline(self):
        if "draw marks" in self.asked[-1]:
            return "indenter\n"  # a joint will use the strip
        if "scale" in self.asked[-1]:
            return "nonsense\n" if len(self.asked) == 1 else "0,2\n"
        self._angle += 10 * (1 if "up" in self.asked[-1] else -1)
        lag = 0.01 if "down" in self.asked[-1] else -0.01
        radius_mm = self._sensor.joint.radius_mm
        place_mm = 10 + np.radians(self._angle + lag) * radius_mm
        self._held.press = Press(place_mm, 4000.0, 4.0)
        return f"{self._angle}\n"


@pytest.mark.board
def test_a_person_is_led_through_position_force_and_joint(sensor, tmp_path):
    path = tmp_path / "a.jsonl"
    with Stage(sensor, seed=4, settings=LONG) as stage:
        person = Person(stage.held, sensor)
        shown = Guide(Console(file=person, width=200), stdin=person)
        presser = Presser(shown)
        for kind in ("position", "force"):
            session_of(stage, presser, path, shown, kind)
        assert "'nonsense' is not valid: type a number from" in person.getvalue()
        stage.held.press = None
        session_of(stage, presser, path, shown, "joint")
    made = file.load(path.with_suffix(".toml"))
    assert "presser indenter" in made.lines
    assert made.residuals[0].position_rms_um < 50
    assert made.joint.deg_per_um == pytest.approx(np.degrees(1 / 25_000), rel=0.005)


def test_a_least_force_in_grams_is_asked_again():
    out = io.StringIO()
    shown = Guide(Console(file=out, width=200), stdin=io.StringIO("20\n11,3\nnan\n0,2\n"))
    wanted = Wanted(kind="force", place_um=76_500, force_mN=FULL_MN)
    assert Presser(shown).least_mN(wanted, None) == pytest.approx(200)
    for answer in ("20", "11,3", "nan"):
        assert f"'{answer}' is not valid: type a number from 0.01 to 6" in out.getvalue()


def test_a_closed_standard_input_is_an_error(sensor, tmp_path):
    with Stage(sensor) as stage:
        shown = Guide(Console(file=io.StringIO()), stdin=io.StringIO())
        presser = Presser(shown)
        presser.release = lambda: None
        with refusal(StateError):
            session_of(stage, presser, tmp_path / "a.jsonl", shown, "force")


@pytest.mark.board
def test_a_terminal_shows_the_place_and_the_counts(sensor, tmp_path):
    out = io.StringIO()
    console = Console(file=out, force_terminal=True, width=100, height=40)
    with Stage(sensor, seed=2) as stage, Guide(console) as shown:
        session_of(stage, StagePresser(stage), tmp_path / "a.jsonl", shown)
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", out.getvalue())
    assert "positions  12 of 17" in text
    assert "▲" in text
    assert re.search(r"11[56]\d ct", text)
    assert "steady" in text


# ---- the integer arithmetic of the board


def float_estimates(calibration, counts, dark):
    """Compute positions and forces from a calibration with floats, to check the board's integers.

    At the border of two segments, rounding decides which segment the board uses. So the result is a
    list of (position in um, force in mN) for each segment that the board may use.

    Parameters
    ----------
    calibration : Calibration
        The calibration.
    counts : sequence of int
        Six counts of a reading.
    dark : sequence of int
        Six sums of four dark samples.
    """
    logs = np.log2(np.asarray(counts, float) - np.asarray(dark) / 4) * 2**20
    coarse = logs @ np.array(coarse_of(calibration)) / 2**13
    found = []
    for slack in (-16, 16):
        at = max(np.searchsorted(bounds_of(calibration), coarse + slack, side="right") - 1, 0)
        part = segments_of(calibration)[at]
        contrast = logs @ np.array(part.position) / 2**13
        brightness = logs @ np.array(part.force) / 2**13
        brightness -= np.interp(contrast, part.contrasts, part.offsets)
        found.append(
            (
                np.interp(contrast, part.contrasts, part.positions_um),
                np.interp(brightness, calibration.brightnesses, calibration.forces_mN),
            )
        )
    return found


def agree(calibration, counts, dark, position_um, force_mN):
    estimates = float_estimates(calibration, counts, dark)
    return any(abs(x - position_um) <= 1 and abs(f - force_mN) <= 1 for x, f in estimates)


@pytest.mark.board
@pytest.mark.parametrize("strain_ppm", [0, STRAIN_PPM])
def test_the_integers_agree_with_float64(sensor, full, strain_ppm):
    made = file.load(full.out)
    calibration = Calibration(made.lines, strain_ppm)
    bound = Bound(sensor, made.plan, made.gain, made.exposure_us, made.led_mA)
    rng = np.random.default_rng(0)
    decode = Decoded()
    decode.calibration = calibration
    least_mN = calibration.forces_mN[0] + 20
    decoded = 0
    strain = strain_ppm * 1e-6
    for position_um in np.linspace(0, 85_000 * (1 + strain), 120):
        for force_mN in np.geomspace(least_mN, FULL_MN, 20):
            light = bound.counts(position_um, force_mN, strain=strain)
            dark = rng.integers(0, 9, 6).tolist()
            counts = np.round(light + np.array(dark) / 4 + rng.normal(0, 0.3, 6)).astype(int)
            decode.update(counts.tolist(), 1, dark, 0)
            if decode.force_mN:
                decoded += 1
                assert agree(calibration, counts, dark, decode.position_um, decode.force_mN)
    assert decoded > 2300


@pytest.mark.board
def test_the_board_agrees_with_float64(sensor, full):
    with Touched(sensor, full.out) as touched:
        calibration = Calibration(touched.made.lines)
        dark = np.array(touched.board.command("get")["dark"]) / (DARK_SAMPLES / 4)
        for position_um in np.linspace(1000, 84_000, 12):
            for force_mN in (calibration.forces_mN[0] + 100.0, 1500.0, 9900.0):
                # Else a weak press after a firm one would be light that sticks.
                touched.lift()
                for touch, spectrum in touched.readings(position_um, force_mN, 3):
                    if not touch.touching:  # without a touch, there is no position
                        continue
                    assert touch.force_mN
                    found = touch.position_um, touch.force_mN
                    assert agree(calibration, spectrum.counts, dark, *found)


def test_the_session_file_holds_all_raw_material(full):
    rows = [json.loads(line) for line in full.session.read_text().splitlines()]
    kinds = {"choose", "position", "force", "strain", "joint", "mark"}
    assert {row["kind"] for row in rows} == kinds
    for row in rows:
        assert len(row["counts"]) == len(row["variance"]) == len(row["plan"]) == 6
        assert row["time"].endswith("+00:00")
