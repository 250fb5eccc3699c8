"""Two strips on one board: one loop samples both, and neither waits for the other."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
from support.refusals import refusal

import spots
from spots.errors import BoardError, PortError
from spots.link.board import Board
from spots.link.connect import prepare, upload
from spots.link.frames import Touch
from spots.link.lines import of_sensor
from spots.link.stored import stored_calibration
from spots.terminal.monitor import watch
from spots_device.board.settings import checksum
from spots_device.keys.layout import action
from spots_device.reading.decode import DROPPED
from spots_device.usb.usages import KEYBOARD
from spots_sim.board import vm
from spots_sim.board.lockstep import LockstepLink
from spots_sim.chip.bus import I2CBus, MultiplexedBus
from spots_sim.chip.converter import STEP_US
from spots_sim.demo.virtual import start_simulator
from spots_sim.person.stage import calibrate, strip_lines
from spots_sim.strip.files import ScenarioFile, SensorFile, load
from spots_sim.strip.scenario import Held, Press, Scenario

pytestmark = pytest.mark.board

SENSOR = load(SensorFile, "default")
BOARDS = ["virtual", "virtual_circuitpython"]
_SETTLE_S = 1.0


def opened(board="virtual", exposure_us=10_000, **more) -> Board:
    scenario = Scenario(load(ScenarioFile, "demo"))
    link = LockstepLink(SENSOR, scenario, 1, board=board, second=(scenario, 2), **more)
    found = Board(link)
    for sensor in found.sensors:
        found.set(exposure_us=exposure_us, sensor=sensor)
    return found


class Plug:
    """I2C bus of a sensor that can be unplugged and plugged in again."""

    def __init__(self, bus):
        self._bus, self._there = bus, True
        self.chip, self.clock, self.lines, self.light = bus.chip, bus.clock, bus.lines, bus.light
        self.frequency_hz = bus.frequency_hz

    def pull(self):
        self._there = False

    def push(self):
        self.chip.power_on(self.clock.now_us())
        self._there = True

    def write(self, *transfer):
        self._ask()
        self._bus.write(*transfer)

    def write_read(self, *transfer):
        self._ask()
        return self._bus.write_read(*transfer)

    def read(self, *transfer):
        self._ask()
        return self._bus.read(*transfer)

    def _ask(self):
        if not self._there:
            self._bus.refuse()


@pytest.mark.parametrize("exposure_us", [10_000, 5_000])
@pytest.mark.parametrize("name", BOARDS)
def test_both_strips_give_every_sample_at_their_full_rate(name, exposure_us):
    with opened(name, exposure_us) as board:
        board.stream("touch")
        for _ in board.frames(_SETTLE_S):
            pass
        seconds = 3.0
        counts = Counter(touch.sensor for touch in board.touches(seconds))
        for sensor in board.sensors:
            assert counts[sensor] == pytest.approx(seconds * 1e6 / exposure_us, abs=2)
            assert board.command(f"get sensor={sensor}")["missed"] == 0
        assert board.stats.lost == board.stats.bad_crc == 0


def test_strips_of_different_exposures_do_not_wait_for_each_other():
    with opened() as board:
        board.set(exposure_us=40_000, sensor=1)
        board.stream("touch")
        for _ in board.frames(_SETTLE_S):
            pass
        before = [board.command(f"get sensor={i}")["missed"] for i in (0, 1)]
        counts = Counter(touch.sensor for touch in board.touches(4.0))
        assert counts == {0: pytest.approx(400, abs=2), 1: pytest.approx(100, abs=2)}
        assert [board.command(f"get sensor={i}")["missed"] for i in (0, 1)] == before


@pytest.mark.parametrize("name", BOARDS)
def test_an_unplugged_strip_takes_nothing_from_the_other(name):
    with opened(name) as board:
        plug = board._link.second = Plug(board._link.second)
        board.stream("touch")
        for _ in board.frames(_SETTLE_S):
            pass
        found, touches = [], board.touches()
        for _ in range(5):
            plug.pull()
            found += touches.within(0.25)
            assert board.command("get sensor=1")["fault"]
            plug.push()
            found += touches.within(0.25)
            assert board.command("get sensor=1")["fault"] is None
        one = [touch for touch in found if touch.sensor == 0]
        assert not any(touch.flags & DROPPED for touch in one)
        assert np.diff([touch.t_us for touch in one]).max() < 15_000
        state = board.command("get")
        assert (state["missed"], state["faults"], state["fault"]) == (0, 0, None)
        assert board.command("get sensor=1")["faults"] == 5
        faults = [line for line in board.log if line["log"] == "error"]
        assert [line["sensor"] for line in faults] == [1] * 5


def test_each_strip_has_its_own_settings_files_and_calibration(tmp_path):
    folder = tmp_path / "board"
    folder.mkdir()
    with opened(folder=folder) as board:
        board.set(gain=7, sensor=1)
        assert board.command("hello")["gain"] == 9
        assert board.command("hello sensor=1")["gain"] == 7
        board.command("save")
        first, second = board.command("hello"), board.command("hello sensor=1")
        assert (first["sensors"], first["sensor"], second["sensor"]) == (2, 0, 1)
        assert second["id"] == first["id"] + "-1"
    assert "gain=9" in (folder / "settings-a.txt").read_text().split()
    assert "gain=7" in (folder / "settings1-a.txt").read_text().split()


def test_a_command_for_a_strip_that_is_not_there_is_refused():
    with opened() as board:
        with refusal(BoardError, why="no_sensor"):
            board.command("get sensor=2")
        with refusal(BoardError, why="no_sensor"):
            board.command("set gain=3 sensor=x")
        assert board.command("get")["gain"] == 9
    link = LockstepLink(SENSOR, Scenario(load(ScenarioFile, "demo")))
    with Board(link) as board, refusal(BoardError, why="no_sensor"):
        board.command("get sensor=1")


def test_a_command_between_the_lines_of_an_upload_does_not_change_its_strip():
    lines = calibrate(SENSOR)
    with opened() as board:
        board.command("cal begin sensor=1")
        for line in strip_lines(lines, 1):
            board.command("cal " + line)
            board.command("sync")
        with refusal(BoardError, why="bad_calibration"):
            board.command("cal end 00000000")
        with refusal(BoardError, why="bad_calibration"):
            board.command("cal end 00000000 sensor=0")


def test_the_calibration_of_each_strip_can_be_read():
    lines = calibrate(SENSOR)
    with opened() as board:
        for number in (0, 1):
            upload(board, strip_lines(lines, number), number)
        for number in (0, 1):
            info = board.command(of_sensor("hello", number))
            board.calibration = None
            assert stored_calibration(board, info, number) == list(strip_lines(lines, number))


def test_a_board_for_one_strip_of_two_is_like_a_board_with_one_strip():
    scenario = Scenario(load(ScenarioFile, "demo"))
    link = LockstepLink(SENSOR, scenario, 1, second=(scenario, 2))
    with Board(link, 1) as board:
        assert board.info["id"].endswith("-1")
        board.set(gain=6)
        touches = list(board.touches(0.5))
        assert {touch.sensor for touch in touches} == {0}
        assert len(touches) == pytest.approx(50, abs=3)
        assert link is board._link
        assert board.command("get")["gain"] == board.info["gain"] == 6


@pytest.mark.parametrize("exposure_us", [10_000, 9_900])
def test_the_times_of_both_strips_agree(monkeypatch, exposure_us):
    """For both strips, the time of a reading is the middle of its integration."""
    with opened(exposure_us=exposure_us) as board:
        ends = true_ends(board, monkeypatch)
        board.stream("touch")
        for _ in board.frames(_SETTLE_S):
            pass
        errors = {0: [], 1: []}
        for touch in board.touches(5.0):
            if isinstance(touch, Touch):
                errors[touch.sensor].append(error_of(touch, exposure_us, ends))
    means = [float(np.mean(errors[sensor])) for sensor in (0, 1)]
    assert all(math.isfinite(mean) for mean in means)
    assert abs(means[0] - means[1]) <= 5
    assert np.abs(errors[0]).max() <= 20
    assert np.abs(errors[1]).max() <= 20


def error_of(touch, exposure_us, ends):
    """Return the error of a reading's time in us; `ends` is the result of `true_ends`."""
    end_us = touch.t_us + exposure_us // 2
    return end_us - min(ends[touch.sensor][-40:], key=lambda end: abs(end - end_us))


