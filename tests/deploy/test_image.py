"""Images: one file with runtime, firmware and layout, read by programs that are not ours."""

import base64
import json
import random
import re
import struct
import subprocess
from binascii import crc32
from pathlib import Path
from types import SimpleNamespace

import pytest
from littlefs import LittleFS, UserContext
from support import runtimes
from support.refusals import refusal

from spots import SpotsError
from spots.cli import main
from spots.deploy import uf2
from spots.deploy.build import files_of
from spots.deploy.image import image
from spots.errors import FileError
from spots.keyboard.layout import load
from spots_device.board.settings import BoardSettings
from spots_device.board.store import Store
from spots_sim.board.vm import micropython_command

READER = Path(__file__).parents[1] / "wasm" / "read_uf2.mjs"
_BLOCK = 4096


@pytest.fixture
def make(tmp_path):
    """Return a function that makes an image and returns its file."""

    def make(data, board="pico", **more):
        runtime, out = tmp_path / "runtime.uf2", tmp_path / "spots.uf2"
        runtime.write_bytes(data)
        image(board, runtime, out, **more)
        return out

    return make


def read(path):
    """Return the blocks of a UF2 file: lists of family, number, total, address and payload."""
    run = subprocess.run(["node", str(READER), str(path)], capture_output=True, check=True)
    return [[*head, base64.b64decode(payload)] for *head, payload in json.loads(run.stdout)]


def disk_of(blocks, at, size):
    """Return the flash from an offset on; every byte must be in a block."""
    flash = {address: payload for _, _, _, address, payload in blocks}
    return b"".join(flash[runtimes.FLASH + at + n] for n in range(0, size, 256))


