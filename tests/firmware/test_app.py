"""The firmware's application: commands, lack of memory, failed transfers, and a lost sensor."""

import json
from pathlib import Path

import pytest
from bench import canned

from spots_device.board import app
from spots_device.board import store as store_module
from spots_device.board.settings import LIMITS, checksum
from spots_device.board.start import blink
from spots_device.board.store import Store
from spots_device.keys import layout as layout_module
from spots_device.keys.layout import default_lines
from spots_device.reading import strip as strip_module
from spots_device.reading.calibration import Calibration
from spots_device.reading.decode import DARK_SAMPLES
from spots_device.reading.frame import TEXT_MAX
from spots_device.sensor.as7341 import AS7341
from spots_device.sensor.search import Search

LINES = canned.CALIBRATION


class Usb:
    def __init__(self, fault=None):
        self.fault = fault

    def open(self, names):
        if self.fault:
            raise OSError(self.fault)
        return dict.fromkeys(names, lambda report: True)


class Host(canned.Serial):
    """Substitute for a serial port, through which a test sends lines and reads the replies."""

    def __init__(self):
        super().__init__()
        self.sent = b""

    def read(self):
        if not self.sent:
            return -1
        byte, self.sent = self.sent[0], self.sent[1:]
        return byte


class Board:
    """The firmware's application with a substitute for the sensor's bus, and a `Host`."""

    def __init__(self, settings=(), usb=None, calibration=()):
        self.host = Host()
        self.replies = []
        self.board, self.bus, self.clock, _ = canned.app(calibration, self.host, usb)
        self.app = self.board.strips[0]
        self.app.replies.send = self.replies.append
        for word in settings:
            self.command("set " + word)

    def command(self, line):
        """Send a command line; return the first reply, or None without a reply."""
        del self.replies[:]
        self.host.sent = line.encode() + b"\n"
        while self.host.sent:
            self.board.step()
        return self.replies[0] if self.replies else None

    def lose(self):
        """Unplug the sensor, and run the board until it detects this fault."""
        self._registers = self.bus.read_into
        self.bus.read_into = self._refuse
        while not self.app.reconnect.fault:
            self.board.step()

    def find(self):
        """Plug the sensor in again, and run the board until it has a sample."""
        self.bus.read_into = self._registers
        while self.app.reconnect.fault:
            self.board.step()

    def _refuse(self, address, register, buffer):
        raise OSError(5)


