"""Atomic writes: a file is complete or unchanged, links are not followed, nothing else remains."""

import os
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.frames import stream
from support.reels import record
from support.refusals import refusal

from spots.cli import main
from spots.common import atomic
from spots.deploy import build
from spots.errors import FileError
from spots_sim.measure import figures

# Script that waits in the middle of a write, at the sync to disk, where the test interrupts it.
WRITER = """
import os, sys
from pathlib import Path
from spots.common import atomic
from spots.deploy import build
TEXT = atomic.begins("a text", b"")
def wait(*_):
    print("ready", flush=True)
    sys.stdin.read()
if sys.argv[1] == "file":
    os.fsync = wait
    atomic.write_text("new", Path(sys.argv[2]), TEXT)
else:
    build._compile = wait
    build.build("virtual", Path(sys.argv[2]))
"""

TEXT = atomic.begins("a text", b"")


@pytest.fixture
def interrupted():
    """Return a function that starts a process with `WRITER`, and waits until its write waits."""
    processes = []

    def start(*arguments):
        command = [sys.executable, "-c", WRITER, *map(str, arguments)]
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        processes.append(process)
        assert process.stdout.readline() == b"ready\n"
        return process

    yield start
    for process in processes:
        process.kill()
        process.communicate()


def kill(process):
    process.send_signal(signal.SIGKILL)
    process.communicate()


def age(folder):
    """Make all temporary files in a folder old: set their times to 1970."""
    for path in folder.glob(".spots-*"):
        os.utime(path, (0, 0), follow_symlinks=False)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def linked(path, victim):
    victim.write_text("precious")
    path.symlink_to(victim)


def test_a_saved_file_follows_no_planted_link(tmp_path):
    victim = tmp_path / "victim"
    linked(tmp_path / "a.toml.new", victim)
    atomic.write_text("new", tmp_path / "a.toml", TEXT)
    assert victim.read_text() == "precious"
    assert (tmp_path / "a.toml").read_text() == "new"
    assert (tmp_path / "a.toml.new").is_symlink()


@pytest.mark.parametrize("kind", ["mcap", "csv", "npz"])
def test_an_export_follows_no_planted_link(tmp_path, kind):
    record(tmp_path / "x.spots", stream(5))
    victim = tmp_path / "victim"
    name = "x-touch.csv" if kind == "csv" else f"x.{kind}"
    linked(tmp_path / f"{name}.part", victim)
    assert main(["export", str(tmp_path / "x.spots"), "--to", kind]) == 0
    assert victim.read_text() == "precious"
    header = ["x-header.json"] if kind == "csv" else []
    assert names(tmp_path) == sorted(["victim", "x.spots", name, f"{name}.part", *header])


def test_an_export_does_not_replace_a_link_to_nowhere(tmp_path, capsys):
    record(tmp_path / "x.spots", stream(5))
    (tmp_path / "x.npz").symlink_to(tmp_path / "nowhere")
    assert main(["export", str(tmp_path / "x.spots"), "--to", "npz"]) == 2
    assert "x.npz exists: choose another name" in capsys.readouterr().err
    assert names(tmp_path) == ["x.npz", "x.spots"]


@pytest.mark.board
@pytest.mark.parametrize("write", ["toml", "picture"])
def test_a_link_in_the_place_of_the_file_is_replaced_and_not_followed(tmp_path, write):
    victim = tmp_path / "victim"
    path = tmp_path / "a.png"
    linked(path, victim)
    victim.write_bytes(before := b"\x89PNG\r\n\x1a\n" if write == "picture" else b"precious")
    if write == "toml":
        atomic.write_text("new", path, TEXT)
    else:
        figures.save(figures.panels(width=1, height=1)[0], path)
    assert victim.read_bytes() == before
    assert not path.is_symlink()


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o755])
def test_a_replaced_file_keeps_its_mode(tmp_path, mode):
    path = tmp_path / "a.toml"
    path.write_text("old")
    path.chmod(mode)
    atomic.write_text("new", path, TEXT)
    assert stat.S_IMODE(path.stat().st_mode) == mode


@pytest.mark.parametrize("umask", [0o022, 0o077])
def test_a_new_file_has_the_mode_of_any_other(tmp_path, umask):
    before = os.umask(umask)
    try:
        atomic.write_text("new", tmp_path / "a.toml", TEXT)
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a.toml").stat().st_mode) == 0o666 & ~umask


def test_what_is_no_file_is_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("/dev/null")
    for name in ("pipe", "link"):
        with refusal(FileError, file=name):
            atomic.write_text("new", tmp_path / name, TEXT)
    assert (tmp_path / "pipe").is_fifo()
    assert (tmp_path / "link").is_symlink()
    assert names(tmp_path) == ["link", "pipe"]


