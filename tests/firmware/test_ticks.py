"""The clock on CircuitPython: small integers, few reads of the system's clock, exact sleeps."""

import ast
import random
from pathlib import Path
from zlib import crc32

import pytest
from support.smallint import SmallInt

import spots_device

FIRMWARE = Path(spots_device.__file__).parent
CLOCK = FIRMWARE / "runtime" / "circuitpython.py"
FRAMES = FIRMWARE / "reading" / "fast_circuitpython.py"
PERIOD_US = 1 << 29


def hash_of_circuitpython(value):
    """Return the lowest 31 bits of an integer as a signed number, like `hash` on a board."""
    low = value & 0x7FFFFFFF
    return low - 0x80000000 if low & 0x40000000 else low


class World:
    """The modules that the firmware's clock uses; times in us.

    `sleep` wakes up at the end of a millisecond, up to 1 ms late.
    """

    def __init__(self, now_us):
        self.now_us = now_us
        self.reads = 0

    def monotonic_ns(self):
        self.reads += 1
        return int(1000 * self.now_us)

    def ticks_ms(self):
        return SmallInt(int(self.now_us) // 1000 % PERIOD_US)

    def sleep(self, seconds):
        self.now_us = (self.now_us + 1e6 * seconds) // 1000 * 1000 + 1000

    def delay_us(self, us):
        assert 0 < us < 6000
        self.now_us += us

    def defined(self, name, source=CLOCK):
        """Return a class or function of a module of the firmware.

        It is executed from the source, because the module can be imported only on a board.
        """
        body = [
            node
            for node in ast.parse(source.read_text()).body
            if isinstance(node, ast.Assign)
            or (isinstance(node, (ast.ClassDef, ast.FunctionDef)) and node.name == name)
        ]
        names = {
            "const": int,
            "hash": hash_of_circuitpython,
            "time": self,
            "supervisor": self,
            "microcontroller": self,
        }
        exec(compile(ast.Module(body, []), str(source), "exec"), names)
        return names[name]


STARTS_US = [0, 1, (1 << 28) - 1, (1 << 29) - 1, (1 << 30) - 1, 1 << 40]


@pytest.mark.parametrize("us", STARTS_US)
@pytest.mark.parametrize("later_us", [-(1 << 28), -1, 0, 1, (1 << 28) - 1])
def test_ticks_and_their_differences_are_small_integers(us, later_us):
    clock = World(us).defined("MonotonicClock")()
    ticks = SmallInt(clock.ticks_us())
    later = clock.ticks_add(ticks, SmallInt(later_us))
    assert clock.ticks_diff(later, ticks) == later_us
    assert clock.ticks_diff(ticks, ticks) == 0


@pytest.mark.parametrize("us", STARTS_US)
def test_ticks_are_those_of_the_systems_clock_whatever_the_time_between_two_reads(us):
    rng = random.Random(1)
    world = World(us)
    clock = world.defined("MonotonicClock")()
    for _ in range(3000):
        world.now_us += rng.choice([0.4, 30, 1_700.3, 9_999.9, 999_000, 1_001_000, 5e6, 4e9])
        late_us = (int(world.now_us) - clock.ticks_us()) % PERIOD_US
        assert late_us in (0, 1, PERIOD_US - 1)


def test_a_wait_reads_the_systems_clock_once_and_ends_on_time():
    rng = random.Random(2)
    world = World(1 << 31)
    clock = world.defined("MonotonicClock")()
    for _ in range(2000):
        due = clock.ticks_add(clock.ticks_us(), rng.randrange(2_000, 30_000))
        world.now_us += rng.uniform(0, 25_000)  # the loop computes
        world.reads = 0
        wait_us = clock.ticks_diff(due, clock.ticks_early_us())
        left_us = clock.ticks_diff(due, int(world.now_us) % PERIOD_US)
        assert 1000 - 2 <= wait_us - left_us <= 3000 + 2
        assert world.reads == 0
        if wait_us > 0:
            clock.sleep_early_us(wait_us)
        asked = clock.ticks_us()
        assert world.reads <= (1 if left_us > 0 else 2)
        late_us = clock.ticks_diff(asked, due)
        assert late_us >= 0
        if left_us > 0:
            assert late_us == 0
        assert abs(clock.ticks_diff(int(world.now_us) % PERIOD_US, asked)) <= 2


def test_a_checksum_is_taken_apart_without_long_integers():
    high_half = World(0).defined("_high_half", FRAMES)
    rng = random.Random(3)
    for crc in [0, 0x3FFFFFFF, 0x40000000, 0x7FFFFFFF, 0x80000000, 0xC0000000, 0xFFFFFFFF] + [
        crc32(rng.randbytes(22)) for _ in range(1000)
    ]:
        assert high_half(crc) == crc >> 16
        assert hash_of_circuitpython(crc) & 0xFFFF == crc & 0xFFFF
