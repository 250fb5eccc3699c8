"""A virtual board as slow as a real board, with as little memory: it samples without stopping."""

import contextlib

import numpy as np
import pytest
from support.boards import store
from support.sensors import replaced

from spots.deploy.staging import stage
from spots.link.board import Board
from spots.link.connect import upload
from spots.link.decoder import Decoder
from spots.link.frames import Text, Touch
from spots_device.reading.decode import DROPPED
from spots_sim.board.lockstep import LockstepLink
from spots_sim.board.vm import HEAP_BYTES
from spots_sim.strip.scenario import Held, Press

pytestmark = pytest.mark.board

BACK_S = 1.0
BOARDS = ["virtual", "virtual_circuitpython"]


def slows_down(free_bytes):
    """Return the time of a loop pass in us: allocations are slow if the heap is full of garbage."""
    return 700.0 if free_bytes > HEAP_BYTES // 4 else 4_500.0


class Plug:
    """An I2C bus whose sensor can be unplugged."""

    def __init__(self, bus):
        self._bus = bus
        self.away = False

    def __getattr__(self, name):
        return getattr(self._bus, name)

    def write(self, *arguments):
        return self._pass(self._bus.write, *arguments)

    def write_read(self, *arguments):
        return self._pass(self._bus.write_read, *arguments)

    def _pass(self, transfer, *arguments):
        if self.away:
            self._bus.refuse()
        return transfer(*arguments)


class Slow:
    """A board that gets only the commands of `say`, because commands collect the garbage."""

    def __init__(self, sensor, busy_us, folder=None, away=False, board="virtual"):
        self.held = Held()
        self.link = LockstepLink(sensor, self.held, 0, folder, board=board, busy_us=busy_us)
        self.plug = self.link.bus = Plug(self.link.bus)
        self.plug.away = away
        self._decoder = Decoder()

    def run(self, seconds):
        """Let simulated time pass; return the frames of these `seconds`."""
        end_s = self.link.now_s() + seconds
        frames = []
        while self.link.now_s() < end_s:
            frames += self._decoder.feed(self.link.read(end_s - self.link.now_s()))
        return frames

    def touches(self, seconds):
        return [frame for frame in self.run(seconds) if isinstance(frame, Touch)]

    def say(self, line):
        """Send a command; return the reply."""
        self.link.write(line.encode() + b"\n")
        frames = self.run(0.5)
        return next(f.content for f in frames if isinstance(f, Text) and "re" in f.content)


@pytest.fixture
def slow(sensor):
    with contextlib.ExitStack() as links:

        def make(*arguments, **options):
            made = Slow(sensor, *arguments, **options)
            links.callback(made.link.close)
            return made

        yield make


@pytest.mark.parametrize(("board", "absent_s"), [(BOARDS[0], 60.0), (BOARDS[1], 0.3)])
def test_readings_are_back_within_a_second_of_the_sensor(slow, absent_s, board):
    made = slow(slows_down, away=True, board=board)
    made.link.write(b"stream touch\n")
    for _ in range(2):  # sensor absent at the start, then unplugged while the board runs
        made.plug.away = True
        made.run(absent_s)
        made.plug.away = False
        made.run(BACK_S)
        assert len(made.touches(1.0)) > 90


@pytest.mark.parametrize("absent_s", [2.0])
def test_a_keyboard_without_a_program_types_within_a_second_of_the_sensor(
    slow, calibration, tmp_path, absent_s
):
    store(tmp_path, calibration=calibration, settings=["keys=1"])
    made = slow(slows_down, folder=tmp_path, away=True)
    for times in (1, 2):
        made.plug.away = True
        made.run(absent_s)
        made.plug.away = False
        made.run(BACK_S)
        made.held.press = Press(42.0, 1500.0, 4.0)
        made.run(0.2)
        made.held.press = None
        made.run(0.2)
        assert len(made.link.usb.reports) == 2 * times


@pytest.mark.parametrize("board", BOARDS)
def test_a_search_without_end_leaves_the_heap_as_it_was(slow, board):
    made = slow(lambda free_bytes: 700.0, away=True, board=board)
    made.run(3.0)
    free_bytes = made.link.free_bytes
    made.run(30.0)
    assert made.link.free_bytes > free_bytes - 16 * 1024


@pytest.mark.parametrize(("board", "busy_us"), [*zip(BOARDS, (3_000, 8_000)), (BOARDS[0], 15_000)])
def test_a_slow_loop_reads_what_it_can(slow, busy_us, board):
    made = slow(busy_us, board=board)
    made.link.write(b"stream touch\n")
    made.run(2.0)
    assert len(made.touches(2.0)) > 0.5 * 2.0e6 / max(10_000, busy_us + 500)