@pytest.mark.board
def test_a_killed_writer_leaves_the_old_file_and_the_next_one_cleans_up(tmp_path, interrupted):
    path = tmp_path / "a.toml"
    path.write_text("old")
    writer = interrupted("file", path)
    kill(writer)
    assert path.read_text() == "old"
    assert len(names(tmp_path)) == 2, "the left-over of the killed writer is there"
    atomic.write_text("next", tmp_path / "b.toml", TEXT)
    assert len(names(tmp_path)) == 3, "it may be of a living writer"
    age(tmp_path)
    atomic.write_text("next", tmp_path / "b.toml", TEXT)
    assert names(tmp_path) == ["a.toml", "b.toml"]


@pytest.mark.board
def test_the_file_of_a_living_writer_stays(tmp_path, interrupted):
    path = tmp_path / "a.toml"
    writer = interrupted("file", path)
    atomic.write_text("other", path, TEXT)
    assert len(names(tmp_path)) == 2
    writer.communicate(b"")
    assert writer.returncode == 0
    assert path.read_text() == "new"
    assert names(tmp_path) == ["a.toml"]


@pytest.mark.board
@pytest.mark.parametrize("what", ["file", "build"])
@pytest.mark.parametrize("whose", ["this process", "another process"])
def test_what_a_living_process_writes_stays_when_the_clock_is_set_forward(
    tmp_path, interrupted, monkeypatch, what, whose
):
    def clean_up():
        monkeypatch.setattr(atomic.time, "time", lambda: time.time_ns() / 1e9 + 7200)
        atomic.write_text("next", tmp_path / "b.toml", TEXT)
        with atomic.folder(tmp_path):
            pass

    target = tmp_path if what == "build" else tmp_path / "a.toml"
    if whose == "another process":
        writer = interrupted(what, target)
        clean_up()
        assert len(names(tmp_path)) == 2
        kill(writer)
        clean_up()
        assert names(tmp_path) == ["b.toml"]
    elif what == "file":
        with atomic.replacing(target, TEXT) as file:
            clean_up()
            file.write(b"new")
        assert target.read_bytes() == b"new"
    else:
        with atomic.folder(target) as staging:
            clean_up()
            assert staging.is_dir()


def test_a_temporary_folder_removes_what_a_killed_program_left(tmp_path, monkeypatch):
    """Fails if boards and sessions that were killed fill the temporary folder."""
    monkeypatch.setattr(atomic.tempfile, "tempdir", str(tmp_path))
    left = tmp_path / ".spots-abcdefgh.part"
    (left / "files").mkdir(parents=True)
    os.utime(left, (0, 0))
    with atomic.temporary() as folder:
        assert folder.is_relative_to(tmp_path)
        assert not list(folder.iterdir())
        assert not left.exists()
    assert names(tmp_path) == []


@pytest.mark.board
def test_only_left_overs_of_ours_are_removed(tmp_path, interrupted):
    kill(interrupted("file", tmp_path / "a.toml"))
    (left_over,) = tmp_path.iterdir()
    ours = left_over.name
    left_over.unlink()
    target = tmp_path / "target"
    target.write_text("precious")
    kept = [ours.replace(ours[8:12], word) for word in ("0000", "0001", "0002")]
    (tmp_path / kept[0]).symlink_to(target)
    (tmp_path / kept[1]).mkdir()
    os.mkfifo(tmp_path / kept[2])
    for name in ("x" + ours, ours + "x", ours.upper(), ours[1:], "a.part", "a.toml.new"):
        (tmp_path / name).write_text("precious")
        kept.append(name)
    age(tmp_path)
    atomic.write_text("next", tmp_path / "b.toml", TEXT)
    assert names(tmp_path) == sorted([*kept, "target", "b.toml"])


@pytest.mark.board
def test_a_killed_build_is_cleaned_up_by_the_next_one(tmp_path, interrupted):
    build.build("virtual", tmp_path)
    kill(interrupted("build", tmp_path))
    age(tmp_path)
    other = interrupted("build", tmp_path)
    assert len(names(tmp_path)) == 2, "the folder of the living build stays"
    build.build("virtual", tmp_path)
    assert len(names(tmp_path)) == 2
    kill(other)
    age(tmp_path)
    build.build("virtual", tmp_path)
    assert names(tmp_path) == ["virtual"]


def test_a_new_file_does_not_replace_one_that_came_meanwhile(tmp_path):
    path = tmp_path / "a"

    def write():
        with atomic.replacing(path, None) as file:
            file.write(b"ours")
            path.write_bytes(b"theirs")

    with refusal(FileError):
        write()
    assert path.read_bytes() == b"theirs"
    assert [one.name for one in tmp_path.iterdir()] == ["a"]


@pytest.mark.board
def test_a_build_that_cannot_take_its_place_leaves_the_old_one(tmp_path, monkeypatch):
    before = build.files_of(build.build("virtual", tmp_path))
    rename = Path.rename

    def refused(self, target):
        if self.name == "new":
            raise OSError(28, "No space left on device")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", refused)
    with refusal(FileError, file="virtual"):
        build.build("virtual", tmp_path)
    assert build.files_of(tmp_path / "virtual") == before
