"""The simulated faults: their effects on bytes, on I2C transfers, and on a board."""

import errno

import numpy as np
import pytest

from spots.errors import SpotsError
from spots_sim.board.faults import (
    BoardFaults,
    Faults,
    FaultyBus,
    FaultyLink,
    of_scenario,
)
from spots_sim.chip.bus import I2CBus, SimulatedClock
from spots_sim.strip import files
from spots_sim.strip.files import (
    Bursts,
    BusFaults,
    ClockFaults,
    Moments,
    PowerFaults,
    ScenarioFile,
    SerialFaults,
    load,
)
from spots_sim.strip.scenario import Held, Scenario
from spots_sim.strip.world import chip

ADDRESS = 0x39


def faults(seed=0, seconds=60.0, **parts):
    return Faults(files.FaultsFile(**parts), seconds, seed)


def everything(data, damage, step=26, step_us=10_000.0):
    """Send bytes in blocks of `step` bytes, one every `step_us`; return the bytes that arrive.

    ``damage(block, time_us)`` returns the bytes of a block that arrive.
    """
    pieces = [data[i : i + step] for i in range(0, len(data), step)]
    return b"".join(damage(piece, i * step_us) for i, piece in enumerate(pieces))


SOME = SerialFaults(flip_percent=1, drop_percent=2, double_percent=3, insert_percent=4)


def test_each_way_befalls_its_share_of_the_bytes():
    made = faults(to_host=SOME)
    data = bytes(200_000)
    out = made.to_host(data, 0.0)
    counts = made.ledger.counts
    for way, percent in (("flip", 1), ("drop", 2), ("double", 3), ("insert", 4)):
        assert counts[f"to_host.{way}"] == pytest.approx(2000 * percent, rel=0.1)
    added = counts["to_host.double"] + counts["to_host.insert"] - counts["to_host.drop"]
    assert len(out) == len(data) + added
    assert sorted(made.to_host.touched) == list(made.to_host.touched)
    assert len(made.to_host.touched) == sum(counts.values())


def test_a_byte_is_damaged_the_same_however_the_stream_is_cut():
    data = bytes(range(256)) * 50
    whole = faults(to_host=SOME).to_host(data, 0.0)
    for step in (1, 7, 1000):
        damage = faults(to_host=SOME).to_host
        assert everything(data, damage, step) == whole


def test_the_seed_decides_and_the_directions_differ():
    data = bytes(10_000)
    first, again, other = (faults(seed, to_host=SOME).to_host(data, 0.0) for seed in (0, 0, 1))
    assert first == again != other
    made = faults(to_host=SOME, to_board=SOME)
    assert made.to_host(data, 0.0) != made.to_board(data, 0.0)


def test_one_fault_does_not_move_another():
    data = bytes(10_000)
    more = faults(to_host=SOME, to_board=SOME, power=PowerFaults(brown_outs=Moments(per_min=60)))
    more.to_board(data, 0.0)
    BoardFaults(more)
    assert more.to_host(data, 0.0) == faults(to_host=SOME).to_host(data, 0.0)


