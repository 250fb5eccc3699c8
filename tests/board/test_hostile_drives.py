"""`spots flash` and `erase` on drives with links, FIFOs and other special files.

No file outside the drive may change.
"""

import contextlib
import hashlib
import io
import os
import shutil
import stat
import tempfile
from pathlib import Path, PurePosixPath
from types import SimpleNamespace

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support.refusals import refusal

from spots.cli import main
from spots.deploy import flash as flashing
from spots.deploy import nofollow
from spots.deploy import staging as stage
from spots.deploy.build import files_of
from spots.deploy.flash import USER_FILES
from spots.errors import FileError
from spots.link import serial_link as link

BOARD = "qtpy_rp2040"
ABOUT = (
    "Adafruit CircuitPython 9.2.1 on 2026-01-01; Some board\n"
    "Board ID:adafruit_qtpy_rp2040\nUID:0123AB\n"
)
# Files in the home folder beside the drive; some have names that `flash` writes or `erase` removes.
HOME = (".ssh/id_ed25519", "thesis.txt", "app.py", "code.py", "runtime/__init__.py", "i2c_bit.py")
LINKED = "linked.txt"  # a file that also has a name on the drive, a hard link
NAMES = frozenset({"spots.sha256", *stage.names("circuitpython")})
# Paths of special files: where `flash` writes, beside these paths, and with names of user files.
PLACES = (
    "spots_device",
    "spots_device/runtime",
    "lib",
    "lib/adafruit_register",
    "lib/adafruit_register/i2c_bit.py",
    "code.py",
    "boot.py",
    "board_config.py",
    "spots_device/board/app.py",
    "spots_device/runtime/__init__.py",
    "spots_device/reading/kernel.mpy",
    "spots.sha256",
    "spots.sha256.part",
    "code.py.part",
    "spots_device/board/app.py.part",
    "boot_out.txt",
    "settings.txt",
    "calibration-a.txt",
    "calibration.txt.old",
    "notes.py",
    "spots_device/mine.py",
    "lib/neopixel.py",
    "spots_device/mine",
    "lib/mine/deep",
    ".Trash",
    "spots_device/\u2603 \xe9.py",
    "lib/new\nline.py",
    "-rf",
    "spots_device/*",
)
KINDS = (
    "folder_link",
    "file_link",
    "relative_link",
    "dangling",
    "loop",
    "fifo",
    "hard_link",
    "folder",
    "file",
)
STATES = ("blank", "flashed", "copied", "older")
COMMANDS = (["flash", BOARD], ["erase", BOARD, "--yes"])


@pytest.fixture(scope="module")
def built(built):
    """The files that `flash` writes; the builds are those that all tests share."""
    folder = built(BOARD)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(flashing, "build", lambda board, root, strips: folder)
        patch.setattr(flashing, "_greet", lambda there: None)
        patch.setattr(link, "usb_ports", list)
        patch.setattr(os, "fsync", lambda handle: None)  # saves time; no test cuts the power
        yield Files(files_of(folder))


class Files(dict):
    """Files by path, with a short `repr` for the reports of failed tests."""

    def __repr__(self):
        return f"<{len(self)} files>"


class Sandbox:
    """A temporary home folder, and a drive beside it."""

    def __init__(self, root, built, state):
        self.home, self.drive = root / "home", root / "drive"
        for path in (*HOME, LINKED):
            put(self.home / path, f"private: {path}".encode())
        os.mkfifo(self.home / "pipe")
        self.drive.mkdir()
        put(self.drive / "boot_out.txt", ABOUT.encode())
        put(self.drive / "spots_device" / "hers.py", b"a user's own, among ours")
        files = {"blank": {}, "flashed": built, "copied": without_manifest(built)}
        for path, data in (files[state] if state in files else older()).items():
            put(self.drive / path, data)
        for path in [*self.home.rglob("*"), self.home]:
            os.utime(path, (1, 2))  # a read would set a later access time
        self.inodes = {path.lstat().st_ino for path in [*self.home.rglob("*"), self.home]}

    def trap(self, path, kind):
        """Replace the file at `path` on the drive by a link, a FIFO or another special file."""
        where = self.drive / path
        if any(not stat.S_ISDIR(up.lstat().st_mode) for up in ups(where, self.drive)):
            return
        where.parent.mkdir(parents=True, exist_ok=True)
        if kind in ("file", "folder") and where.exists():
            return
        if where.is_dir() and not where.is_symlink():
            shutil.rmtree(where)
        where.unlink(missing_ok=True)
        self.plant(where, kind)

    def plant(self, where, kind):
        if kind == "folder_link":
            where.symlink_to(self.home)
        elif kind == "file_link":
            where.symlink_to(self.home / "thesis.txt")
        elif kind == "relative_link":
            where.symlink_to(os.path.relpath(self.home, where.parent))
        elif kind == "dangling":
            where.symlink_to(self.home / "not_there_yet")
        elif kind == "loop":
            where.symlink_to(where)
        elif kind == "fifo":
            os.mkfifo(where)
        elif kind == "hard_link":
            os.link(self.home / LINKED, where)
            self.inodes.discard(where.lstat().st_ino)  # the file is also on the drive
        elif kind == "folder":
            where.mkdir()
        else:
            where.write_bytes(b"odd")


