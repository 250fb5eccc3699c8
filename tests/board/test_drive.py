"""Flashes the drive of a virtual CircuitPython board, and erases it."""

import errno
import os
import shutil
from types import SimpleNamespace

import psutil
import pytest
from support.boards import refused

from spots.cli import main
from spots.deploy import drive, nofollow, place
from spots.deploy.build import files_of
from spots.deploy.staging import device_of
from spots.link import serial_link as link
from spots_sim.demo import virtual

ABOUT = "Adafruit CircuitPython {} on 2026-01-01; Some board\nBoard ID:{}\nUID:0123AB\n"
RIGHT = "9.2.1", "adafruit_qtpy_rp2040"

pytestmark = pytest.mark.usefixtures("shared_builds")


@pytest.fixture
def mount(tmp_path, monkeypatch):
    """Return a function that creates a folder like a mounted CircuitPython drive.

    It returns the folder. The system then lists this folder as a mounted drive.
    """
    there = []
    monkeypatch.setattr(drive, "_BLOCK_DEVICES", tmp_path / "block")
    monkeypatch.setattr(psutil, "disk_partitions", lambda: there)
    monkeypatch.setattr(link, "usb_ports", list)
    monkeypatch.setattr("sys.platform", "linux")

    def mounted(version, board_id, name="CIRCUITPY", fstype="vfat", removable="1\n"):
        folder = tmp_path / "media" / name
        folder.mkdir(parents=True)
        (folder / "boot_out.txt").write_text(ABOUT.format(version, board_id))
        disk = tmp_path / "devices" / name
        (disk / f"{name}1").mkdir(parents=True)
        (disk / "removable").write_text(removable)
        (tmp_path / "block").mkdir(exist_ok=True)
        (tmp_path / "block" / f"{name}1").symlink_to(disk / f"{name}1")
        there.append(
            SimpleNamespace(
                device=f"/dev/{name}1", mountpoint=str(folder), fstype=fstype, opts="rw"
            )
        )
        return folder

    return mounted


