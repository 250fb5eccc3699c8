"""Cuts the power in each operation of the flash during ``save``; prints how many saves were lost.

The file systems are those of real boards, on a flash in memory: littlefs as on a Pico, and FAT as
on CircuitPython. For each file system, number of strips and change, it prints the number of cuts
that left the old state, and the number of those that left the new one. A mixture raises an error.
"""

import gc

import uos as os

import canned
from spots_device.board.app import Board
from spots_device.board.settings import checksum
from spots_device.board.store import Store
from spots_device.keys.layout import default_lines
from spots_device.sensor.as7341 import AS7341

_COUNTS = (900, 1200, 2000, 2500, 2600, 1500)  # 0.7 of full scale: ``autoexpose`` ends at once
_PAGE = 256
_STEPS_MAX = 2_000
_EIO = 5


class Flash:
    """A flash that loses power in one of its operations; then nothing is written.

    A page that is programmed at this moment, and a block that is erased, become half of what they
    should. FAT writes whole sectors of 512 bytes, which a disk controller makes atomic.
    """

    def __init__(self, block, blocks):
        self.data = bytearray(block * blocks)
        self.block = block
        self.operations = 0
        self.cut_at = None

    def readblocks(self, number, buffer, offset=0):
        at = number * self.block + offset
        buffer[:] = memoryview(self.data)[at : at + len(buffer)]

    def writeblocks(self, number, buffer, offset=None):
        at = number * self.block
        if offset is None:
            if self._works():
                self.data[at : at + len(buffer)] = buffer
            # FAT would try again, and print an error, when it collects its open files.
            return None
        at += offset
        for first in range(0, len(buffer), _PAGE):
            page = memoryview(buffer)[first : first + _PAGE]
            if not self._works():
                page = page[: len(page) // 2] if self.operations == self.cut_at + 1 else b""
            self.data[at + first : at + first + len(page)] = page
        return -_EIO if self.is_cut() else None

    def ioctl(self, operation, number):
        if operation == 4:
            return len(self.data) // self.block
        if operation == 5:
            return self.block
        if operation == 6:
            size = self.block
            if not self._works():
                size = size // 2 if self.operations == self.cut_at + 1 else 0
            at = number * self.block
            self.data[at : at + size] = b"\xff" * size
            return -_EIO if self.is_cut() else 0

    def _works(self):
        self.operations += 1
        return not self.is_cut()

    def is_cut(self):
        return self.cut_at is not None and self.operations > self.cut_at


class Littlefs:
    def __init__(self):
        self.flash = Flash(4096, 64)
        os.VfsLfs2.mkfs(self.flash, progsize=_PAGE)
        self.mount()

    def mount(self):
        self.vfs = os.VfsLfs2(self.flash, progsize=_PAGE)
        os.mount(self.vfs, "/flash")
        os.chdir("/flash")

    def umount(self):
        os.chdir("/")
        os.umount("/flash")


class Fat(Littlefs):
    def __init__(self):
        self.flash = Flash(512, 512)
        os.VfsFat.mkfs(self.flash)
        self.mount()

    def mount(self):
        self.vfs = os.VfsFat(self.flash)
        os.mount(self.vfs, "/flash")
        os.chdir("/flash")


class Two:
    NAME = "canned"
    LED_MAX_MA = 100
    SENSORS = ({"LED_MAX_MA": 100}, {"LED_MAX_MA": 100})


def boot(strips):
    clock, serial = canned.Clock(), canned.Serial()

    def sensor(*_):
        bus = canned.Bus(clock)
        bus.counts(_COUNTS)
        return AS7341(bus, clock)

    app = Board(canned.BoardConfig if strips == 1 else Two, "canned", "00", sensor, clock, serial)
    app.step()
    return app


def send(app, strip, line):
    if strip:
        line += " sensor=%d" % strip
    reply = app._commands.handle(line)
    for _ in range(_STEPS_MAX):
        if not app.strips[strip].replies._claimed:
            break
        app.step()
    assert reply is None or "error" not in reply, (line, reply)


def upload(app, strip, command, lines):
    send(app, strip, command + " begin")
    for line in lines + ["end " + checksum(lines)]:
        send(app, 0, command + " " + line)


def settings(app, strip):
    send(app, strip, "set average=%d" % (1 + app.strips[0].settings.values["average"] % 3))


def autoexpose(app, strip):
    send(app, strip, "set gain=5")
    if not strip:
        send(app, strip, "autoexpose")


def new_layout(app, strip):
    upload(app, strip, "layout", ["slide_um 5000"] + default_lines())


def calibrate(app, strip, gain=5):
    send(app, strip, "set gain=%d" % gain)
    lines = [line.replace("made 9 ", "made %d " % gain) for line in canned.CALIBRATION]
    if strip:
        lines = [line.replace("board 00", "board 00-1") for line in lines]
    upload(app, strip, "cal", lines)


def everything(app, strip):
    settings(app, strip)
    new_layout(app, strip)
    calibrate(app, strip)


def removal(app, strip):
    send(app, strip, "cal clear")
    send(app, strip, "layout clear")


def first(app, strip):
    upload(app, strip, "layout", default_lines())
    calibrate(app, strip, 9)


def cut(system, strips, change, image):
    """Cut the power in each operation of a save; return how many left the old, and the new state.

    The last save of those that it tries is complete.
    """
    flash = system.flash
    counts = [0, 0]
    whole = False
    while not whole:
        flash.data[:] = image
        system.mount()
        app = boot(strips)
        known = app.stored()
        for strip in range(strips):
            change(app, strip)
        wanted = app.stored()
        flash.operations = 0
        flash.cut_at = sum(counts)
        try:
            app.save()
        except OSError:
            pass
        whole = not flash.is_cut()
        flash.cut_at = None
        system.umount()
        system.mount()
        app = boot(strips)
        found = app.stored()
        assert found in (known, wanted), (change, counts, found)
        counts[found == wanted] += 1
        app.strips[0].settings.change(["average=7"])  # the board can save again
        app.save()
        assert Store().load("settings") == app.strips[0].settings.lines(), (change, counts)
        app = None
        system.umount()
        gc.collect()
    assert found == wanted
    return counts


for kind in (Littlefs, Fat):
    for strips in (1, 2):
        system = kind()
        app = boot(strips)
        for change in (settings, first):  # two saves, so that there is one before the last
            for strip in range(strips):
                change(app, strip)
            app.save()
        system.umount()
        image = bytes(system.flash.data)
        changes = (
            (settings, autoexpose, new_layout, calibrate) if strips == 1 else (everything, removal)
        )
        for change in changes:
            old, new = cut(system, strips, change, image)
            print(kind.__name__, strips, change.__name__, old, new)
