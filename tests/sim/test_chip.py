"""The simulated AS7341: each register behaves as the datasheet describes."""

import errno

import numpy as np
import pytest
from support.refusals import refusal

from spots_sim.chip.as7341 import AS7341, AUTO_ZERO_US
from spots_sim.chip.bus import I2CBus, SimulatedClock
from spots_sim.chip.converter import DIODES, ChipNoise
from spots_sim.chip.quirks import Quirks

ADDRESS = 0x39
SILENT = ChipNoise(read_counts=0.0, electrons_per_count_1x=1e30, dark_counts_512x=0.0)


class Lamp:
    """Simulated light: diode Fn has n counts per ms at gain 1x and an LED current of 20 mA.

    The counts are proportional to the current.
    """

    def __init__(self, rate=1.0):
        self.rate = rate

    def collect(self, start_us, end_us, led_mA):
        level = self.rate * led_mA / 20 * (end_us - start_us) / 1000
        return {diode: level * (i + 1) for i, diode in enumerate(DIODES)}


class Bench:
    """A simulated chip on an I2C bus with 400 kHz, and functions to set it up byte by byte."""

    def __init__(self, lamp=None, noise=SILENT, **quirks):
        self.clock = SimulatedClock()
        rng = np.random.default_rng(0)
        self.chip = AS7341(lamp or Lamp(), noise, rng, Quirks(**quirks))
        self.bus = I2CBus(self.chip, self.clock)
        self.clock.spend_us(1000)

    def write(self, register, *values):
        self.bus.write(ADDRESS, bytes((register, *values)))

    def read(self, register, size=1):
        return self.bus.write_read(ADDRESS, bytes((register,)), size)

    def run(self, map_bytes, astep=3596, gain=6, led=0x08):
        """Set the chip up with an SMUX map, and start it; the LED current is 4 + 2 * led mA."""
        self.write(0x80, 0x01)
        self.write(0xA9, 0x10)
        self.write(0x70, 0x08)
        self.write(0x74, 0x80 | led)
        self.write(0xA9, 0x00)
        self.write(0x81, 0)
        self.write(0xCA, astep & 0xFF, astep >> 8)
        self.write(0xAA, gain)
        self.write(0xF9, 0x08)
        self.write(0xAF, 0x10)
        self.write(0x00, *map_bytes)
        self.write(0x80, 0x11)
        self.clock.spend_us(1000)
        assert not self.read(0x80)[0] & 0x10
        self.write(0x80, 0x03)

    def wait(self, us):
        self.clock.spend_us(us)

    def sample(self):
        burst = self.read(0x93, 14)
        return burst[0], burst[1], np.frombuffer(burst[2:], "<u2").tolist()


# F1 to F4, CLEAR, NIR and F5 to F8, CLEAR, NIR as ams AN000666 prints them.
F1_F4 = bytes(
    [0x30, 0x01, 0, 0, 0, 0x42, 0, 0, 0x50, 0, 0, 0, 0x20, 0x04, 0, 0x30, 0x01, 0x50, 0, 6]
)
F5_F8 = bytes(
    [0, 0, 0, 0x40, 0x02, 0, 0x10, 0x03, 0x50, 0x10, 0x03, 0, 0, 0, 0x24, 0, 0, 0x50, 0, 6]
)


def test_identity_and_reset_values():
    bench = Bench()
    assert bench.read(0x92)[0] >> 2 == 9
    assert bench.read(0xCA, 2) == b"\xe7\x03"
    assert bench.read(0xAA) == b"\x09"


def test_it_does_not_answer_right_after_power_on_nor_at_other_addresses():
    fresh = I2CBus(AS7341(Lamp(), SILENT, np.random.default_rng(0)), SimulatedClock(100.0))
    with refusal(OSError, errno=errno.ENODEV):
        fresh.write_read(ADDRESS, b"\x92", 1)
    with refusal(OSError, errno=errno.ENODEV):
        Bench().bus.write_read(0x38, b"\x92", 1)


