"""Saved files of a board: after a power cut at any step, either all are old or all are new."""

import errno
import itertools
import os
import shutil
from types import SimpleNamespace

import pytest
from support.refusals import refusal

from spots_device.board import store
from spots_device.board.store import Store

NAMES = "settings", "calibration", "layout"
BOTH = [name + strip for strip in ("", "1") for name in NAMES]
OLD = {name: [f"old {name}", "of the board"] for name in NAMES}
NEW = {name: [f"new {name}"] for name in NAMES}
OTHER = {name: [f"third {name}", "and more"] for name in NAMES}
PIECE = 3  # bytes that are written in one step
TWO_OLD = {name: [f"old {name}"] for name in BOTH}
TWO_NEW = {name: [f"new {name}", "and more"] for name in BOTH}


@pytest.fixture(autouse=True)
def _in_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def save(parts):
    Store().save(parts.items())


def load():
    """Start the board; return all stored parts that are not empty, and the fault."""
    found = Store()
    parts = {name: found.load(name) for name in BOTH}
    return {name: lines for name, lines in parts.items() if lines}, found.fault


def damage(path, data=b"gain=3\n"):
    assert path.exists()
    path.write_bytes(data)


class PowerCutError(Exception):
    pass


class Flash:
    """A file system that loses power after a given number of steps.

    A step is a change of the directory, or a piece of a file.

    Parameters
    ----------
    steps : int
        Number of steps before the power cut.
    atomic : bool
        True for littlefs, where a file changes when it is closed. False for FAT, where a file is
        empty when it was opened, and then grows.
    torn : bytes
        What the power cut leaves in place of the piece that was to be written.
    """

    def __init__(self, steps, atomic=False, torn=b""):
        self.left, self.atomic, self.torn = steps, atomic, torn

    def step(self):
        if self.left == 0:
            raise PowerCutError
        self.left -= 1

    def open(self, path, mode):
        return open(path, mode) if mode == "rb" else Writer(self, path)

    def remove(self, path):
        self.step()
        os.remove(path)


class Writer:
    def __init__(self, flash, path):
        self._flash = flash
        flash.step()
        if not flash.atomic or not os.path.exists(path):
            open(path, "wb").close()
        self._path, self._content = path, b""

    def write(self, data):
        for i in range(0, len(data), PIECE):
            try:
                self._flash.step()
            except PowerCutError:
                self._content += self._flash.torn
                raise
            self._content += data[i : i + PIECE]

    def __enter__(self):
        return self

    def __exit__(self, kind, *exception):
        if self._flash.atomic:
            if kind:
                return
            self._flash.step()
        with open(self._path, "wb") as file:
            file.write(self._content)


def cut(monkeypatch, parts, flash):
    """Save parts on a `Flash`; return whether the save was complete."""
    with monkeypatch.context() as patch:
        patch.setattr(store, "open", flash.open, raising=False)
        own = SimpleNamespace(remove=flash.remove, stat=os.stat, listdir=os.listdir)
        patch.setattr(store, "os", own)
        try:
            save(parts)
        except PowerCutError:
            return False
    return True


def test_what_was_saved_is_loaded():
    save(OLD)
    assert load() == (OLD, None)
    save(NEW)
    assert load() == (NEW, None)
    save({**NEW, "calibration": []})
    assert load() == ({name: NEW[name] for name in ("settings", "layout")}, None)


def test_nothing_saved_is_nothing_loaded():
    assert load() == ({}, None)


def test_a_strip_that_is_not_there_now_keeps_its_files():
    save(TWO_OLD)
    save(NEW)
    save(OTHER)
    assert load() == ({**TWO_OLD, **OTHER}, None)


def test_what_is_stored_already_is_not_written_again(monkeypatch):
    save(OLD)
    assert cut(monkeypatch, OLD, Flash(0))
    changed = {**OLD, "settings": ["gain=3"]}
    save(changed)
    # Only the settings and the index were written.
    assert sorted(path.name for path in os.scandir() if "-b" in path.name) == [
        "saved-b.txt",
        "settings-b.txt",
    ]
    assert load() == (changed, None)


def test_a_file_that_was_damaged_since_the_start_is_written_again(tmp_path):
    save(OLD)
    running = Store()
    damage(tmp_path / "layout-a.txt")
    running.save(OLD.items())
    assert load() == (OLD, None)