def ups(where, top):
    return [up for up in where.parents if up.is_relative_to(top) and os.path.lexists(up)]


def put(path, data):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


def without_manifest(built):
    return {path: data for path, data in built.items() if path != "spots.sha256"}


def older():
    """Return the files of a drive that an older version with other modules has flashed.

    The result is a dict by path. The manifest, the list of flashed files, also names files outside
    the drive and a changed file, and has an invalid line.
    """
    files = {"code.py": b"import old", "old_package/app.py": b"old", "old_package/in/x.py": b"x"}
    lines = [f"{hashlib.sha256(data).hexdigest()}  {path}\n" for path, data in files.items()]
    lines += [f"{'0' * 64}  {path}\n" for path in ("../home/thesis.txt", "/etc/passwd")]
    lines += [f"{hashlib.sha256(b'before').hexdigest()}  notes.py\n", "no line of a manifest\n"]
    return files | {"spots.sha256": "".join(lines).encode(), "notes.py": b"changed since"}


def snapshot(folder, times=True):
    """Return content and metadata of all files in a folder, as a dict by path.

    The access times are restored after the files were read.
    """
    found = {}
    for path in [folder, *sorted(folder.rglob("*"))]:
        status = path.lstat()
        entry = [status.st_mode, status.st_mtime_ns if times else 0]
        if times:
            # This function reads the folders, and `LINKED` may be read as a file on the drive.
            reads = stat.S_ISDIR(status.st_mode) or path.name == LINKED
            entry.append(0 if reads else status.st_atime_ns)
        if path.is_symlink():
            entry.append(os.readlink(path))
        elif stat.S_ISREG(status.st_mode):
            entry.append(path.read_bytes())
            os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
        found[path.relative_to(folder).as_posix()] = entry
    return found


def run(sandbox, command):
    """Run a command on the drive and return its exit code; no file outside may be opened."""
    opened, usual = [], os.open

    def watched(path, *arguments, **options):
        handle = usual(path, *arguments, **options)
        if os.fstat(handle).st_ino in sandbox.inodes:
            opened.append(path)
        return handle

    errors = io.StringIO()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "open", watched)
        with contextlib.redirect_stderr(errors), contextlib.redirect_stdout(io.StringIO()):
            code = main([*command, "--port", str(sandbox.drive)])
    assert opened == []
    assert code in (0, 2)
    assert errors.getvalue().count("\n") == (1 if code else 0), errors.getvalue()
    return code


def listed(sandbox, built, state):
    """Return the paths that the manifest on the drive names; none if it was replaced."""
    files = {"older": older(), "flashed": built}.get(state, {})
    manifest = sandbox.drive / "spots.sha256"
    if not files or manifest.is_symlink() or not manifest.is_file():
        return set()
    return set(files) if manifest.read_bytes() == files["spots.sha256"] else set()


def is_a_boards(sandbox):
    """Return whether boot_out.txt on the drive is a regular file that describes the board."""
    about = sandbox.drive / "boot_out.txt"
    return stat.S_ISREG(about.lstat().st_mode) and about.read_bytes() == ABOUT.encode()


def is_in_the_way(sandbox, path, wanted):
    """Return whether a special file at `path` blocks one of the files `wanted`."""
    wanted = wanted | {name + ".part" for name in wanted} | {"boot_out.txt"}
    where = sandbox.drive / path
    if not os.path.lexists(where):
        return False
    mode = where.lstat().st_mode
    if any(path in map(str, PurePosixPath(name).parents) for name in wanted):
        return not stat.S_ISDIR(mode)
    return path in wanted and not stat.S_ISREG(mode)