@pytest.mark.board
def test_onto_a_blank_board_which_then_says_hello_and_off_it_again(tmp_path, built, capsys):
    folder = tmp_path / "board"
    folder.mkdir()
    (folder / "notes.py").write_text("the user's own")
    wanted = files_of(built("virtual_circuitpython"))
    with (
        virtual.virtual_board(folder, device_of("virtual_circuitpython")) as there,
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setattr(place, "_on_drive", lambda name: there)
        flash = ["flash", "virtual_circuitpython", "--port", str(folder)]
        assert main(flash) == 0
        said = capsys.readouterr().out
        assert f"{len(wanted)} files copied" in said
        assert said.splitlines()[-1].startswith("virtual_circuitpython, firmware ")
        (folder / "settings.txt").write_text("mine\n")
        assert main(flash) == 0
        assert "nothing to copy" in capsys.readouterr().out
        about = {"boot_out.txt": (folder / "boot_out.txt").read_bytes()}
        own = {"settings.txt": b"mine\n", "notes.py": b"the user's own"}
        assert files_of(folder) == wanted | own | about
        assert main(["erase", "virtual_circuitpython", "--port", str(folder), "--yes"]) == 0
        assert set(files_of(folder)) == {"notes.py", "boot_out.txt"}
        assert not (folder / "lib").exists()


def test_a_virtual_drive_is_awaited_until_it_describes_its_board(tmp_path, monkeypatch):
    about = tmp_path / "boot_out.txt"
    about.write_text("")  # as a slow machine leaves it for a moment
    start = {"port": "/dev/a", "console": "/dev/b"}
    monkeypatch.setattr(virtual, "start_simulator", lambda *arguments: (start, lambda: None))
    monkeypatch.setattr(virtual.time, "sleep", lambda s: about.write_text(ABOUT.format(*RIGHT)))
    with virtual.virtual_board(tmp_path, device_of("virtual_circuitpython")) as there:
        assert there.open().facts["version"] == (9, 2, 1)


@pytest.mark.parametrize("odd", [{"fstype": "ext4"}, {"removable": "0\n"}, {"fstype": "tmpfs"}])
def test_what_does_not_look_like_a_boards_drive_is_used_only_by_name(mount, capsys, odd):
    folder = mount(*RIGHT, **odd)
    assert "no CIRCUITPY drive found" in refused(capsys, "flash", "qtpy_rp2040")
    assert main(["flash", "qtpy_rp2040", "--port", str(folder), "--dry-run"]) == 0


def test_the_libraries_come_first_and_the_entry_last(mount, capsys):
    folder = mount(*RIGHT)
    (folder / "lib").mkdir()
    (folder / "lib" / "adafruit_register").mkdir()
    (folder / "lib" / "adafruit_register" / "i2c_bit.py").write_text("of another version")
    (folder / "lib" / "adafruit_register" / "i2c_bit.py.part").write_text("half")
    (folder / "lib" / "adafruit_as7341.mpy").write_text("the user's own; sources win")
    (folder / "lib" / "neopixel.py").write_text("the user's own")
    (folder / "code.py").write_text("print('hello')")
    before = files_of(folder)
    assert main(["flash", "qtpy_rp2040", "--dry-run"]) == 0
    steps = [line.split()[:2] for line in capsys.readouterr().out.splitlines()[:-1]]
    assert files_of(folder) == before
    removed = [path for step, path in steps if step == "remove"]
    assert removed == ["lib/adafruit_register/i2c_bit.py.part"]
    renamed = [path for step, path in steps if step == "rename"]
    assert renamed == ["code.py", "lib/adafruit_register/i2c_bit.py"]
    copied = [path for step, path in steps if step == "copy"]
    libraries = [path for path in copied if path.startswith("lib/")]
    assert "lib/adafruit_as7341.py" in libraries
    assert copied[: len(libraries)] == libraries
    assert copied[-1] == "code.py"


def test_a_drive_without_a_console_is_written_and_the_user_told_to_press_reset(
    mount, capsys, monkeypatch, built
):
    monkeypatch.setattr("spots.deploy.place._RETURN_S", 0)
    folder = mount(*RIGHT)
    assert "does not answer after the restart" in refused_after_copying(capsys)
    files = files_of(folder)
    assert files.pop("boot_out.txt")
    assert files == files_of(built("qtpy_rp2040"))


def refused_after_copying(capsys):
    assert main(["flash", "qtpy_rp2040"]) == 2
    said = capsys.readouterr()
    assert "press the board's reset button" in said.out
    return said.err


@pytest.mark.parametrize(
    ("about", "sentence"),
    [
        (
            ("9.2.1", "raspberry_pi_pico"),
            "has board ID raspberry_pi_pico, but qtpy_rp2040 has adafruit_qtpy",
        ),
        (("9.0.5", "adafruit_qtpy_rp2040"), "9.0.5: install CircuitPython 9.1 or newer"),
    ],
)
def test_a_board_that_will_not_do(mount, capsys, about, sentence):
    folder = mount(*about)
    assert sentence in refused(capsys, "flash", "qtpy_rp2040")
    assert set(files_of(folder)) == {"boot_out.txt"}


def test_zero_or_two_drives_or_a_folder_are_refused(mount, capsys, tmp_path):
    assert "no CIRCUITPY drive found" in refused(capsys, "flash", "qtpy_rp2040")
    assert "is not a CircuitPython drive" in refused(
        capsys, "flash", "qtpy_rp2040", "--port", str(tmp_path)
    )
    mount(*RIGHT)
    mount(*RIGHT, name="CIRCUITPY1")
    line = refused(capsys, "flash", "qtpy_rp2040")
    assert "name one with --port" in line
    assert line.count("/media/CIRCUITPY") == 2


def test_what_another_user_has_mounted_is_not_looked_into(mount, capsys, monkeypatch):
    mount(*RIGHT, name="alice")
    folder = mount(*RIGHT)
    lstat = os.lstat

    def guarded(path, **options):
        if "alice" in str(path):
            raise PermissionError(errno.EACCES, "Permission denied", path)
        return lstat(path, **options)

    monkeypatch.setattr(os, "lstat", guarded)
    assert drive.drives() == [str(folder)]


@pytest.mark.parametrize(
    ("name", "command"),
    [
        ("lstat", ("flash",)),
        ("lstat", ("flash", "--dry-run")),
        ("lstat", ("erase", "--yes")),
        ("open", ("flash",)),
        ("open", ("flash", "--dry-run")),
    ],
)
def test_a_drive_that_goes_away_while_it_is_looked_at(
    mount, capsys, monkeypatch, built, name, command
):
    folder = mount(*RIGHT)
    entry = files_of(built("qtpy_rp2040"))["code.py"]
    (folder / "code.py").write_bytes(entry)
    usual = getattr(os, name)

    def gone(path, *arguments, **options):
        if path == str(folder / "code.py"):
            raise OSError(errno.EIO, "Input/output error")
        return usual(path, *arguments, **options)

    monkeypatch.setattr(os, name, gone)
    said = refused(capsys, command[0], "qtpy_rp2040", *command[1:])
    assert "fails (Input/output error): replug the board" in said


@pytest.mark.parametrize(
    ("number", "sentence"),
    [
        (errno.ENOSPC, "is full: remove some of your files"),
        (errno.EROFS, "hold its BOOT button for two seconds"),
        (errno.EIO, "replug the board"),
    ],
)
def test_a_drive_that_fails_in_mid_copy_holds_nothing_that_starts(
    mount, capsys, monkeypatch, number, sentence
):
    folder = mount(*RIGHT)
    (folder / "code.py").write_text("print('the one before')")
    settle = nofollow.settle
    written = []

    def fail(of):
        written.append(of)
        if len(written) == 10:
            raise OSError(number, "so it is")
        settle(of)

    monkeypatch.setattr(nofollow, "settle", fail)
    assert sentence in refused(capsys, "flash", "qtpy_rp2040")
    assert len(written) == 10
    assert "code.py" not in files_of(folder)


def test_an_erase_that_fails_in_the_middle_leaves_nothing_that_starts(mount, capsys, monkeypatch):
    folder = mount(*RIGHT)
    (folder / "spots_device").mkdir()
    names = ("boot.py", "board_config.py", "code.py", "settings.txt", "spots_device/__init__.py")
    for name in names:
        (folder / name).write_text("")
    settled = []

    def fail(of):
        settled.append(of)
        if len(settled) == 2:
            raise OSError(errno.EIO, "so it is")

    monkeypatch.setattr(nofollow, "settle", fail)
    assert "replug the board" in refused(capsys, "erase", "qtpy_rp2040", "--yes")
    assert "code.py" not in files_of(folder)
    assert "settings.txt" in files_of(folder)


def test_too_little_room_is_seen_before_anything_is_touched(mount, capsys, monkeypatch):
    folder = mount(*RIGHT)
    (folder / "code.py").write_text("print('the one before')")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=1000))
    assert "1000 bytes free" in refused(capsys, "flash", "qtpy_rp2040")
    assert set(files_of(folder)) == {"boot_out.txt", "code.py"}