def true_ends(board, monkeypatch):
    """Record the ends of samples; return a list of their times in us for each of the two strips."""
    ends = [], []
    for bus, found in zip((board._link.bus, board._link.second), ends):
        complete = bus.chip._complete

        def record(end_us, found=found, complete=complete):
            found.append(end_us)
            complete(end_us)

        monkeypatch.setattr(bus.chip, "_complete", record)
    return ends


@pytest.mark.usefixtures("in_cpython")
class TestSlowBoard:
    """Two calibrated strips with a finger on each, on a board as slow as a Pico."""

    # Exposure in us and busy share, as on the emulated Pico; None where it was not measured.
    MEASURED = [
        ("pico", {10_000: None, 5_000: None}),
        ("pico-xip50", {10_000: None, 5_000: None}),
    ]

    @pytest.fixture
    def make(self):
        boards = []

        def make(cpu):
            fingers = Held(), Held()
            link = LockstepLink(SENSOR, fingers[0], 1, cpu=cpu, second=(fingers[1], 2))
            board = Board(link)
            boards.append(board)
            lines = calibrate(SENSOR)
            for sensor in board.sensors:
                prepare(board, strip_lines(lines, sensor), sensor)
            for finger in fingers:
                finger.press = Press(20.0, 3000, 4.0)
            return board

        yield make
        for board in boards:
            board.close()

    def wait(self, board, seconds):
        for _ in board.frames(seconds):
            pass

    @pytest.mark.parametrize(("cpu", "exposures"), MEASURED)
    def test_both_strips_give_every_sample(self, make, cpu, exposures):
        board = make(cpu)
        clock = board._link.clock
        board.stream("touch")
        for exposure_us, busy in exposures.items():
            for sensor in board.sensors:
                board.set(exposure_us=exposure_us, sensor=sensor)
            self.wait(board, 1.0)
            began_us, idle_us = clock.now_us(), clock.idle_us
            touches = list(board.touches(2.0))
            elapsed_us = clock.now_us() - began_us
            counts = Counter(touch.sensor for touch in touches)
            for sensor in board.sensors:
                assert counts[sensor] == pytest.approx(2e6 / exposure_us, abs=3)
            assert all(touch.trusted for touch in touches)
            assert not any(touch.flags & DROPPED for touch in touches)
            if busy:
                share = 1 - (clock.idle_us - idle_us) / elapsed_us
                assert share == pytest.approx(busy, rel=0.1)
        assert board.stats.lost == board.stats.bad_crc == 0

    # With equal oscillators, the samples of both strips may end together for the whole test.
    @pytest.mark.parametrize("oscillators_percent", [(0.0, 0.0), (2.0, -2.0)])
    @pytest.mark.parametrize("stall_us", [0, 50_000])
    @pytest.mark.parametrize("exposures_us", [(10_000, 10_000), (5_000, 5_000), (10_000, 5_000)])
    def test_the_times_of_both_strips_are_within_20_us_from_a_second_on(
        self, make, monkeypatch, exposures_us, stall_us, oscillators_percent
    ):
        board = make("pico")
        link = board._link
        for bus, percent in zip((link.bus, link.second), oscillators_percent):
            bus.chip._step_us = STEP_US * (1 + percent / 100)
        ends = true_ends(board, monkeypatch)
        board.stream("touch")
        for sensor, exposure_us in enumerate(exposures_us):
            board.set(exposure_us=exposure_us, sensor=sensor)
        self.wait(board, 1.0)
        errors = {0: [], 1: []}
        for _ in range(3):
            link.clock.spend_us(stall_us)
            for touch in board.touches(0.7):
                error_us = error_of(touch, exposures_us[touch.sensor], ends)
                errors[touch.sensor].append(error_us)
        for found in errors.values():
            assert abs(np.mean(found)) <= 5
            assert np.std(found) <= 5
            assert np.abs(found).max() <= 20

    @pytest.mark.parametrize("exposure_us", [10_000, 5_000])
    def test_the_times_of_both_strips_are_known_again_after_a_stall(
        self, make, monkeypatch, exposure_us
    ):
        board = make("pico")
        ends = true_ends(board, monkeypatch)
        board.stream("touch")
        for sensor in board.sensors:
            board.set(exposure_us=exposure_us, sensor=sensor)
        self.wait(board, 0.5)
        board._link.clock.spend_us(400_000)  # the FIFOs overrun
        self.wait(board, 0.8)
        for touch in board.touches(1.0):
            assert abs(error_of(touch, exposure_us, ends)) <= 20