@pytest.mark.board
def test_bursts_of_a_rate_length_and_density_damage_so_many_bytes_in_the_mean():
    bursts = Bursts(per_min=10, last_ms=120, damage_percent=50)  # 1 %: 10/min x 0.12 s x 50 %
    made = faults(to_host=SerialFaults(bursts=bursts))
    data = bytes(26 * 100 * 3600)  # an hour of readings
    everything(data, made.to_host)
    assert len(made.to_host.touched) / len(data) == pytest.approx(0.01, rel=0.15)
    assert made.ledger.counts["to_host.bursts"] == pytest.approx(600, rel=0.15)
    numbers = np.array(made.to_host.touched)
    assert len(np.unique(numbers // (26 * 100))) < 0.4 * 3600  # in bursts, not distributed evenly


def test_nothing_happens_before_its_time():
    made = faults(from_s=5.0, to_host=SerialFaults(flip_percent=100))
    assert made.to_host(b"calm", 4.9e6) == b"calm"
    assert made.to_host(b"storm", 5.0e6) != b"storm"


def test_ctrl_c_is_not_made_by_damage():
    made = faults(to_board=SerialFaults(flip_percent=50, insert_percent=50))
    assert b"\x03" not in made.to_board(b"C#\x02\x01abc" * 20_000, 0.0)


def test_moments_repeat_with_the_scenario_and_are_told_once():
    moments = Moments(at_s=[3.0, 1.0], last_ms=500)
    made = faults(seconds=10.0, i2c=BusFaults(sda_low=moments))
    spells = made.spells("i2c.sda_low")
    assert not spells.active(0.9e6)
    assert spells.active(1.2e6)
    assert not spells.active(1.6e6)
    assert spells.begun(3.1e6) == (3.0e6, 3.5e6)
    assert spells.begun(3.2e6) is None
    assert spells.begun(11.0e6) == (11.0e6, 11.5e6)
    assert [begin for _, begin, _ in made.ledger.spells] == [1e6, 3e6, 11e6]


class Port:
    name = "port"

    def __init__(self):
        self.written = b""

    def now_s(self):
        return 1.0

    def read(self, timeout_s):
        return b"from the board" * 20

    def write(self, data):
        self.written += data

    def close(self):
        pass


def test_a_link_is_damaged_in_both_directions():
    port = Port()
    link = FaultyLink(port, faults(to_host=SOME, to_board=SerialFaults(drop_percent=100)))
    assert link.read(0.1) != port.read(0.1)
    link.write(b"hello\n")
    assert port.written == b""


@pytest.fixture
def wired(sensor):
    """Return a function that creates a bus with faults and a chip, 1 ms after power-on.

    It returns the bus and its `Faults`.
    """

    def make(**parts):
        bus = I2CBus(chip(sensor, Held(), 0), SimulatedClock(1000.0))
        made = faults(**parts)
        return FaultyBus(bus, made), made

    return make


def failures(bus, transfers, step_us=1000.0):
    """Return the errno of each of `transfers` reads of the chip's id; 0 for success."""
    found = []
    for _ in range(transfers):
        bus.clock.spend_us(step_us)
        try:
            bus.write_read(ADDRESS, b"\x92", 1)
            found.append(0)
        except OSError as error:
            found.append(error.errno)
    return found


def test_nobody_acknowledges_so_many_transfers(wired):
    bus, made = wired(i2c=BusFaults(nack_percent=5))
    found = failures(bus, 4000)
    assert found.count(errno.ENODEV) == made.ledger.counts["i2c.nack"]
    assert found.count(errno.ENODEV) == pytest.approx(200, rel=0.25)


def test_nobody_acknowledges_during_a_burst(wired):
    bus, _ = wired(i2c=BusFaults(nack_bursts=Moments(at_s=[1.0], last_ms=100)))
    at = np.flatnonzero(failures(bus, 2000))
    assert len(at) > 80
    assert at[-1] - at[0] == len(at) - 1


def test_sda_is_held_until_nine_clocks(wired):
    bus, _ = wired(i2c=BusFaults(sda_low=Moments(at_s=[0.5], last_ms=1e6)))
    found = failures(bus, 600)
    assert found[-1] == errno.ETIMEDOUT
    for clock in range(9):
        assert bus.lines(1, 1) == 0, clock  # this call only reads SDA, and is no clock pulse
        bus.lines(0, 1)
        bus.lines(1, 1)
    assert bus.lines(1, 1) == 1
    assert failures(bus, 1) == [0]


def test_sda_is_held_for_a_time(wired):
    bus, _ = wired(i2c=BusFaults(sda_low=Moments(at_s=[0.5], last_ms=400)))
    found = np.array(failures(bus, 2000))
    assert (found == errno.ETIMEDOUT).sum() == 8  # the timeout of an I2C controller is 50 ms
    assert found[-1] == 0


def test_wrong_data_is_one_wrong_bit(wired):
    bus, made = wired(i2c=BusFaults(wrong_percent=20))
    ids = []
    for _ in range(500):
        bus.clock.spend_us(1000)
        ids.append(bus.write_read(ADDRESS, b"\x92", 1)[0])
    wrong = [value for value in ids if value != 0x24]
    assert len(wrong) == made.ledger.counts["i2c.wrong"]
    assert len(wrong) == pytest.approx(100, rel=0.4)
    assert {bin(value ^ 0x24).count("1") for value in wrong} == {1}


def test_an_unplugged_sensor_forgets_everything(wired):
    bus, _ = wired(power=PowerFaults(sensor_unplugged=Moments(at_s=[1.0], last_ms=100)))
    failures(bus, 10)
    bus.write(ADDRESS, bytes((0xAA, 7)))
    bus.write(ADDRESS, bytes((0x80, 1)))
    found = failures(bus, 1500)
    assert 70 < sum(map(bool, found)) < 130
    assert bus.write_read(ADDRESS, b"\xaa", 1) == b"\x09"
    assert bus.write_read(ADDRESS, b"\x80", 1) == b"\x00"


def test_a_reset_sensor_forgets_and_a_stalled_board_loses_time(wired):
    moments = {"at_s": [1.0], "last_ms": 250.0}
    bus, made = wired(
        power=PowerFaults(sensor_resets=Moments(at_s=[0.5]), brown_outs=Moments(at_s=[2.0])),
        clock=ClockFaults(stalls=Moments(**moments), oscillator_ppm=100),
    )
    board = BoardFaults(made)
    assert board.rate == pytest.approx(1.0001)
    failures(bus, 10)
    bus.write(ADDRESS, bytes((0xAA, 7)))
    bus.write(ADDRESS, bytes((0x80, 1)))
    bus.clock.time_us = 0.6e6
    assert board.step(bus) is None
    failures(bus, 1)
    assert bus.write_read(ADDRESS, b"\xaa", 1) == b"\x09"
    assert bus.write_read(ADDRESS, b"\x80", 1) == b"\x00"
    bus.clock.time_us = 1.01e6
    assert board.step(bus) is None
    assert bus.clock.now_us() == pytest.approx(1.25e6)
    bus.clock.time_us = 2.01e6
    assert board.step(bus) == pytest.approx(100_000)
    assert board.step(bus) is None


FIRE = "seconds = 5.0\n[faults]\n"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[faults.to_host]\nflip_percent = 101", "flip_percent must be .* at most 100"),
        ("[faults.to_host]\nflip_percent = 60\ndrop_percent = 60", "at most 100 %"),
        ("[faults.i2c]\nnacks = 1", "unknown key 'nacks' in table faults.i2c"),
        (
            "[faults.power]\nbrown_outs = {at_s = [5.0]}",
            "power.brown_outs has a time that is not before the end",
        ),
        ("[faults.power]\nbrown_outs = {last_ms = 0}", "last_ms must be a number of more than 0"),
        ("[faults.clock]\noscillator_ppm = 5000", "oscillator_ppm must be .* at most 1000"),
        ("strain = [[0, 1.0]]\nstrain_percent = 2.0", "strain and strain_percent are both given"),
        ("bend = [[1, 1.0], [1, 2.0]]", "times of bend must ascend"),
        ("bend = [[1, 400.0]]", "entry 2 of entry 1 of bend must be .* at most 360"),
        ("leak = [[6, 0.1, 1.0]]", "leak has points after"),
        ("leak = [[1, 1.1, 1.0]]", "entry 2 of entry 1 of leak must be .* at most 1"),
    ],
)
def test_a_mistake_in_a_scenario_is_one_sentence(tmp_path, text, says):
    path = tmp_path / "my.toml"
    path.write_text("seconds = 5.0\n" + text)
    with pytest.raises(SpotsError, match=says) as caught:
        load(ScenarioFile, path)
    assert "\n" not in str(caught.value)