@pytest.fixture(autouse=True)
def store(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


class FailingBus(canned.Bus):
    """A `canned.Bus` on which one transfer fails.

    Parameters
    ----------
    clock : canned.Clock
        Clock of the board.
    transfers : int
        Number of transfers before the failure. It counts down; 0 or less after the failure.
    """

    def __init__(self, clock, transfers):
        super().__init__(clock)
        self.left = transfers

    def read_into(self, address, register, buffer):
        self._pass()
        super().read_into(address, register, buffer)

    def write(self, buffer):
        self._pass()
        super().write(buffer)

    def _pass(self):
        self.left -= 1
        if self.left == -1:
            raise OSError(110)


def full(*_):
    raise MemoryError


class TwoStrips(canned.BoardConfig):
    SENSORS = ({"LED_MAX_MA": 100},) * 2


@pytest.mark.parametrize("config", [canned.BoardConfig, TwoStrips])
def test_the_first_reply_to_hello_has_the_stored_calibration(config):
    """A program that asks once, as soon as the port is there, must not take null for the answer."""
    Store().save([("calibration", LINES)])
    clock, host, replies = canned.Clock(), Host(), []
    board = app.Board(config, "canned", "00", of_a_bus(clock), clock, host, None)
    board.strips[0].replies.send = replies.append
    host.sent = b"hello\n"
    board.step()
    assert replies[0]["calibration"] == checksum(LINES)


def of_a_bus(clock, bus=None):
    """Return the function that opens a sensor on a substitute for the bus."""
    return lambda *_: AS7341(bus or canned.Bus(clock), clock)


@pytest.mark.parametrize("config", [canned.BoardConfig, TwoStrips])
def test_every_board_answers_for_its_first_sensor_by_number(config):
    clock = canned.Clock()
    board = app.Board(config, "canned", "00", of_a_bus(clock), clock, Host(), None)
    handle = board._commands.handle  # the port takes no part
    several = board.sensors > 1
    assert handle("get sensor=0") == handle("get")
    assert ("sensor" in handle("get")) == several
    refused = handle(f"get sensor={board.sensors}")
    assert refused["why"] == "no_sensor"
    assert refused["error"] == "sensor must be " + ("0 or 1" if several else "0")


@pytest.mark.board
def test_a_board_starts_whichever_transfer_fails_first():
    lost = []
    for transfers in range(60):
        clock, host = canned.Clock(), Host()
        bus = FailingBus(clock, transfers)
        board = app.Board(
            canned.BoardConfig, "canned", "00", of_a_bus(clock, bus), clock, host, None
        )
        (strip,) = board.strips
        strip.strip.stream_touch = True
        board.step()
        lost.append(strip.strip.conditions is None)
        while host.frames < 3 and clock.now < 5_000_000:
            board.step()
        assert host.frames >= 3, transfers
    # Some failures were during the first start, the last one after it.
    assert any(lost)
    assert not lost[-1]


def test_a_sensor_that_returns_without_memory_for_keys_does_not_end_the_loop(monkeypatch):
    board = Board(["keys=1"], calibration=LINES)
    board.app.use_layout(default_lines())
    board.lose()
    board.app.outputs._layout = None
    monkeypatch.setattr(layout_module, "parse", full)
    board.find()
    assert "no memory is left for keys" in board.app.apply_calibration()["note"]
    assert any("no memory is left for keys" in fault for fault in board.command("hello")["boot"])


def test_memory_that_ran_out_once_is_not_reported_for_ever(monkeypatch):
    board = Board(calibration=LINES)
    with monkeypatch.context() as patch:
        patch.setattr(layout_module, "parse", full)
        reply = board.command("set keys=1")
        assert "no memory is left for keys" in reply["note"]
        assert reply["why"] == "needs_reboot"
    assert "no memory" not in board.command("set keys=1")["note"]


def test_a_fault_of_usb_is_reported_only_to_who_wants_it():
    Store().save([("settings", ["keys=1"])])
    board = Board(usb=Usb("this board has no USB today"), calibration=LINES)
    reply = board.command("set keys=1")
    assert "no USB today" in reply["note"]
    assert "why" not in reply  # no reboot mends it
    assert "note" not in board.command("set keys=0")


def test_a_search_without_memory_leaves_room_for_the_next_one(monkeypatch):
    board = Board()
    with monkeypatch.context() as patch:
        patch.setattr(Search, "__init__", full)
        assert "no memory is left" in board.command("autoexpose")["error"]
    assert board.command("dark") is None  # the reply comes after the dark frame
    while not board.replies:
        board.board.step()
    assert board.replies[0]["re"] == "dark"


def test_before_the_sensor_has_started_a_note_says_so():
    board = Board(calibration=LINES)
    board.app.reconnect.lost, board.app.reconnect.fault = True, None
    note = board.app.apply_calibration()["note"]
    assert "None" not in note
    assert note == "the calibration is not in use until the sensor answers"


def test_without_a_computer_the_led_shows_what_the_strip_waits_for():
    board = Board(calibration=[])
    shown = []
    board.board.signal = shown.append
    board.lose()
    while len(shown) < 4:
        board.board.step()
    assert shown[-4:] in ([0, 2, 0, 2], [2, 0, 2, 0])  # blinks
    board.find()
    assert shown[-1] == 2  # lit: a calibration is missing
    board = Board(calibration=LINES)
    shown = []
    board.board.signal = shown.append
    board.lose()
    board.find()
    assert shown[-1] == 0
    board.command("cal clear")
    assert shown[-1] == 2


def test_a_note_says_why_the_sensor_is_lost():
    board = Board(calibration=LINES)
    board.lose()
    assert "until the sensor answers: the I2C bus failed" in board.app.apply_calibration()["note"]


def test_a_calibration_is_parsed_once_however_often_the_sensor_returns(monkeypatch):
    board = Board(["keys=1"], calibration=LINES)
    parsed = []
    init = Calibration.__init__

    def counted(self, *arguments):
        parsed.append(arguments)
        init(self, *arguments)

    board.command("hello")
    monkeypatch.setattr(Calibration, "__init__", counted)
    for _ in range(3):
        board.lose()
        board.find()
        assert board.command("hello")["calibration"] == checksum(LINES)
    assert parsed == []


def test_a_strain_is_part_of_what_was_parsed(monkeypatch):
    lines = [*LINES, "strain 100000", "from 0", "x 0 0 5 300", "x 80000 8800 5 400"]
    board = Board(calibration=lines)
    lengths_um = [board.command("hello")["length_um"]]
    board.command("set strain_ppm=100000")
    lengths_um.append(board.command("hello")["length_um"])
    assert lengths_um == [8000, 8800]


def test_a_reply_without_memory_does_not_end_the_loop(monkeypatch):
    board = Board()
    del board.app.replies.send
    board.app.strip.stream_touch = board.app.strip.stream_spectrum = False
    frames = board.host.frames
    dumps = json.dumps

    def scarce(reply):
        return full() if len(reply) > 3 else dumps(reply)

    with monkeypatch.context() as patch:
        patch.setattr(json, "dumps", scarce)
        board.command("get")
    assert board.host.frames > frames  # the board replies in spite of the lack of memory
    assert b"no memory" in bytes(board.host.last[: board.host.size])


@pytest.mark.parametrize("length", [254, 255, 256, 257, 510, 511, 512, 766])
def test_a_line_is_executed_whole_or_refused_whole(length):
    board = Board()
    average = 7 if length <= 255 else 1
    board.command("set average=7".rjust(length, "x").replace("x", " "))
    assert board.app.settings.values["average"] == average
    assert len(board.replies) == 1
    assert ("at most 255" in board.replies[0].get("error", "")) == (length > 255)
    assert board.command("get")["average"] == average


def with_longest_settings(app):
    app.settings.values.update({name: limits[1] for name, limits in LIMITS.items()})
    app.settings.values["channels"] = ("CLEAR", "DARK", "NIR", "F1", "F2", "F3")
    app.settings.values["led"] = "always"
    return app


def test_the_longest_reply_fits_a_frame():
    app = with_longest_settings(Board(calibration=LINES).app)
    app.outputs.layout_lines = default_lines()
    app.board.store.fault = "é" * 30
    app.unused = ['"' * 30, "\\" * 20, "\n" * 134]
    app.board.interfaces.fault = "this board has no room"
    reply = app.identity()
    assert sum(map(len, reply["boot"])) == 224
    assert reply["boot"][-1] == "this board"
    reply.update(re="hello", protocol=10, firmware="10.10.10", sensor=1, sensors=2)
    reply.update(board="virtual_circuitpython", runtime="circuitpython 10.10.10", id="f" * 34)
    reply.update(length_um=1_000_000, decay=1 << 28, relative_force=False)
    reply.update(presser="no_finger", cross=[-1 << 18, -1 << 18, 1 << 28])
    assert TEXT_MAX - 50 < len(json.dumps(reply)) <= TEXT_MAX


def test_the_longest_reply_to_get_fits_a_frame():
    app = with_longest_settings(Board().app)
    reply = app.state()
    reply["dark"] = reply["baseline"] = [DARK_SAMPLES * 65_535] * 6
    for name in ("missed", "retries", "dropped", "dropped_reports", "faults"):
        reply[name] = 1 << 30
    reply["fault"] = "the AS7341 has lost its settings; check its supply and wiring"
    reply["saturation"], reply["full_scale"], reply["re"] = "digital", 65_535, "get"
    assert len(json.dumps(reply)) <= TEXT_MAX


def test_damage_that_is_found_at_the_start_is_kept_for_hello_until_a_save():
    Store().save([("settings", ["gain=7"]), ("calibration", ["nonsense"]), ("layout", ["jump"])])
    Store().save([("settings", ["gain=5"])])
    Path("settings-b.txt").write_bytes(b"gain=6\n")
    board = Board()
    boot = board.command("hello")["boot"]
    assert [text[:20] for text in boot] == [
        "settings-b.txt is da",
        "stored calibration n",
        "stored layout not us",
    ]
    assert board.command("hello")["boot"] == boot
    assert (board.replies[0]["gain"], board.replies[0]["calibration"]) == (7, None)
    board.command("save")
    assert board.command("hello")["boot"] == []
    assert Board().command("hello")["boot"] == []


def test_interfaces_that_could_not_open_at_the_start_are_reported_by_hello():
    Store().save([("settings", ["keys=1"])])
    board = Board(usb=Usb("this board has no USB today"), calibration=LINES)
    assert board.command("hello")["boot"] == ["this board has no USB today"]


def test_the_board_blinks_ten_times_with_its_led():
    shown, slept_ms = [], []
    blink(shown.append, slept_ms.append)
    assert shown == [2, 0] * 10  # bit 1 is caps lock
    assert sum(slept_ms) == 2_000


@pytest.mark.parametrize("number", [28, 30])
def test_a_save_that_fails_has_the_number_of_the_error(monkeypatch, number):
    board = Board()

    def fail(*_):
        raise OSError(number, "in words of this runtime")

    monkeypatch.setattr(store_module, "open", fail, raising=False)
    reply = board.command("save")
    assert reply["errno"] == number
    assert reply["error"] == f"the flash cannot be written: error {number}"


def test_commands_leave_most_of_their_garbage_for_a_later_collection(monkeypatch):
    # A collection takes as long as several samples.
    collections = []
    board = Board()
    monkeypatch.setattr(app.gc, "collect", lambda: collections.append(0))
    for _ in range(100):
        board.command("get")
    assert 0 < len(collections) < 30
    board.command("cal begin")
    begun = len(collections)
    board.command("cal x 1 2 3 4")
    assert len(collections) > begun  # uploaded lines must not be scattered over the heap
    begun = len(collections)
    board.app.use_calibration(LINES)
    assert len(collections) == begun + 1  # parsing produces more garbage than all these commands


def stalled(stall_us=95_000):
    """Return board, strip, clock and port after a stall; the FIFO has stored samples meanwhile."""
    board, _, clock, serial = canned.app(LINES)
    (app,) = board.strips
    while not app.sensor.steady or app.strip._rare:
        board.step()
    clock.sleep_us(stall_us)
    return board, app, clock, serial


def test_the_loop_reads_the_clock_once_for_all_samples_of_a_fifo_read():
    board, app, clock, serial = stalled()
    reads = 0
    ticks_us = clock.ticks_us

    def counted():
        nonlocal reads
        reads += 1
        return ticks_us()

    board.ticks_us = app.sensor.ticks_us = counted
    frames, complete = serial.frames, app.sensor.complete
    board.step()
    samples = (serial.frames - frames) // 2  # each with a TOUCH and a SPECTRUM frame
    assert samples >= 9
    assert reads == 3
    assert not app.sensor.waits
    assert app.sensor.complete - complete == pytest.approx(10_000 * samples, rel=0.05)


@pytest.mark.parametrize("keys", ["keys=0", "keys=1"])
def test_a_sample_is_processed_in_one_call_also_with_keys(monkeypatch, keys):
    board = Board([keys], calibration=LINES)
    app, clock = board.app, board.clock
    process, taken, calls = strip_module.process, [], []
    monkeypatch.setattr(strip_module, "process", lambda *given: calls.append(1) or process(*given))
    app.take = lambda: taken.append(app.strip.take())
    end = clock.now + 300_000
    while clock.now < end:
        board.board.step()
    assert app.outputs.active == (keys == "keys=1")
    assert len(calls) == len(taken) > 20


def test_the_loop_sends_the_usb_reports_between_the_samples_of_a_fifo_read():
    board, app, _, serial = stalled()
    frames = []
    app.outputs.pumps = True
    app.outputs.pump = lambda: frames.append(serial.frames)
    board.step()
    assert len(frames) >= 9
    assert len(set(frames)) == len(frames)


def test_the_loop_drops_the_samples_of_a_fifo_read_from_before_a_restart():
    board, app, clock, _ = stalled()
    board.step()
    taken = []

    def take():
        taken.append(app.sensor.waits)
        if len(taken) == 3:
            app.strip.start()

    app.take = take
    clock.sleep_us(95_000)
    board.step()
    assert len(taken) == 3
    assert taken[-1] > 3


def test_the_count_of_missed_samples_never_falls():
    board, app, clock, _ = stalled(300_000)
    board.step()
    missed = app.state()["missed"]
    assert missed > 0
    app.restart()
    assert app.state()["missed"] == missed
    while app.strip._rare:
        board.step()
    assert app.state()["missed"] == missed
    clock.sleep_us(300_000)
    board.step()
    assert app.state()["missed"] > missed