def test_a_port_with_the_number_of_a_strip_is_that_strip():
    start, end = start_simulator("default", "demo", 0, strips=2)
    try:
        with spots.open(start["port"] + "#1") as board:
            assert board.info["id"].endswith("-1")
            assert {touch.sensor for touch in board.touches(0.3)} == {0}
        with spots.open(start["port"]) as board:
            assert {touch.sensor for touch in board.touches(0.3)} == {0, 1}
        with refusal(PortError):
            spots.open(start["port"] + "#2")
    finally:
        end()


def test_the_terminal_prints_the_readings_of_both_strips(capsys):
    with opened() as board:
        watch(board, 1.0, quiet=False)
    lines = capsys.readouterr().out.splitlines()
    shown = Counter(line[:7] for line in lines)
    assert shown.keys() == {"strip 0", "strip 1"}
    assert min(shown.values()) >= 3


PINS = {
    "virtual": {"I2C_ID": 0, "SCL_PIN": 1, "SDA_PIN": 0},
    "virtual_circuitpython": {"SCL_PIN": "SCL", "SDA_PIN": "SDA"},
}


@pytest.fixture(params=BOARDS)
def multiplexed(request, monkeypatch, own_firmware):
    """A board with two strips on one I2C bus, behind a multiplexer."""
    known = vm.device_of

    def device_of(board, strips=1):
        device = known(board, strips)
        for channel, sensor in enumerate(device.device["SENSORS"] if strips > 1 else ()):
            sensor |= PINS[request.param] | {"MUX_CHANNEL": channel}
        return device

    monkeypatch.setattr(vm, "device_of", device_of)
    scenario = Scenario(load(ScenarioFile, "demo"))
    link = LockstepLink(SENSOR, scenario, 1, board=request.param, second=(scenario, 2))
    link.bus = MultiplexedBus((link.bus.chip, link.second.chip), link.clock)
    link.second = I2CBus(None, link.clock)
    with Board(link) as board:
        yield board


