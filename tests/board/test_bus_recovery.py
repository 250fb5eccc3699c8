"""Faults of I2C bus, sensor and power: the firmware recovers, on both runtimes."""

import numpy as np
import pytest

from spots.link.frames import Touch
from spots_sim.board.faults import Faults
from spots_sim.strip.files import (
    BusFaults,
    ClockFaults,
    FaultsFile,
    Moments,
    PowerFaults,
)

pytestmark = pytest.mark.board

BOARDS = ["virtual", "virtual_circuitpython"]
PLACE_UM = 42_000


@pytest.fixture
def faulty(rig, calibration):
    """Return a function that creates a calibrated, pressed rig with faults of its bus.

    The function returns the rig, and a counter of the faults by kind. The faults begin at 3 s.
    """

    def make(board="virtual", **parts):
        faults = Faults(FaultsFile(from_s=3.0, **parts), 3600.0)
        made = rig(board=board, faults=faults, calibration=calibration)
        made.board.command("save")
        made.press(PLACE_UM / 1000, 3000.0)
        assert made.link.now_s() < 3.0
        return made, faults.ledger.counts

    return make


def touches(made, seconds):
    return list(made.board.touches(seconds))


def are_right(readings):
    assert all(reading.trusted for reading in readings)
    assert np.mean([r.position_um for r in readings]) == pytest.approx(PLACE_UM, abs=200)


def longest_gap_s(readings):
    return float(np.diff([reading.time_s for reading in readings]).max())


@pytest.mark.parametrize("board", BOARDS)
def test_transfers_that_nobody_acknowledges_cost_single_samples_and_no_word(faulty, board):
    made, counts = faulty(board, i2c=BusFaults(nack_percent=1.0))
    readings = touches(made, 12.0)
    state = made.board.command("get")
    assert counts["i2c.nack"] > 10
    assert state["retries"] == pytest.approx(counts["i2c.nack"], abs=3)
    assert state["faults"] == 0
    assert not made.board.log
    assert len(readings) > 1150
    assert longest_gap_s(readings) < 0.1
    are_right([reading for reading in readings if reading.time_s > 1.5])


@pytest.mark.parametrize("board", BOARDS)
def test_a_chip_that_holds_sda_is_clocked_free(faulty, board):
    low = Moments(at_s=[4.0, 6.0, 8.0], last_ms=1e6)
    made, counts = faulty(board, i2c=BusFaults(sda_low=low))
    readings = touches(made, 9.0)
    made.board.command("dark")  # the LED is switched with the new I2C controller, too
    assert counts["i2c.timeout"] == 3  # the first transfer after each fault
    assert not made.board.log
    assert longest_gap_s(readings) < 0.1  # 50 ms of it are the timeout of the I2C controller
    are_right(readings[-50:])


def test_a_chip_that_holds_sda_since_before_the_board_started_is_clocked_free(rig):
    low = BusFaults(sda_low=Moments(at_s=[0.0], last_ms=1e9))
    made = rig(faults=Faults(FaultsFile(from_s=0.0, i2c=low), 3600.0))
    made.settle(0.5)
    assert made.board.command("get")["fault"] is None
    assert len(made.readings(10)) == 10


def test_without_the_nine_clocks_it_would_never_come_back(faulty, monkeypatch):
    made, _ = faulty(i2c=BusFaults(sda_low=Moments(at_s=[4.0], last_ms=1e6)))
    monkeypatch.setattr(made.link.bus, "lines", made.link.bus.bus.lines)
    readings = touches(made, 9.0)
    assert readings[-1].time_s < 4.1
    assert made.board.command("get")["fault"]


def test_a_sensor_that_was_reset_is_set_up_again(faulty):
    made, _ = faulty(power=PowerFaults(sensor_resets=Moments(at_s=[5.0])))
    readings = touches(made, 6.0)
    assert [line["log"] for line in made.board.log] == ["error", "info"]
    assert "stopped sampling" in made.board.log[0]["text"]
    assert longest_gap_s(readings) < 0.3
    are_right(readings[-50:])


def test_a_sensor_that_is_swapped_is_set_up_again(faulty):
    made, _ = faulty(power=PowerFaults(sensor_unplugged=Moments(at_s=[5.0], last_ms=700)))
    readings = touches(made, 8.0)
    assert [line["log"] for line in made.board.log] == ["error", "info"]
    assert longest_gap_s(readings) < 1.1
    are_right(readings[-50:])