@pytest.mark.parametrize("exposure_us", [1_000, 1_300, 1_700, 2_400])
def test_an_exposure_too_short_for_the_board_gives_what_it_can_and_counts_the_rest(
    slow, exposure_us
):
    busy_us = 2_000
    made = slow(busy_us)
    made.run(1.0)
    made.say("stream touch")
    actual_us = made.say(f"set exposure_us={exposure_us}")["exposure_us"]
    made.run(1.0)
    before = made.say("get")["missed"]
    began_s = made.link.now_s()
    touches = made.touches(4.0)
    reply = made.say("get")
    period_us = max(actual_us, busy_us + 480)
    assert len(touches) > 0.85 * 4e6 / period_us
    read = (made.link.now_s() - began_s) / (4.0 / len(touches))
    lost = (made.link.now_s() - began_s) * 1e6 / actual_us - read
    assert reply["missed"] - before == pytest.approx(lost, rel=0.15, abs=20)
    if actual_us < 2_000:
        # When the FIFO overflows, all its samples are lost.
        gaps = np.diff([touch.t_us for touch in touches]) > 10 * actual_us
        assert gaps.any()
        assert all(touch.flags & DROPPED for touch, gap in zip(touches[1:], gaps) if gap)


def counted(made):
    """Send ``get``; return the numbers of TOUCH frames before its reply, of missed samples, of all.

    The number of all samples comes from the simulated chip; no board knows this number.
    """
    made.link.write(b"get\n")
    touches = 0
    while True:
        for frame in made._decoder.feed(made.link.read(0.001)):
            touches += isinstance(frame, Touch)
            if isinstance(frame, Text) and frame.content.get("re") == "get":
                return touches, frame.content["missed"], made.link.chip.samples


@pytest.mark.parametrize(
    ("board", "exposure_us", "busy_us", "error_percent"),
    [(BOARDS[0], 2_780, 2_200, -3), (BOARDS[0], 1_500, 1_900, -3), (BOARDS[1], 1_000, 3_000, 3)],
)
def test_what_the_chip_made_was_taken_or_missed(sensor, board, exposure_us, busy_us, error_percent):
    chip = {"clock_error_percent": error_percent}
    made = Slow(replaced(sensor, converter=chip), 300, board=board)
    with contextlib.closing(made.link):
        made.run(1.5)  # with an exposure of 10 ms, the board measures the chip's oscillator
        made.link.set_busy_us(busy_us)
        made.say("stream touch")
        made.say(f"set exposure_us={exposure_us}")
        made.run(1.0)
        _, missed, samples = counted(made)
        touches = len(made.touches(4.0))
        more, missed_then, samples_then = counted(made)
    assert touches + more + missed_then - missed == pytest.approx(
        samples_then - samples, rel=0.01, abs=4
    )


@pytest.mark.usefixtures("own_firmware")
def test_an_upload_gets_every_reply_however_slow_the_writes_of_the_board_are(
    sensor, calibration, monkeypatch
):
    def staged(device, folder):
        stage(device, folder)
        path = folder / "spots_device/runtime/micropython.py"
        write = "self._out(block, _BLOCK)"
        assert write in path.read_text()
        slow = f"(time.sleep_ms(300), {write})[1]"
        path.write_text(path.read_text().replace(write, slow))

    monkeypatch.setattr("spots_sim.board.vm.stage", staged)
    with Board(LockstepLink(sensor, Held())) as board:
        upload(board, calibration)
        assert board.command("get")["dropped"] > len(calibration)  # a slow write may lose bytes
        assert board.stats.lost == board.stats.bad_crc == 0


def test_an_upload_costs_the_samples_of_one_parse_and_all_are_counted(rig, calibration):
    board = rig(cpu="pico").board
    decoder, heard = Decoder(), []
    board.channel.taps.append(lambda data, now_s: heard.extend(decoder.feed(data)))
    list(board.touches(seconds=0.2))
    upload(board, calibration)
    missed = board.command("get")["missed"]
    list(board.touches(seconds=0.2))
    times_us = [frame.t_us for frame in heard if isinstance(frame, Touch)]
    steps = np.diff(times_us) / board.info["exposure_us"]
    assert len(steps) > 400
    # After an overflow, the time of the first sample is known to one exposure.
    assert abs(sum(np.rint(steps) - 1) - missed) <= 1
    assert 0 < missed <= 66  # 0.58 s of parsing and checksum, at 10 ms