def test_wire_time_of_the_transfers():
    bench = Bench()
    before = bench.clock.now_us()
    bench.read(0x93, 14)
    assert bench.clock.now_us() - before == pytest.approx((3 + 9 * 17) * 2.5)
    before = bench.clock.now_us()
    bench.write(0x93, 0x08)
    assert bench.clock.now_us() - before == pytest.approx((2 + 9 * 3) * 2.5)
    assert bench.bus.ledger.transactions == 2
    assert bench.bus.ledger.wire_bytes == 17 + 3


def test_the_led_registers_are_in_bank_1_and_the_others_in_bank_0():
    bench = Bench()
    assert bench.read(0x74) == b"\x00"
    bench.write(0xA9, 0x10)
    assert bench.read(0x74) == b"\x04"
    assert bench.read(0x92) == b"\x00"
    bench.write(0xCA, 1)
    bench.write(0xA9, 0x00)
    assert bench.read(0xCA) == b"\xe7"


@pytest.mark.parametrize(("image", "first"), [(F1_F4, 1), (F5_F8, 5)])
def test_a_map_routes_its_diodes_to_the_six_converters(image, first):
    bench = Bench(Lamp(0.1))
    bench.run(image)
    bench.wait(AUTO_ZERO_US + 10_100)
    _, _, counts = bench.sample()
    clear, nir = 9, 10
    ideal = [0.1 * 10 * 32 * n for n in (first, first + 1, first + 2, first + 3, clear, nir)]
    assert counts == pytest.approx(ideal, abs=1)


def test_the_map_takes_effect_only_when_the_command_runs():
    bench = Bench()
    bench.run(F1_F4)
    bench.write(0x00, *F5_F8)
    bench.wait(40_000)
    assert bench.sample()[2][0] == pytest.approx(10 * 32, abs=1)


def test_each_sample_raises_aint_once_and_writing_1_clears_it():
    bench = Bench()
    bench.run(F1_F4)
    bench.wait(AUTO_ZERO_US + 5_000)
    assert not bench.sample()[0] & 0x08
    bench.wait(6_000)
    assert bench.sample()[0] & 0x08
    assert bench.sample()[0] & 0x08
    bench.write(0x93, 0x08)
    assert not bench.sample()[0] & 0x08
    bench.wait(10_000)
    assert bench.sample()[0] & 0x08


@pytest.mark.parametrize("clears", [True, False])
def test_avalid_may_or_may_not_clear_on_read(clears):
    bench = Bench(avalid_clears_on_read=clears)
    bench.run(F1_F4)
    bench.wait(AUTO_ZERO_US + 11_000)
    assert bench.read(0xA3)[0] & 0x40
    bench.sample()
    assert bool(bench.read(0xA3)[0] & 0x40) is not clears


def counts(data):
    return np.frombuffer(data, "<u2").tolist()


def test_the_first_read_after_a_restart_is_fresh_without_astatus():
    # The drivers of DFRobot and SparkFun restart the chip, wait for AVALID, read only counts.
    lamp = Lamp()
    bench = Bench(lamp)
    bench.run(F1_F4)
    for rate in (1.0, 0.5):
        lamp.rate = rate
        bench.write(0x80, 0x01)
        bench.write(0x80, 0x03)
        bench.wait(AUTO_ZERO_US + 11_000)
        assert bench.read(0xA3)[0] & 0x40
        assert counts(bench.read(0x95, 12))[0] == pytest.approx(320 * rate, abs=1)