def test_a_scenario_without_faults_has_none():
    assert of_scenario(load(ScenarioFile, "demo"), 0) is None


def test_the_strip_moves_in_straight_lines_and_the_short_form_stays():
    points = {"strain": [(1.0, 0.0), (3.0, 10.0)], "bend": [(0.0, 0.0), (4.0, 80.0)]}
    moving = Scenario(
        ScenarioFile(seconds=4.0, leak=[(0.0, 0.0, 10.0), (4.0, 0.4, 20.0)], **points)
    )
    for start_s in (0, 400):
        pose = moving.pose(start_s + 2.0)
        assert (pose.strain, pose.bend_deg) == pytest.approx((0.05, 40.0))
        assert (pose.leak_share, pose.leak_mm) == pytest.approx((0.2, 15.0))
    assert moving.pose(0.5).strain == 0
    assert moving.pose(3.5).strain == pytest.approx(0.1)
    still = Scenario(ScenarioFile(seconds=4.0, strain_percent=5.0, bend_deg=30.0)).pose(1.0)
    assert (still.strain, still.bend_deg, still.leak_share) == (0.05, 30.0, 0.0)


def test_a_leak_is_light_without_a_finger(sensor):
    from spots_sim.strip.world import World

    leaky = ScenarioFile(seconds=4.0, leak=[(0.0, 0.0, 30.0), (4.0, 0.04, 30.0)])
    world = World(sensor, Scenario(leaky), np.random.default_rng(0))
    counts = [world.collect(1e6 * at, 1e6 * at + 10_000, 20.0)["F8"] for at in (0.0, 1.0, 2.0, 3.0)]
    assert counts[0] == pytest.approx(0, abs=0.01 * counts[3])
    assert counts[1] > 1e-3
    assert np.diff(counts) == pytest.approx(counts[1], rel=0.05)
    assert Scenario(leaky).presses(2.0) == []
