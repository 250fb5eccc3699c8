"""The CircuitPython build in a real MicroPython, with substitutes for CircuitPython's modules."""

import contextlib

import pytest
from cobs import cobs
from support.boards import DEADLINE_S, running, until
from support.refusals import refusal

import spots
from spots.deploy.staging import device_of, stage
from spots.errors import BoardError
from spots.link.board import Board
from spots.link.connect import prepare
from spots.link.serial_link import SerialLink
from spots_device.board.store import Store
from spots_sim.board.lockstep import LockstepLink
from spots_sim.person.stage import calibrate
from spots_sim.strip.files import ScenarioFile, load
from spots_sim.strip.scenario import Scenario

pytestmark = pytest.mark.board

BOARD = "virtual_circuitpython"


class Tapped(LockstepLink):
    """A link that stores every byte, and writes only while the board processes a new sample.

    Without this rule, a write would follow a read that timed out between two requests of the board
    to the simulator. A sleep is one request on MicroPython, and two on CircuitPython. So the write
    would be at different times on the two runtimes.
    """

    def __init__(self, *arguments, **named):
        self.bytes = b""
        super().__init__(*arguments, **named)

    def read(self, timeout_s):
        received = super().read(timeout_s)
        self.bytes += received
        return received

    def write(self, data):
        samples = self.chip.samples
        while self.chip.samples == samples:
            self._board.step()
        super().write(data)


def touch_frames(sensor, seed, board):
    """Run the scenario `demo`; return the payloads of all TOUCH frames, and `Board.info`."""
    link = Tapped(sensor, Scenario(load(ScenarioFile, "demo")), seed, board=board)
    # Nothing is sent during the start of the sensor, whose transfers differ between the runtimes:
    # a command would arrive at different times.
    link.read(0.2)
    with Board(link) as board:
        prepare(board, calibrate(sensor))
        board.command("set average=2")
        board.command("stream touch")
        for _ in board.frames(15.0):
            pass
        board.command("dark")
        board.command("set exposure_us=5000 gain=10")  # starts the sensor a second time
        for _ in board.frames(2.0):
            pass
        info = board.info
    payloads = [cobs.decode(frame) for frame in link.bytes.split(b"\0") if frame]
    return [payload for payload in payloads if payload[0] & 15 == 1], info


@pytest.mark.usefixtures("in_micropython")
def test_touch_frames_are_those_of_micropython_to_the_byte(sensor):
    theirs, _ = touch_frames(sensor, 7, "virtual")
    ours, info = touch_frames(sensor, 7, BOARD)
    assert info["board"] == BOARD
    assert len(ours) > 900
    assert any(payload[7] & 1 for payload in ours)  # touched
    assert ours == theirs


@pytest.mark.usefixtures("own_firmware")
def test_what_is_saved_is_there_after_a_reboot_for_boot_py_lets_the_board_write(sensor, tmp_path):
    link = LockstepLink(sensor, Scenario(load(ScenarioFile, "demo")), folder=tmp_path, board=BOARD)
    with Board(link) as board:
        board.command("set gain=7")
        board.command("save")
        board.command("reboot")
    assert "gain=7" in (tmp_path / "settings-a.txt").read_text()
    (tmp_path / "spots_device").rename(tmp_path / "gone")  # the next start writes it again
    link = LockstepLink(sensor, Scenario(load(ScenarioFile, "demo")), folder=tmp_path, board=BOARD)
    with Board(link) as board:
        assert board.info["gain"] == 7


@pytest.mark.usefixtures("own_firmware")
def test_a_drive_that_is_the_hosts_refuses_a_save_and_the_board_goes_on(sensor, tmp_path):
    stage(device_of(BOARD), tmp_path)
    boot = tmp_path / "spots_device" / "board" / "circuitpython.py"
    remount = '    storage.remount("/", readonly=False)\n'
    assert remount in boot.read_text()
    broken = boot.read_text().replace(remount, "")
    link = LockstepLink(sensor, Scenario(load(ScenarioFile, "demo")), folder=tmp_path, board=BOARD)
    with Board(link) as board:
        boot.write_text(broken)
        board.command("reboot")
        link.read(1.0)
        board.command("set gain=7")
        with refusal(BoardError, why="no_flash") as caught:
            board.command("save")
        assert "read-only" in str(caught.value)
        assert board.command("get")["gain"] == 7
    assert not (tmp_path / "settings-a.txt").exists()