@pytest.mark.board
@settings(max_examples=40)
@given(
    st.sampled_from(STATES),
    st.lists(st.tuples(st.sampled_from(PLACES), st.sampled_from(KINDS)), max_size=4),
    st.sampled_from(COMMANDS),
)
@example("blank", [("spots_device", "folder_link")], COMMANDS[0])
@example("flashed", [("spots_device", "folder_link")], COMMANDS[1])
@example("copied", [("spots_device/runtime", "relative_link")], COMMANDS[1])
@example("flashed", [("code.py.part", "hard_link")], COMMANDS[0])
@example("blank", [("boot_out.txt", "fifo")], COMMANDS[0])
@example("older", [("spots_device/mine.py", "file_link")], COMMANDS[0])
@example("blank", [("settings.txt", "folder_link")], COMMANDS[0])
@example("blank", [("boot_out.txt", "hard_link"), ("boot_out.txt", "file")], COMMANDS[0])
@example("older", [("spots.sha256", "hard_link")], COMMANDS[0])
@example("older", [("spots.sha256", "hard_link")], COMMANDS[1])
@example("older", [("spots.sha256", "hard_link"), ("notes.py", "fifo")], COMMANDS[0])
def test_a_drive_is_done_completely_or_refused_untouched(built, state, traps, command):
    with tempfile.TemporaryDirectory() as root:
        sandbox = Sandbox(Path(root), built, state)
        for path, kind in traps:
            sandbox.trap(path, kind)
        flashed = command[0] == "flash"
        named = NAMES | listed(sandbox, built, state) | set(built if flashed else USER_FILES)
        refused = not is_a_boards(sandbox)
        refused |= any(is_in_the_way(sandbox, path, named) for path, _ in traps)
        home, drive = snapshot(sandbox.home), snapshot(sandbox.drive, times=False)
        code = run(sandbox, command)
        assert snapshot(sandbox.home) == home
        after = snapshot(sandbox.drive, times=False)
        if refused:
            assert code == 2
            assert after == drive
            return
        assert code == 0
        named -= {"notes.py"}
        # Drives that `spots` did not flash may have a code.py and a lib, too.
        files = {path for path in drive if not stat.S_ISDIR(drive[path][0])} & named
        claimed = state in ("flashed", "older") and "spots.sha256" not in {
            path for path, _ in traps
        }
        claimed |= any("/" in path and not path.startswith("lib/") for path in files)
        ours = set(named) if claimed else {"spots.sha256"}
        ours |= {name + ".part" for name in named}
        ours |= set(built) if flashed else set()
        for path in set(drive) - ours:  # the user's own files
            if not stat.S_ISDIR(drive[path][0]):
                assert after[path] == drive[path], path
        if flashed:
            for path, data in built.items():
                assert after[path][-1] == data
        left = {path for path in after if not stat.S_ISDIR(after[path][0])} & ours
        kept = {path for path, kind in traps if state in ("flashed", "older")}
        assert left <= (set(built) if flashed else kept | {"spots.sha256"})


def test_a_plain_drive_is_flashed_twice_and_erased(tmp_path, built):
    sandbox = Sandbox(tmp_path, built, "older")
    own = {name: (sandbox.drive / name).read_bytes() for name in ("boot_out.txt", "notes.py")}
    own["spots_device/hers.py"] = b"a user's own, among ours"
    assert run(sandbox, COMMANDS[0]) == 0
    assert files_of(sandbox.drive) == built | own
    assert not (sandbox.drive / "old_package").exists()
    assert run(sandbox, COMMANDS[0]) == 0
    assert files_of(sandbox.drive) == built | own
    (sandbox.drive / "board_config.py").write_bytes(b"SDA_PIN = 'mine'\n")
    assert run(sandbox, COMMANDS[1]) == 0
    assert run(sandbox, COMMANDS[1]) == 0
    kept = {path: data for path, data in built.items() if path == "spots.sha256"}
    assert files_of(sandbox.drive) == own | kept | {"board_config.py": b"SDA_PIN = 'mine'\n"}


@pytest.mark.parametrize("another", [True, False])
def test_a_junction_of_windows_and_another_file_system_are_outside(tmp_path, monkeypatch, another):
    put(tmp_path / "spots_device" / "board" / "app.py", b"")
    tree = nofollow.Tree(str(tmp_path))
    assert tree.files(["spots_device/board/app.py"]) == {"spots_device/board/app.py": 0}
    lstat = os.lstat

    def changed(path):
        status = lstat(path)
        facts = {name: getattr(status, name) for name in ("st_mode", "st_dev", "st_size")}
        if another:
            return SimpleNamespace(**facts | {"st_dev": status.st_dev + 1})
        return SimpleNamespace(**facts, st_file_attributes=stat.FILE_ATTRIBUTE_REPARSE_POINT)

    monkeypatch.setattr(os, "lstat", changed)
    for use in (tree.remove, lambda path: tree.files([path])):
        with refusal(FileError):
            use("spots_device/board/app.py")
    assert (tmp_path / "spots_device" / "board" / "app.py").is_file()