BEFORE = {
    "nothing": [],
    "one save": [OLD],
    "two saves": [OTHER, OLD],
    "three saves": [OLD, OTHER, {**OTHER, "settings": ["a"]}],
    "two strips": [TWO_OLD],
}


@pytest.mark.board
@pytest.mark.parametrize("before", BEFORE)
@pytest.mark.parametrize("atomic", [False, True], ids=["FAT", "littlefs"])
def test_a_cut_at_any_step_leaves_the_old_or_the_new(tmp_path, monkeypatch, before, atomic):
    for parts in BEFORE[before]:
        save(parts)
    known = load()[0]
    wanted = TWO_NEW if before == "two strips" else {"settings": ["s"], "layout": ["l", "m"]}
    outcomes = []
    for steps in itertools.count():
        folder = tmp_path / str(steps)
        shutil.copytree(tmp_path, folder, ignore=lambda _, names: [n for n in names if n.isdigit()])
        monkeypatch.chdir(folder)
        torn = b"\xff\x00" if steps % 2 else b""
        parts = {**{name: [] for name in known}, **wanted}
        whole = cut(monkeypatch, parts, Flash(steps, atomic, torn))
        found = load()[0]
        assert found in (known, wanted)
        outcomes.append(found == wanted)
        # The power fails again, during the next save.
        cut(monkeypatch, OTHER, Flash(steps // 2, atomic))
        third = load()[0]
        assert third in (found, {**found, **OTHER})
        save(parts)
        assert load() == (wanted, None)
        monkeypatch.chdir(tmp_path)
        shutil.rmtree(folder)
        if whole:
            break
    assert outcomes == sorted(outcomes)  # first the old state, then the new one
    assert len(outcomes) > 3 * len(wanted)


@pytest.mark.parametrize("data", [b"", b"gain=3\n", b"gain=3\ncrc 0000\n", b"\xff\xfe", None])
@pytest.mark.parametrize("name", ["saved", "settings", "calibration", "layout"])
def test_a_damaged_file_gives_way_to_the_save_before_and_is_reported(tmp_path, data, name):
    save(OLD)
    save(NEW)
    path = tmp_path / f"{name}-b.txt"
    if data is None:
        path.unlink()
    else:
        damage(path, data)
    found, fault = load()
    assert found == OLD
    if name != "saved" or data:  # an index that is empty or missing was never used
        assert fault == (
            f"{name}-b.txt is damaged, or its save was interrupted: the save before it is used"
        )
    save(OTHER)
    assert load() == (OTHER, None)


def test_a_damaged_file_of_both_saves_is_left_out(tmp_path):
    save(OLD)
    save({**OLD, "settings": ["new"]})
    damage(tmp_path / "calibration-a.txt")
    found, fault = load()
    assert found == {"settings": ["new"], "layout": OLD["layout"]}
    assert fault.startswith("calibration-a.txt is damaged")
    assert fault.endswith("the other files are used")


def test_without_any_index_the_defaults_are_used_and_this_is_reported(tmp_path):
    save(OLD)
    damage(tmp_path / "saved-a.txt")
    found, fault = load()
    assert found == {}
    assert fault.startswith("saved-a.txt is damaged")
    assert fault.endswith("the default settings are used")
    save(NEW)
    assert load() == (NEW, None)


class Full:
    """A file system that has room for a number of files."""

    def __init__(self, files):
        self.left = files

    def open(self, path, mode):
        if mode == "wb":
            if not self.left:
                raise OSError(28)
            self.left -= 1
        return open(path, mode)


@pytest.mark.parametrize("files", range(4))
def test_a_full_flash_changes_nothing_and_leaves_no_partial_files(monkeypatch, tmp_path, files):
    save(OLD)
    there = {path.name for path in tmp_path.iterdir()}
    with monkeypatch.context() as patch:
        patch.setattr(store, "open", Full(files).open, raising=False)
        with refusal(OSError, args=(errno.ENOSPC,)):
            save(NEW)
    assert load() == (OLD, None)
    assert {path.name for path in tmp_path.iterdir()} == there
    save(NEW)
    assert load() == (NEW, None)


def test_a_file_that_reads_back_differently_is_an_error(monkeypatch):
    save(OLD)
    written = store._write

    def forgetful(path, lines, crc):
        written(path, lines[1:], crc)

    monkeypatch.setattr(store, "_write", forgetful)
    with refusal(OSError, args=(errno.EIO,)):
        save(NEW)
    assert load() == (OLD, None)