def test_two_strips_behind_a_multiplexer_share_one_bus(multiplexed):
    board = multiplexed
    board.set(gain=7, sensor=1)
    board.stream("touch")
    for _ in board.frames(_SETTLE_S):
        pass
    counts = Counter(touch.sensor for touch in board.touches(2.0))
    assert counts == {0: pytest.approx(200, abs=2), 1: pytest.approx(200, abs=2)}
    states = [board.command(f"get sensor={sensor}") for sensor in board.sensors]
    assert [state["missed"] for state in states] == [0, 0]
    assert [state["gain"] for state in states] == [9, 7]
    chips = board._link.bus._chips
    assert [chip._main[0xAA] for chip in chips] == [9, 7]


def test_both_strips_continue_after_the_multiplexer_lost_its_supply(multiplexed):
    board = multiplexed
    board.stream("touch")
    for _ in board.frames(_SETTLE_S):
        pass
    bus = board._link.bus
    chips = bus._chips
    bus._chips = (None,) * len(chips)
    refuse, bus._address = bus._address, lambda address: bus.refuse()
    write, bus.write = bus.write, lambda address, data: bus.refuse()
    for _ in board.frames(0.5):
        pass
    assert all(board.command(f"get sensor={sensor}")["fault"] for sensor in board.sensors)
    bus._chips, bus._address, bus.write = chips, refuse, write
    for _ in board.frames(1.0):
        pass
    assert not any(board.command(f"get sensor={sensor}")["fault"] for sensor in board.sensors)
    counts = Counter(touch.sensor for touch in board.touches(1.0))
    assert counts == {0: pytest.approx(100, abs=2), 1: pytest.approx(100, abs=2)}