@pytest.mark.parametrize(("register", "value"), [(0x81, 1), (0xAA, 5), (0xCA, 0), (0x80, 0x43)])
def test_a_register_that_is_not_what_was_written_is_noticed_and_set_again(rig, register, value):
    made = rig()
    made.readings(3)
    made.link.chip._main[register] = value
    for _ in range(3):  # a pair of registers is read back in each dark window
        made.link.write(b"dark\n")
        made.settle(2.0)
    # A longer sample period may be measured before the register is read back.
    text = made.board.log[0]["text"]
    assert "has lost its settings" in text or "samples every" in text
    assert made.board.log[-1]["text"] == "the sensor answers"
    assert made.link.chip._main[register] != value
    assert len(made.readings(20)) == 20


def test_a_sensor_that_acknowledges_but_never_samples_is_reported_once(rig):
    made = rig()
    chip = made.link.chip
    set_enable = chip._set_enable
    chip._set_enable = lambda value: set_enable(value & ~2 if value & 2 else value)
    chip.write(bytes((0x80, 1)))
    made.settle(5.0)
    assert [line["log"] for line in made.board.log] == ["error"]
    chip._set_enable = set_enable
    made.settle(0.5)
    assert [line["log"] for line in made.board.log] == ["error", "info"]


def test_wrong_data_on_the_bus_never_stops_it(faulty):
    made, counts = faulty(i2c=BusFaults(wrong_percent=3.0))
    readings = touches(made, 15.0)
    assert counts["i2c.wrong"] > 50
    assert len(readings) > 800
    assert made.link.now_s() - readings[-1].time_s < 1.0


@pytest.mark.parametrize(("board", "ppm"), [*zip(BOARDS, (0, 1000)), (BOARDS[0], 1000)])
def test_a_board_counts_time_by_its_own_oscillator(faulty, board, ppm):
    made, _ = faulty(board, clock=ClockFaults(oscillator_ppm=ppm))
    made.board.command(
        "set exposure_us=100000"
    )  # few samples, which take the most time to simulate
    board_us = []
    for wait_s in (1.0, 61.0):
        made.settle(wait_s)
        sent_s = made.link.now_s()
        board_us.append(made.board.command("sync")["t_us"] - 1e6 * sent_s)
    # A board reads a command up to 10 ms after its arrival: 164 ppm of this time.
    drift_ppm = (board_us[1] - board_us[0]) / 61
    assert drift_ppm == pytest.approx(ppm, abs=200)


def test_a_program_goes_on_after_brown_outs(faulty):
    made, counts = faulty(power=PowerFaults(brown_outs=Moments(at_s=[5.0, 9.0], last_ms=200)))
    gaps, last_s, readings = [], made.link.now_s(), []
    for touch in made.board.touches(10.0):
        gaps.append(made.link.now_s() - last_s)
        last_s = made.link.now_s()
        assert 0 <= last_s - touch.time_s < 0.3  # with the new conversion of board time
        readings.append(touch)
    assert counts["power.brown_outs"] == 2
    assert made.board.stats.restarts == 2
    assert made.board.stats.lost == made.board.stats.bad_crc == 0
    assert sum(gap > 0.1 for gap in gaps) == 2
    assert max(gaps) < 1.2  # the host's timeout of 0.5 s is included
    assert last_s - readings[-1].time_s < 0.02
    assert [r.time_s for r in readings] == sorted(r.time_s for r in readings)
    are_right(readings[-50:])


def test_the_latest_reading_comes_after_a_brown_out_too(faulty):
    made, _ = faulty(power=PowerFaults(brown_outs=Moments(at_s=[5.0], last_ms=200)))
    made.board.touches()
    while made.link.now_s() < 7.0:
        assert isinstance(made.board.read_latest(), Touch)
    assert made.board.stats.restarts == 1


def test_a_board_that_reads_slowly_is_not_taken_for_one_that_restarted(rig):
    made = rig()
    made.board.command("set exposure_us=1000000")
    assert len(touches(made, 8.0)) >= 5
    assert made.board.stats.restarts == 0