@pytest.mark.parametrize(("apers", "samples"), [(0, 0), (1, 1), (3, 3), (4, 5)])
@pytest.mark.parametrize("way", ["below", "above"])
def test_aint_waits_for_so_many_samples_outside_the_thresholds(apers, samples, way):
    lamp = Lamp()
    bench = Bench(lamp)
    bench.write(0xBD, apers)
    bench.write(0xB5, 2)
    bench.write(0x84, *(1000).to_bytes(2, "little"), *(2000).to_bytes(2, "little"))
    lamp.rate = 1.5  # ADC 2: 10 ms, 32x, diode 3: 960 at 1.0
    bench.run(F1_F4)
    bench.wait(AUTO_ZERO_US + 10_000 * 7 + 500)
    assert bool(bench.sample()[0] & 0x08) is (apers == 0)
    bench.write(0x93, 0x08)
    lamp.rate = 0.9 if way == "below" else 2.3
    bench.wait(10_000)  # a part of this sample still has the previous light
    bench.write(0x93, 0x08)
    before = bench.chip.samples
    while apers and not bench.sample()[0] & 0x08:
        bench.wait(1000)
    assert bench.chip.samples - before in (max(samples - 1, 0), samples)


def test_the_smux_is_refused_while_it_measures():
    bench = Bench()
    bench.run(F1_F4)
    bench.write(0xAF, 0x10)
    bench.write(0x00, *F5_F8)
    bench.write(0x80, 0x13)
    assert bench.read(0x80) == b"\x03"
    bench.wait(50_000)
    assert bench.sample()[2][0] == pytest.approx(10 * 32, abs=1)


def test_the_fifo_holds_what_its_map_names_and_is_read_in_one_transfer():
    bench = Bench()
    bench.write(0xFC, 0x0B)  # ASTATUS, CH0, CH2
    bench.write(0xF9, 0x0C)
    bench.run(F1_F4)
    bench.write(0xF9, 0x0C)
    bench.wait(AUTO_ZERO_US + 21_000)
    assert bench.read(0xFD) == b"\x06"
    assert not bench.read(0x93)[0] & 0x04
    bench.wait(10_000)
    assert bench.read(0x93)[0] & 0x04  # 8 entries, the reset value of FIFO_TH
    astatus, ch0, ch2 = np.reshape(counts(bench.read(0xFE, 18)), (3, 3)).T
    assert astatus.tolist() == [6, 6, 6]
    assert ch0 == pytest.approx([320] * 3, abs=1)
    assert ch2 == pytest.approx([960] * 3, abs=1)
    assert bench.read(0xFD) == b"\x00"
    assert bench.read(0xFE, 2) == bytes(2)


def test_one_transfer_reads_the_level_and_then_the_data():
    bench = Bench()
    bench.write(0xFC, 0x06)  # CH0, CH1
    bench.run(F1_F4)
    bench.wait(AUTO_ZERO_US + 21_000)
    level, *data = bench.read(0xFD, 9)
    assert level == 4
    assert bytes(data) != bytes(8)
    assert bench.read(0xFD, 3) == bytes(3)


def test_a_sample_that_ends_during_a_transfer_from_an_empty_fifo_is_read_in_part():
    torn = set()
    for early_us in range(0, 900, 10):
        bench = Bench()
        bench.write(0xFC, 0x7E)
        bench.run(F1_F4)
        while bench.read(0xFD) == b"\x00":
            bench.wait(50)
        bench.write(0xFA, 0x02)
        bench.wait(9_300 + early_us)
        level, *data = bench.read(0xFD, 13)
        rest = bench.read(0xFD)[0]
        entries = sum(any(data[i : i + 2]) for i in range(0, 12, 2))
        assert level or entries + rest in (0, 6)
        torn.add(entries if not level else 6)
    assert torn.issuperset({0, 1, 5, 6})


def test_a_fifo_that_overflows_says_so_and_can_be_cleared():
    bench = Bench()
    bench.write(0xFC, 0x7E)
    bench.run(F1_F4)
    bench.wait(AUTO_ZERO_US + 212_000)
    assert bench.read(0xFD) == b"\x7e"
    assert not bench.read(0xA7)[0] & 0x80
    bench.wait(10_000)
    assert bench.read(0xFD) == b"\x80"
    assert bench.read(0xA7)[0] & 0x80
    bench.write(0xFA, 0x02)
    assert bench.read(0xFD) == b"\x00"
    assert not bench.read(0xA7)[0] & 0x80