class TestKeyboard:
    """Both strips of a board type on one USB keyboard."""

    @pytest.fixture(params=BOARDS)
    def start(self, request, tmp_path):
        def start():
            self.fingers = [Held(), Held()]
            first, second = self.fingers
            link = LockstepLink(
                SENSOR, first, 1, folder=tmp_path, board=request.param, second=(second, 2)
            )
            return Board(link)

        return start

    def press(self, sensor, zone):
        self.fingers[sensor].press = Press(85 * (zone + 0.5) / 10, 1500, 4.0)

    def lift(self, sensor):
        self.fingers[sensor].press = None

    @pytest.fixture
    def board(self, start):
        lines = calibrate(SENSOR)
        with start() as board:
            for sensor in board.sensors:
                prepare(board, strip_lines(lines, sensor), sensor)
            halves = enumerate(((0, 500), (500, 1000)))
            layout = ["layer 0 0"]
            layout += [
                f"key {low} {high} {action(KEYBOARD, 4 + i)} 0 0 0 0 0" for i, (low, high) in halves
            ]
            board.command("layout begin sensor=1")
            for line in layout:
                board.command("layout " + line)
            board.command("layout end " + checksum(layout))
            assert "save and reboot" in board.command("set keys=1 sensor=1")["note"]
            board.command("set keys=1")
            board.command("save")
        with start() as board:
            self.wait(board, 0.5)
            yield board

    def wait(self, board, seconds):
        for _ in board.frames(seconds):
            pass

    def test_each_strip_types_the_keys_of_its_own_layout(self, board):
        for sensor, zone in ((0, 0), (1, 2), (0, 9), (1, 7)):
            self.press(sensor, zone)
            self.wait(board, 0.2)
            self.lift(sensor)
            self.wait(board, 0.2)
        keys = [data[2] for _, data in board._link.usb.reports]
        assert keys == [30, 0, 4, 0, 39, 0, 5, 0]

    @pytest.mark.parametrize("lost", [0, 1])
    def test_a_lost_strip_releases_its_own_key_only(self, board, lost):
        name = ("bus", "second")[lost]
        plug = Plug(getattr(board._link, name))
        setattr(board._link, name, plug)
        self.press(0, 0)
        self.wait(board, 0.2)
        self.press(1, 2)
        self.wait(board, 0.2)
        plug.pull()
        self.wait(board, 0.5)
        down = [sorted(filter(None, data[2:])) for _, data in board._link.usb.reports]
        assert down == [[30], [4, 30], [(4, 30)[lost]]]
        self.lift(1 - lost)
        self.wait(board, 0.2)
        assert not any(board._link.usb.reports[-1][1])