def files_on(disk):
    context = UserContext(buffer=bytearray(disk))
    fs = LittleFS(context, block_size=_BLOCK, block_count=len(disk) // _BLOCK, mount=False)
    fs.mount()
    assert fs.fs_stat().disk_version == 0x00020001
    found = {}
    for root, _, names in fs.walk("/"):
        for name in names:
            path = f"{root}/{name}".lstrip("/")
            with fs.open(path, "rb") as file:
                found[path] = file.read()
    return found


@pytest.mark.board
@pytest.mark.parametrize(
    ("board", "geometry"), [("pico", runtimes.PICO), ("pico2", runtimes.PICO2)]
)
def test_an_image_is_the_runtime_and_the_build(make, built, board, geometry):
    at, size, family = geometry
    data = runtimes.micropython(*geometry)
    blocks = read(make(data, board))
    if family == runtimes.RP2350:  # the block of erratum RP2350-E10, as it was, before all others
        assert blocks.pop(0)[:4] == [0xE48BFF57, 0, 2, 0x10FFFF00]
    assert [block[:3] for block in blocks] == [[family, n, len(blocks)] for n in range(len(blocks))]
    code = runtimes.program(*geometry[:2])
    assert b"".join(payload for *_, payload in blocks[: len(code) // 256]) == code
    assert files_on(disk_of(blocks, at, size)) == files_of(built(board))


@pytest.mark.board
def test_the_image_does_not_depend_on_the_date(make):
    data = runtimes.micropython(*runtimes.PICO)
    assert make(data).read_bytes() == make(data).read_bytes()


MOUNT = """
import os, vfs
class Flash:
    def __init__(self, data): self.data = data
    def readblocks(self, n, buf, off=0):
        at = n * 4096 + off
        buf[:] = self.data[at:at + len(buf)]
    def writeblocks(self, n, buf, off=None):
        if off is None:
            self.ioctl(6, n)
            off = 0
        at = n * 4096 + off
        assert all(b == 255 for b in self.data[at:at + len(buf)])
        self.data[at:at + len(buf)] = buf
    def ioctl(self, op, arg):
        if op == 4: return len(self.data) // 4096
        if op == 5: return 4096
        if op == 6:
            self.data[arg * 4096:arg * 4096 + 4096] = b"\\xff" * 4096
            return 0
with open("disk.img", "rb") as file:
    flash = Flash(bytearray(file.read()))
vfs.mount(vfs.VfsLfs2(flash, progsize=PROGRAM), "/flash")
def walk(folder):
    for name, kind, *_ in os.ilistdir(folder):
        path = folder + "/" + name
        if kind == 0x4000:
            walk(path)
        else:
            with open(path, "rb") as file:
                print(path[7:], __import__("binascii").crc32(file.read()))
walk("/flash")
for n in range(60):
    with open("/flash/settings-a.txt", "w") as file: file.write("gain=%d\\n" % n)
vfs.umount("/flash")
vfs.mount(vfs.VfsLfs2(flash, progsize=PROGRAM), "/flash")
print(open("/flash/settings-a.txt").read().strip())
"""


def mounted(disk, folder, program):
    """Mount, read and write a file system in MicroPython; return the CRC-32 of each file."""
    (folder / "disk.img").write_bytes(disk)
    (folder / "mount.py").write_text(MOUNT.replace("PROGRAM", str(program)))
    run = subprocess.run(
        [*micropython_command(), "-X", "heapsize=32m", "mount.py"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert not run.stderr
    *lines, last = run.stdout.splitlines()
    assert last == "gain=59"
    return {path: int(crc) for path, crc in map(str.split, lines)}


def crcs(files):
    return {path: crc32(data) for path, data in files.items()}


@pytest.mark.board
def test_micropython_mounts_reads_and_writes_the_file_system(make, built, tmp_path):
    at, size, _ = runtimes.PICO
    disk = disk_of(read(make(runtimes.micropython(*runtimes.PICO))), at, size)
    assert mounted(disk, tmp_path, 256) == crcs(files_of(built("pico")))


@pytest.mark.board
def test_an_esp32_image_is_one_file_for_address_0(built, tmp_path):
    data = runtimes.esp32()
    (tmp_path / "runtime.bin").write_bytes(data)
    image("xiao_esp32s3", tmp_path / "runtime.bin", tmp_path / "spots.bin")
    made = (tmp_path / "spots.bin").read_bytes()
    assert made.startswith(data)
    assert len(made) == 0x800000
    assert mounted(made[0x200000:], tmp_path, 32) == crcs(files_of(built("xiao_esp32s3")))


@pytest.mark.board
def test_a_circuitpython_image_has_a_drive_with_the_build(make, built, tmp_path):
    blocks = read(make(runtimes.circuitpython(), "qtpy_rp2040"))
    disk = disk_of(blocks, 0x100000, (8 << 20) - (1 << 20))
    (tmp_path / "disk.img").write_bytes(disk)
    script = MOUNT.replace("vfs.VfsLfs2(flash, progsize=PROGRAM)", "vfs.VfsFat(flash)")
    script = script.replace("4096", "512").split("for n in range(60)")[0]
    (tmp_path / "mount.py").write_text(script)
    run = subprocess.run(
        [*micropython_command(), "-X", "heapsize=64m", "mount.py"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert not run.stderr
    found = dict(line.rsplit(" ", 1) for line in run.stdout.splitlines())
    extra = {path for path in found if path.startswith(".")}  # what keeps desktops off the drive
    wanted = crcs(files_of(built("qtpy_rp2040")))
    assert {path: int(found[path]) for path in found.keys() - extra} == wanted


@pytest.fixture
def stored(make, tmp_path, monkeypatch):
    """Return a function that makes an image and returns what its board finds stored."""

    def stored(**more):
        at, size, _ = runtimes.PICO
        out = make(runtimes.micropython(*runtimes.PICO), **more)
        for path, data in files_on(disk_of(read(out), at, size)).items():
            if path.endswith(".txt"):
                (tmp_path / path).write_bytes(data)
        monkeypatch.chdir(tmp_path)
        store = Store()
        assert store.fault is None
        return store.load

    return stored


@pytest.mark.board
def test_a_layout_makes_a_board_that_starts_as_a_keyboard(stored):
    layout = load("mini").lines
    load_part = stored(layout=layout)
    assert load_part("layout") == layout
    assert load_part("settings") == ["keys=1"]


@pytest.mark.board
def test_an_image_has_the_connection_of_each_strip_s_led(stored):
    load_part = stored(led="gpio", layout=load("mini").lines, strips=2)
    assert load_part("settings") == ["led=gpio", "keys=1"]
    assert load_part("settings1") == ["led=gpio"]
    assert load_part("layout1") == []
    settings = BoardSettings(SimpleNamespace(LED_MAX_MA=50, STRIP_LED_PIN=6))
    settings.change(load_part("settings"))
    assert (settings.values["led"], settings.values["keys"]) == ("gpio", 1)


FAMILIES = [0xE48BFF57, 0xE48BFF58, 0xE48BFF59, 0xE48BFF5A, 0, 0xADA52840]


def mutated(data, chance):
    """Return a UF2 file with one wrong field, and the field's name."""
    data = bytearray(data)
    blocks = len(data) // 512
    number = chance.randrange(blocks)
    start = 512 * number
    fields = {
        "magic": (start + chance.choice((0, 4, 508)), 4, None),
        "flags": (start + 8, 4, (0, 1, 0x2001)),
        "address": (start + 12, 4, None),
        "size": (start + 16, 4, None),
        "number": (start + 20, 4, None),
        "total": (start + 24, 4, None),
        "family": (start + 28, 4, FAMILIES),
    }
    what = chance.choice([*fields, "cut", "twice", "missing", "info"])
    if what == "cut":
        return data[: chance.randrange(len(data))], what
    if what == "twice":
        return data + data[start : start + 512], what
    if what == "missing":
        return data[:start] + data[start + 512 :], what
    if what == "info":  # the header of the binary info, in the second block
        at = 512 + 32 + runtimes.INFO_AT - 256 + chance.randrange(3) * 4
        struct.pack_into("<I", data, at, chance.getrandbits(32))
        return data, what
    at, _, values = fields[what]
    was = struct.unpack_from("<I", data, at)[0]
    value = was
    while value == was:
        value = chance.choice(values) if values else was ^ 1 << chance.randrange(32)
    struct.pack_into("<I", data, at, value)
    return data, what


@pytest.mark.board
def test_a_damaged_runtime_is_refused_and_nothing_written(tmp_path, monkeypatch):
    monkeypatch.setattr("spots.deploy.image.build", lambda *_: pytest.fail("accepted"))
    good = runtimes.micropython(*runtimes.PICO)
    runtime, out = tmp_path / "runtime.uf2", tmp_path / "spots.uf2"
    chance = random.Random(20261127)
    for _ in range(250):
        data, what = mutated(good, chance)
        runtime.write_bytes(data)
        with refusal(FileError, file="runtime.uf2") as refused:
            image("pico", runtime, out)
        assert ":" in str(refused.value), what
    assert not out.exists()


@pytest.mark.board
@pytest.mark.parametrize(
    ("board", "data"),
    [
        ("pico", runtimes.micropython(*runtimes.PICO2)),
        ("pico2", runtimes.micropython(*runtimes.PICO)),
        ("pico", runtimes.circuitpython()),
        ("qtpy_rp2040", runtimes.micropython(*runtimes.PICO)),
        ("qtpy_rp2040", runtimes.circuitpython(b"raspberry_pi_pico")),
        ("pico", runtimes.micropython(*runtimes.PICO, name=b"blink")),
        ("pico", runtimes.micropython(*runtimes.PICO, version=b"v1.22.2")),
        ("pico", runtimes.micropython(*runtimes.PICO, version=b"dirty")),
        ("pico", runtimes.micropython(*runtimes.PICO, drives=0)),
        ("pico", runtimes.micropython(*runtimes.PICO, drives=2)),
        ("pico", runtimes.micropython(0x8000, 1408 << 10, runtimes.RP2040)),  # over the program
        ("pico", runtimes.micropython(0xA0100, 1408 << 10, runtimes.RP2040)),
        ("pico", runtimes.micropython(0xA0000, 4097, runtimes.RP2040)),
        ("pico", runtimes.micropython(0xA0000, 17 << 20, runtimes.RP2040)),
        ("pico", runtimes.micropython(0xA0000, 16 << 10, runtimes.RP2040)),  # too small
        ("pico", b""),
        ("pico", b"PK\3\4"),
    ],
)
def test_a_runtime_of_another_kind_is_refused(make, tmp_path, board, data):
    with pytest.raises(SpotsError, match=r": (download|use|name)|: change"):
        make(data, board)
    assert not (tmp_path / "spots.uf2").exists()


@pytest.mark.parametrize(
    "more", [{"label": b"other"}, {"offset": 0x200001}, {"offset": 0x11000}, {"size": 4096}]
)
def test_an_esp32_runtime_of_another_kind_is_refused(tmp_path, more):
    (tmp_path / "runtime.bin").write_bytes(runtimes.esp32(**more))
    with refusal(FileError, file="runtime.bin"):
        image("xiao_esp32s3", tmp_path / "runtime.bin", tmp_path / "spots.bin")


def test_a_file_of_another_kind_is_not_replaced(make, tmp_path):
    (tmp_path / "spots.uf2").write_text("mine")
    with refusal(FileError, file="spots.uf2"):
        make(runtimes.micropython(*runtimes.PICO))
    assert (tmp_path / "spots.uf2").read_text() == "mine"


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["pico", "--out", "x.bin"], r"is a \.uf2 file: change --out"),
        (["virtual", "--out", "x.uf2"], "there is no image for virtual: name"),
        (["pico", "--out", "runtime.uf2"], "name the same file"),
        (["pico", "--out", "none/x.uf2"], "there is no folder none: make it first"),
        (["pico", "--out", "x.uf2", "--runtime", "none.uf2"], "cannot read none.uf2"),
        (["pico", "--out", "x.uf2", "--strips", "9"], "1 to 2 strips"),
        (["pico", "--out", "x.uf2", "--layout", "none"], "none"),
    ],
)
def test_the_command_refuses(words, why, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("runtime.uf2").write_bytes(runtimes.micropython(*runtimes.PICO))
    extra = [] if "--runtime" in words else ["--runtime", "runtime.uf2"]
    assert main(["image", *words, *extra]) == 2
    assert re.search(why, capsys.readouterr().err)
    assert [path.name for path in tmp_path.iterdir()] == ["runtime.uf2"]


def test_uf2_is_what_uf2_reads():
    data = runtimes.micropython(*runtimes.PICO2)
    assert uf2.write(uf2.read(data, "x")) == data