@pytest.mark.usefixtures("own_firmware")
def test_a_bus_without_pull_ups_is_reported_once_and_tried_again(sensor, tmp_path):
    (tmp_path / "busio.py").write_text(
        "tries = []\n"
        "def I2C(scl, sda, *, frequency):\n"
        "    tries.append(1)\n"
        "    if len(tries) < 60:\n"
        "        raise RuntimeError('No pull up found on SDA or SCL; check your wiring')\n"
        "    import sys\n"
        "    sys.modules.pop('busio')\n"
        "    sys.path.reverse()\n"
        "    import busio\n"
        "    return busio.I2C(scl, sda, frequency=frequency)\n"
    )
    link = LockstepLink(sensor, Scenario(load(ScenarioFile, "demo")), folder=tmp_path, board=BOARD)
    with Board(link) as board:
        assert "No pull up found" in board.command("get")["fault"]
        for _ in board.frames(6.0):
            pass
        state = board.command("get")
    assert state["fault"] is None
    assert state["faults"] == 1
    assert [line["text"] for line in board.log][-1] == "the sensor answers"


@pytest.fixture
def start(tmp_path):
    """Return a function that starts a board with the files in `tmp_path`.

    It returns the names of the data port and of the console.
    """
    stage(device_of(BOARD), tmp_path)
    with contextlib.ExitStack() as boards:

        def begin():
            ports = boards.enter_context(running(tmp_path, BOARD))
            return ports["port"], ports["console"]

        yield begin


def test_ctrl_c_on_the_console_stops_the_application_and_its_led(start):
    data, console = start()
    with spots.open(data) as board:
        assert len([touch for touch, _ in zip(board.touches(), range(20))]) == 20
    link = SerialLink(console)
    link.write(b"\x03")
    assert b"KeyboardInterrupt" in until(link, b">>> ")
    for line in (
        b"import board, busio, adafruit_as7341 as a",
        b"chip = a.AS7341(busio.I2C(board.SCL, board.SDA))",  # changes neither LED nor sampling
        b"print('led', chip.led, 'sampling', chip._color_meas_enabled)",
    ):
        link.write(line + b"\r")
        said = until(link, b">>> ")
    assert b"led False sampling False" in said
    link.close()


def test_a_watchdog_and_ctrl_c_under_it(start, tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        patch.chdir(tmp_path)
        Store().save([("settings", ["watchdog=1"])])
    app = tmp_path / "spots_device" / "board" / "strip_app.py"
    hanging = app.read_text().replace("self.outputs.use_layout(lines)", "while True: pass")
    app.write_text(hanging)
    started = tmp_path / "spots_device" / "board" / "start.py"
    assert "WATCHDOG_MS = 8_000" in started.read_text()
    started.write_text(started.read_text().replace("WATCHDOG_MS = 8_000", "WATCHDOG_MS = 700"))
    data, console = start()
    with spots.open(data) as board:
        assert len([touch for touch, _ in zip(board.touches(), range(150))]) == 150  # > 700 ms
        board._link.write(b"layout clear\n")
        assert any(board.stats.restarts for _ in board.touches(DEADLINE_S))
    link = SerialLink(console)
    link.write(b"\x03")
    until(link, b"stopped by Ctrl-C")
    link.close()


def test_the_button_leaves_the_drive_to_the_host_and_the_prompt_to_people(
    start, tmp_path, monkeypatch
):
    with (tmp_path / "board_config.py").open("a") as file:
        file.write("SAFE_BOOT = 'BUTTON'\n")
    monkeypatch.setenv("SPOTS_BUTTON", "held")
    _, console = start()
    link = SerialLink(console)
    link.write(b"\r")  # requests a new prompt: the output at the start may be lost
    until(link, b">>> ")
    link.write(b"import storage, sys\r")
    until(link, b">>> ")
    link.write(b"print(storage.getmount('/').readonly, 'spots_device.board.app' in sys.modules)\r")
    until(link, b"\nTrue False")
    link.close()


def test_a_crash_is_told_and_the_board_starts_anew(start, tmp_path):
    path = tmp_path / "spots_device" / "board" / "app.py"
    broken = path.read_text().replace(
        "    def time_us(self):\n", "    def time_us(self):\n        self.nonsense()\n"
    )
    path.write_text(broken)
    data, _ = start()
    link = SerialLink(data)
    decoder = spots.Decoder()
    link.write(b"\nsync\n")
    told, end_s = [], link.now_s() + DEADLINE_S
    while not told:
        assert link.now_s() < end_s
        told = [f.content for f in decoder.feed(link.read(0.1)) if "log" in f.content]
    assert "AttributeError" in told[0]["text"]
    hello = []
    while not hello:
        assert link.now_s() < end_s
        link.write(b"hello\n")
        frames = decoder.feed(link.read(0.2))
        hello = [frame for frame in frames if frame.content.get("re") == "hello"]
    link.close()
