"""Faults on the I2C bus: the board recovers, and reports each fault one time."""

import errno

import numpy as np
import pytest
from support.refusals import refusal

from spots.advice.calibrated import hello_calibrated
from spots.errors import BoardError, PortError
from spots_device.reading import decode

pytestmark = pytest.mark.board


class Cut:
    """An I2C bus whose chip does not answer while `cut` is true, or at chosen transfers."""

    def __init__(self, bus):
        self._bus = bus
        self.cut = False
        self.misses = range(0)
        self.transfers = 0
        self.clock = bus.clock
        self.lines = bus.lines
        self.chip = bus.chip

    def write(self, *arguments):
        self._fail()
        return self._bus.write(*arguments)

    def write_read(self, *arguments):
        self._fail()
        return self._bus.write_read(*arguments)

    def _fail(self):
        self.transfers += 1
        if self.cut or self.transfers in self.misses:
            self.clock.spend_us(50)
            raise OSError(errno.ENODEV, "cut")


def test_a_sensor_that_is_unplugged_and_plugged_in_again(rig, calibration):
    made = rig(calibration=calibration)
    made.link.bus = Cut(made.link.bus)
    made.press(42.0, 3000.0)
    made.readings(5)
    made.link.bus.cut = True
    made.settle(2.0)
    assert [line["log"] for line in made.board.log] == ["error"]  # one log line, not many
    assert made.board.command("get")["fault"]
    made.board.set(exposure_us=10_000)  # without a sensor, `hello` has no calibration afterwards
    with refusal(BoardError, why="no_bus"):
        hello_calibrated(made.board)
    made.link.bus.cut = False
    made.settle(0.5)
    assert [line["text"] for line in made.board.log][-1] == "the sensor answers"
    readings = made.readings(20)
    assert all(r.trusted for r in readings)
    assert np.mean([r.position_um for r in readings]) == pytest.approx(42_000, abs=200)


@pytest.mark.parametrize("first", range(1, 25))
def test_two_transfers_that_nobody_answers_anywhere_in_a_dark_window(rig, calibration, first):
    # These transfers include those that select the register bank of the LED, and bank 0 again.
    made = rig(calibration=calibration)
    made.press(42.0, 3000.0)
    made.readings(2)
    made.link.bus = cut = Cut(made.link.bus)
    cut.misses = range(first, first + 2)
    made.link.write(b"dark\n")
    made.settle(1.0)
    assert cut.transfers > first + 1
    assert made.board.command("get")["fault"] is None
    assert all(reading.trusted for reading in made.readings(5))


def test_the_first_reading_after_an_outage_says_that_something_is_missing(rig, calibration):
    made = rig(calibration=calibration)
    made.readings(2)
    made.link.bus = Cut(made.link.bus)
    made.link.bus.cut = True
    made.settle(0.5)
    made.link.bus.cut = False
    first = next(iter(made.board.frames()))
    assert first.flags & decode.DROPPED


def test_a_chip_that_stops_sampling_is_started_again(rig):
    made = rig()
    made.readings(5)
    made.link.chip.write(bytes((0x80, 0x01)))  # as a brown-out of the chip would
    made.settle(0.5)
    assert "stopped sampling" in made.board.log[0]["text"]
    assert len(made.readings(10)) == 10


def test_another_chip_at_the_address_is_not_taken_for_ours(rig):
    made = rig()
    made.link.chip._main[0x92] = 0x10
    made.link.chip.write(bytes((0x80, 0x01)))
    made.settle(1.0)
    assert "not an AS7341 (ID 0x10)" in made.board.command("get")["fault"]


@pytest.mark.usefixtures("in_micropython")
def test_a_crash_of_the_firmware_is_one_sentence(rig, tmp_path):
    made = rig(folder=tmp_path)
    (tmp_path / "main.py").write_text("raise ValueError('boom')\n")
    with refusal(PortError):
        _reboot(made)


def _reboot(made):
    made.board.command("reboot")
    made.settle(1.0)