@pytest.mark.parametrize(("hz", "status"), [(100.0, 45), (120.0, 46), (None, 44)])
def test_the_flicker_detector_names_100_and_120_hz(hz, status):
    class Room(Lamp):
        def outside(self, start_us, end_us):
            middle_s = 0.5e-6 * (start_us + end_us)
            return 5.0 + (np.sin(2 * np.pi * hz * middle_s + 1) if hz else 0.0)

    bench = Bench(Room())
    bench.run(F1_F4)
    assert bench.read(0xDB) == b"\x00"
    bench.write(0x80, 0x43)
    bench.wait(100_000)
    assert bench.read(0xDB) == b"\x00"
    bench.wait(500_000)
    assert bench.read(0xDB)[0] == status
    bench.wait(20_000)
    assert bench.sample()[2][5] == 0


def test_counts_change_only_where_astatus_is_read():
    lamp = Lamp()
    bench = Bench(lamp)
    bench.run(F1_F4)
    bench.wait(AUTO_ZERO_US + 11_000)
    first = bench.sample()[2]
    lamp.rate = 0.5
    bench.wait(30_000)
    assert np.frombuffer(bench.read(0x95, 12), "<u2").tolist() == first
    assert bench.sample()[2] == pytest.approx([c / 2 for c in first], abs=1)


@pytest.mark.parametrize(("every_start", "pause"), [(True, AUTO_ZERO_US), (False, 0)])
def test_auto_zero_may_or_may_not_come_at_every_start(every_start, pause):
    bench = Bench(auto_zero_at_every_start=every_start)
    bench.run(F1_F4)
    bench.wait(30_000)
    bench.write(0x80, 0x01)
    samples = bench.chip.samples
    bench.write(0x80, 0x03)
    bench.wait(pause + 9_500)
    bench.sample()
    assert bench.chip.samples == samples
    bench.wait(1_000)
    bench.sample()
    assert bench.chip.samples == samples + 1


@pytest.mark.parametrize(
    ("registers", "period_us"),
    [
        ([], 10_000),
        ([(0x83, 2), (0x80, 0x0B)], 10_000 + 3 * 2_780),
        ([(0x83, 2), (0xA9, 0x04), (0x80, 0x0B)], 10_000 + 16 * 3 * 2_780),
        ([(0xA9, 0x20)], 10_500),
        ([(0xD6, 1)], 25_000),
        ([(0xD6, 2)], 17_500),
        ([(0xAC, 0x1C)], None),  # sleeps after an interrupt
        ([(0xA9, 0x10), (0x70, 0x09), (0xA9, 0)], None),  # waits for an edge
    ],
)
def test_registers_that_change_the_sample_period(registers, period_us):
    bench = Bench()
    bench.run(F1_F4)
    for register, value in registers:
        bench.write(register, value)
    bench.wait(AUTO_ZERO_US + 11_000)
    bench.chip.advance(bench.clock.now_us())
    before = bench.chip.samples
    bench.wait(1e6)
    bench.chip.advance(bench.clock.now_us())
    wanted = 0 if period_us is None else 1e6 / period_us
    assert bench.chip.samples - before == pytest.approx(wanted, abs=2)


def test_clearing_sai_act_ends_the_sleep_after_an_interrupt():
    bench = Bench()
    bench.run(F1_F4)
    bench.write(0xAC, 0x1C)
    bench.wait(100_000)
    assert bench.read(0xA7)[0] & 0x02
    bench.write(0xAC, 0x0C)
    bench.write(0xFA, 0x01)
    assert not bench.read(0xA7)[0] & 0x02
    bench.wait(AUTO_ZERO_US + 35_000)
    bench.read(0x93)
    assert bench.chip.samples == 4