def test_the_ports_of_a_drive_are_its_boards_with_the_one_for_data_first(mount, monkeypatch):
    folder = mount(*RIGHT)
    usb = [("/dev/a", "0123ab"), ("/dev/b", "0123ab"), ("/dev/c", "77"), ("/dev/d", None)]
    ports = [SimpleNamespace(device=name, serial_number=uid) for name, uid in usb]
    monkeypatch.setattr(link, "usb_ports", lambda: ports)
    with place.place(device_of("qtpy_rp2040"), None) as there:
        assert there.name == str(folder)
        assert there.ports() == ["/dev/b", "/dev/a"]


def test_a_drive_with_the_serial_number_of_two_devices_is_refused_before_the_copy(mount, capsys):
    folder = mount(*RIGHT)
    before = files_of(folder)
    sockets = [("/dev/a", "1-1:1.0"), ("/dev/b", "1-1:1.2"), ("/dev/c", "1-2:1.0")]
    ports = [SimpleNamespace(device=a, location=at, serial_number="0123AB") for a, at in sockets]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(link, "usb_ports", lambda: ports)
        assert "unplug the other one" in refused(capsys, "flash", "qtpy_rp2040")
        assert files_of(folder) == before
        del ports[-1]
        with place.place(device_of("qtpy_rp2040"), None) as there:
            assert there.ports() == ["/dev/b", "/dev/a"]


def test_a_users_files_on_a_drive_are_kept(mount, monkeypatch, built, capsys):
    monkeypatch.setattr("spots.deploy.place._RETURN_S", 0)
    folder = mount(*RIGHT)
    own = ("code.py", "boot.py", "lib/adafruit_register/i2c_bit.py")
    (folder / "lib" / "adafruit_register").mkdir(parents=True)
    for path in own:
        (folder / path).write_text("the user's own")
    assert "does not answer after the restart" in refused_after_copying(capsys)
    files = files_of(folder)
    assert files.pop("boot_out.txt")
    kept = {f"{path}.before-spots": b"the user's own" for path in own}
    assert files == files_of(built("qtpy_rp2040")) | kept
