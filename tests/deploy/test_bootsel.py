"""Copies images to stand-ins for the drive of a boot loader."""

import errno
import tempfile
from types import SimpleNamespace

import psutil
import pytest
from support import runtimes

from spots.cli import main
from spots.deploy import boot_drive, bootsel, place
from spots_sim.demo import virtual

ABOUT = "UF2 Bootloader v3.0\nModel: Raspberry Pi RP2\nBoard-ID: {}\n"


@pytest.fixture
def mount(tmp_path, monkeypatch):
    """Return a function that mounts the drive of a boot loader; the system then lists it."""
    there = []
    monkeypatch.setattr(psutil, "disk_partitions", lambda: there)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr("spots.deploy.drive._is_removable", lambda mounted: True)
    monkeypatch.setattr("spots.link.serial_link.usb_ports", list)

    def mounted(board_id="RPI-RP2", name="RPI-RP2"):
        folder = tmp_path / name
        folder.mkdir()
        (folder / boot_drive.ABOUT).write_text(ABOUT.format(board_id))
        there.append(SimpleNamespace(device="/dev/x", mountpoint=str(folder), fstype="vfat"))
        return folder

    return mounted


@pytest.fixture
def runtime(tmp_path):
    path = tmp_path / "RPI_PICO.uf2"
    path.write_bytes(runtimes.micropython(*runtimes.PICO))
    return path


@pytest.fixture
def answers(monkeypatch):
    """Let a virtual board appear on USB after the copy."""
    start, end = virtual.start_simulator("default", "demo", 0)
    boards = iter([[["/dev/other"]]])
    monkeypatch.setattr(
        bootsel, "usb_boards", lambda: next(boards, [["/dev/other"], [start["port"]]])
    )
    yield
    end()


@pytest.mark.board
@pytest.mark.usefixtures("answers")
def test_flash_copies_the_image_and_waits_for_hello(mount, runtime, capsys, tmp_path):
    folder = mount()
    words = ["pico", "--runtime", str(runtime), "--layout", "mini", "--led", "gpio"]
    assert main(["flash", *words, "--yes"]) == 0
    assert capsys.readouterr().out.startswith("virtual, firmware ")
    copied = (folder / "spots.uf2").read_bytes()
    assert main(["image", *words, "--out", str(tmp_path / "x.uf2")]) == 0
    assert copied == (tmp_path / "x.uf2").read_bytes()


@pytest.mark.board
def test_a_drive_that_stays_after_the_copy_has_not_started_the_image(
    mount, runtime, monkeypatch, capsys
):
    monkeypatch.setattr(place, "_RETURN_S", 0.0)
    monkeypatch.setattr(bootsel, "usb_boards", list)
    folder = mount()
    said = refused(capsys, "pico", "--runtime", str(runtime), "--yes")
    assert f"drive {folder} is still there: unplug the board" in said
    assert (folder / "spots.uf2").exists()


def refused(capsys, *words):
    assert main(["flash", *words]) == 2
    return capsys.readouterr().err


def test_without_a_runtime_flash_says_what_a_boot_loader_needs(mount, capsys):
    folder = mount()
    said = refused(capsys, "pico")
    assert str(folder) in said
    assert "--runtime FILE.uf2" in said


@pytest.mark.board
@pytest.mark.parametrize(
    ("board", "drives", "more", "why"),
    [
        ("pico", [], [], "hold BOOTSEL while you plug the board in"),
        ("pico", ["RPI-RP2", "RPI-RP2"], [], "name one with --port"),
        ("pico", ["RP2350"], [], "belongs to another chip than pico has"),
        ("pico", ["SAMD51"], [], "hold BOOTSEL"),
        ("pico", [], ["--port", "."], "is not the drive of a boot loader"),
        ("xiao_esp32s3", ["RPI-RP2"], [], "'spots image' writes a file"),
        ("virtual", ["RPI-RP2"], [], "there is no image for virtual"),
    ],
)
def test_flash_refuses(mount, runtime, capsys, board, drives, more, why):
    folders = [mount(board_id, f"drive{n}") for n, board_id in enumerate(drives)]
    said = refused(capsys, board, "--runtime", str(runtime), "--yes", *more)
    assert why in said
    assert not any((folder / "spots.uf2").exists() for folder in folders)


@pytest.mark.board
def test_nothing_is_copied_without_a_confirmation(mount, runtime, capsys):
    folder = mount()
    assert "add --yes" in refused(capsys, "pico", "--runtime", str(runtime))
    assert not (folder / "spots.uf2").exists()


class Failing:
    """A file on a drive that goes away after a number of bytes."""

    def __init__(self, left):
        self.left = left
        self.there = tempfile.TemporaryFile()

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.there.close()
        if self.left <= 0:
            raise OSError(errno.EIO, "Input/output error")

    def write(self, view):
        if self.left <= 0:
            raise OSError(errno.EIO, "Input/output error")
        done = min(1000, len(view), self.left)
        self.left -= done
        return done

    def fileno(self):
        if self.left <= 0:
            raise OSError(errno.EIO, "Input/output error")
        return self.there.fileno()


def test_a_drive_that_goes_away_with_the_last_block_is_a_success(mount, runtime, monkeypatch):
    data = bytes(100_000)
    monkeypatch.setattr(bootsel, "open", lambda *_, **__: Failing(len(data)), raising=False)
    bootsel._copy(data, mount())


@pytest.mark.board
def test_a_drive_that_goes_away_before_is_an_error(mount, runtime, monkeypatch, capsys):
    monkeypatch.setattr(bootsel, "open", lambda *_, **__: Failing(5000), raising=False)
    mount()
    said = refused(capsys, "pico", "--runtime", str(runtime), "--yes")
    assert "stopped (Input/output error): hold BOOTSEL" in said