@pytest.mark.parametrize(("rate", "gain"), [(0.01, 9), (12.0, 5)])
def test_the_automatic_gain_follows_the_counts(rate, gain):
    bench = Bench(Lamp(rate))
    bench.run(F1_F4, gain=7)
    bench.write(0xB1, 0x84)
    bench.wait(200_000)
    assert bench.sample()[1] & 0x0F == gain
    assert bench.read(0xAA)[0] == 7
    bench.write(0xB1, 0x80)
    bench.wait(20_000)
    assert bench.sample()[1] & 0x0F == 7


def test_the_fifo_of_the_flicker_detector_gets_no_counts():
    bench = Bench()
    bench.run(F1_F4)
    bench.write(0xFC, 0x7E)
    bench.write(0xD7, 0xA1)
    bench.wait(100_000)
    assert bench.read(0xFD) == b"\0"


def test_full_scale_is_the_number_of_steps_and_is_flagged():
    bench = Bench(Lamp(100.0))
    bench.run(F1_F4)
    bench.wait(AUTO_ZERO_US + 11_000)
    status, astatus, counts = bench.sample()
    assert max(counts) == 3597
    assert status & 0x80
    assert astatus & 0x80
    assert bench.read(0xA3)[0] & 0x18


def test_astatus_tells_the_gain():
    bench = Bench(Lamp(0.1))
    bench.run(F1_F4, gain=7)
    bench.wait(AUTO_ZERO_US + 11_000)
    assert bench.sample()[1] == 7


def test_the_led_needs_its_select_bit_and_its_current_starts_at_4_mA():
    bench = Bench()
    bench.run(F1_F4, led=0)  # 4 mA
    bench.wait(AUTO_ZERO_US + 11_000)
    assert bench.sample()[2][0] == pytest.approx(10 * 32 * 4 / 20, abs=1)
    bench.write(0xA9, 0x10)
    bench.write(0x70, 0x00)
    bench.write(0xA9, 0x00)
    bench.wait(30_000)
    assert bench.sample()[2] == [0] * 6


def test_light_switched_within_a_sample_counts_for_its_part():
    bench = Bench()
    bench.run(F1_F4)
    start = bench.clock.now_us() + AUTO_ZERO_US
    bench.write(0xA9, 0x10)
    bench.wait(start + 5_000 - bench.clock.now_us())
    bench.write(0x74, 0x08)
    bench.write(0xA9, 0x00)
    bench.wait(6_000)
    assert bench.sample()[2][0] == pytest.approx(5 * 32, rel=0.02)


def test_samples_follow_each_other_without_a_gap():
    bench = Bench()
    bench.run(F1_F4)
    bench.wait(AUTO_ZERO_US + 1_000_000)
    bench.sample()
    assert bench.chip.samples == 100
    assert bench.chip.integrating_us == pytest.approx(100 * 3597 * 2.78)


def test_noise_has_the_size_that_is_asked_for():
    noise = ChipNoise(read_counts=3.0, electrons_per_count_1x=1e30, dark_counts_512x=0.0)
    bench = Bench(noise=noise)
    bench.run(F1_F4)
    bench.wait(AUTO_ZERO_US)
    rows = []
    for _ in range(2000):
        bench.wait(10_000)
        rows.append(bench.sample()[2])
    assert np.std(rows, axis=0) == pytest.approx(3.0, rel=0.1)


def test_shot_noise_is_the_root_of_the_electrons():
    noise = ChipNoise(read_counts=0.0, electrons_per_count_1x=32.0, dark_counts_512x=0.0)
    bench = Bench(Lamp(0.5), noise=noise)
    bench.run(F1_F4)  # at gain 32x, one count is one electron
    bench.wait(AUTO_ZERO_US)
    rows = []
    for _ in range(2000):
        bench.wait(10_000)
        rows.append(bench.sample()[2])
    assert np.std(rows, axis=0) == pytest.approx(np.sqrt(np.mean(rows, axis=0)), rel=0.1)
