"""Simulates faults of a serial link, an I2C bus and a board, and counts them.

Faults have their own random generators, one for each name such as ``i2c`` or ``clock.stalls``,
which depend only on the seed. So faults take no random numbers from the generator of the sensor's
noise, and the start times of one fault do not depend on other faults. All times are those of the
board's `bus.SimulationClock`. The classes can be used alone: `FaultyLink` damages bytes,
`FaultyBus` damages transfers, and `BoardFaults` applies faults of power and clock before each
request of the firmware to the simulator, such as a transfer.
"""

from __future__ import annotations

import errno
import heapq
import itertools
from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from spots.link.link import Link

from ..chip.bus import I2CBus
from ..strip.files import (
    FaultsFile,
    Moments,
    ScenarioFile,
    SerialFaults,
)
from .link_wrapper import LinkWrapper

# Part of the seed; separates these generators from others with the same seed.
_OWN = 0xFA017
_CTRL_C = 3
WAYS = ("flip", "drop", "double", "insert")
_CLOCKS_THAT_FREE_SDA = 9
# Timeout of an I2C controller while SDA is held low.
_BUS_TIMEOUT_US = 50_000.0


@dataclass
class FaultLedger:
    """Counts and times of all faults since the start of the run.

    `counts` is by kind, such as ``to_host.flip`` (bytes), ``i2c.nack`` (transfers) or
    ``power.brown_outs``. `spells` has kind, start in us and end in us of each fault that lasts.
    """

    counts: Counter = field(default_factory=Counter)
    spells: list[tuple[str, float, float]] = field(default_factory=list)


class Spells:
    """The intervals in which a fault acts. Call the methods with times that never decrease.

    `seconds` is the duration of the scenario, after which the times `moments.at_s` repeat; no
    interval starts before `from_s`. Nothing else may use `rng`: the intervals depend only on its
    seed.
    """

    def __init__(
        self, moments: Moments, seconds: float, from_s: float, rng, kind: str, ledger: FaultLedger
    ):
        self._last_us = 1000 * moments.last_ms
        fixed = _repeated(sorted(moments.at_s), seconds, from_s)
        at_random = _poisson(moments.per_min / 60, from_s, rng)
        self._starts = heapq.merge(fixed if moments.at_s else (), at_random)
        self._next_us = self._draw()
        self._until_us = 0.0
        self._kind = kind
        self._ledger = ledger

    def begun(self, now_us: float) -> tuple[float, float] | None:
        """Return start and end in us of the next interval that has begun.

        Each interval is returned one time. None if no further interval has begun.
        """
        if now_us < self._next_us:
            return None
        spell = self._next_us, self._next_us + self._last_us
        self._next_us = self._draw()
        self._until_us = max(self._until_us, spell[1])
        self._ledger.counts[self._kind] += 1
        self._ledger.spells.append((self._kind, *spell))
        return spell

    def active(self, now_us: float) -> bool:
        """Return whether the fault acts at the time `now_us`."""
        while self.begun(now_us):
            pass
        return now_us < self._until_us

    def _draw(self) -> float:
        return 1e6 * next(self._starts, float("inf"))


def _repeated(at_s: list[float], seconds: float, from_s: float) -> Iterator[float]:
    turns = itertools.count(int(from_s // seconds))  # skips repetitions before from_s
    return (at for turn in turns for at in (turn * seconds + one for one in at_s) if at >= from_s)


def _poisson(per_s: float, from_s: float, rng) -> Iterator[float]:
    at_s = from_s
    while per_s > 0:
        at_s += rng.exponential(1 / per_s)
        yield at_s


class Damage:
    """Damages the bytes that a link sends in one direction.

    The damage depends on the time of each byte, but not on how the bytes are split into calls.
    `kind` names the direction in the ledger, such as ``to_host``. `touched` has the indices of the
    most recently damaged bytes, counted from 0 at the start of the stream.
    """

    _KEPT = 1 << 20

    def __init__(
        self, file: SerialFaults, bursts: Spells, from_s: float, rng, kind: str, ledger: FaultLedger
    ):
        shares = file.flip_percent, file.drop_percent, file.double_percent, file.insert_percent
        self._edges = np.cumsum(shares) / 100
        self._in_burst = np.arange(1, 5) * file.bursts.damage_percent / 400
        self._bursts = bursts
        self._from_us = 1e6 * from_s
        self._rng = rng
        self._kind = kind
        self._ledger = ledger
        self.passed = 0
        self.touched: deque[int] = deque(maxlen=self._KEPT)

    def __call__(self, data: bytes, now_us: float) -> bytes:
        """Return the bytes that arrive if `data` is sent at the time `now_us`."""
        first, self.passed = self.passed, self.passed + len(data)
        if now_us < self._from_us or not data:
            return data
        edges = self._in_burst if self._bursts.active(now_us) else self._edges
        draws = self._rng.random((len(data), 2))
        ways = np.searchsorted(edges, draws[:, 0], side="right")
        hit = np.flatnonzero(ways < 4)
        if not len(hit):
            return data
        out, at = bytearray(), 0
        for i in hit.tolist():
            out += data[at:i]
            out += self._hurt(data[i], int(ways[i]), draws[i, 1])
            at = i + 1
        self.touched.extend((first + hit).tolist())
        return bytes(out + data[at:])

    def _hurt(self, byte: int, way: int, draw: float) -> bytes:
        name = WAYS[way]
        self._ledger.counts[f"{self._kind}.{name}"] += 1
        if name == "drop":
            return b""
        if name == "double":
            return bytes((byte, byte))
        if name == "insert":
            return bytes((self._allowed(int(256 * draw)), byte))
        return bytes((self._allowed(byte ^ 1 << int(8 * draw)),))

    def _allowed(self, byte: int) -> int:
        # Ctrl-C stops the application, so damage must not create it.
        return byte ^ 0x80 if byte == _CTRL_C else byte


class FaultyLink(LinkWrapper):
    """A connection to a board (link) whose bytes are damaged in both directions.

    Parameters
    ----------
    link : spots.link.link.Link
        Link to the board.
    faults : Faults
        Faults of the run.
    """

    def __init__(self, link: Link, faults: Faults):
        super().__init__(link)
        self._faults = faults

    def read(self, timeout_s: float) -> bytes:
        return self._faults.to_host(self._link.read(timeout_s), 1e6 * self.now_s())

    def write(self, data: bytes) -> None:
        self._link.write(self._faults.to_board(data, 1e6 * self.now_s()))


class FaultyBus:
    """A `bus.I2CBus` whose transfers fail or are damaged."""

    def __init__(self, bus: I2CBus, faults: Faults):
        self.bus = bus
        self.chip, self.clock, self.ledger = bus.chip, bus.clock, bus.ledger
        self._file = faults.file.i2c
        self._from_us = 1e6 * faults.file.from_s
        self._counts = faults.ledger.counts
        self._rng = faults.rng("i2c")
        self._nack_bursts = faults.spells("i2c.nack_bursts")
        self._sda_low = faults.spells("i2c.sda_low")
        self._unplugged = faults.spells("power.sensor_unplugged")
        self._plugged_in_us: float | None = None
        self._sda_free_us = 0.0
        self._clocks = 0
        self._scl = 1

    @property
    def frequency_hz(self) -> int:
        """Frequency of the bus in Hz; the board sets it."""
        return self.bus.frequency_hz

    @frequency_hz.setter
    def frequency_hz(self, hz: int) -> None:
        self.bus.frequency_hz = hz

    def write(self, address: int, data: bytes) -> None:
        wrong = self._meet()
        self.bus.write(address, self._with_a_wrong_bit(data, 1, wrong))

    def write_read(self, address: int, data: bytes, size: int) -> bytes:
        wrong = self._meet()
        return self._with_a_wrong_bit(self.bus.write_read(address, data, size), 0, wrong)

    def read(self, address: int, size: int) -> bytes:
        wrong = self._meet()
        return self._with_a_wrong_bit(self.bus.read(address, size), 0, wrong)

    def lines(self, scl: int, sda: int) -> int:
        """As `bus.I2CBus.lines`, but SDA may be held low until SCL has been clocked."""
        level = self.bus.lines(scl, sda)
        if not self._sda_is_held():
            return level
        self._clocks += scl and not self._scl
        self._scl = scl
        if self._clocks >= _CLOCKS_THAT_FREE_SDA:
            self._sda_free_us = 0.0
        return 0

    def light(self, level: int) -> None:
        self.bus.light(level)

    def _meet(self) -> float | None:
        # Raises an error, or returns the position of a wrong bit (0 to 1 of the transfer), or None.
        now_us = self.clock.now_us()
        self._plug(now_us)
        if self._sda_is_held():
            self._counts["i2c.timeout"] += 1
            self.clock.spend_us(_BUS_TIMEOUT_US)
            raise OSError(errno.ETIMEDOUT, "SDA is held low")
        if now_us < self._from_us:
            return None
        nack, wrong, where = self._rng.random(3).tolist()
        burst = self._nack_bursts.active(now_us)
        if self._plugged_in_us is not None or burst or nack < self._file.nack_percent / 100:
            if self._plugged_in_us is None:
                self._counts["i2c.nack"] += 1
            self.bus.refuse()
        if wrong < self._file.wrong_percent / 100:
            return where
        return None

    def _plug(self, now_us: float) -> None:
        while spell := self._unplugged.begun(now_us):
            self.chip.power_on(spell[0])
            self._plugged_in_us = spell[1]
        if self._plugged_in_us is not None and now_us >= self._plugged_in_us:
            self.chip.power_on(self._plugged_in_us)
            self._plugged_in_us = None

    def _sda_is_held(self) -> bool:
        now_us = self.clock.now_us()
        while spell := self._sda_low.begun(now_us):
            self._sda_free_us, self._clocks = spell[1], 0
        return now_us < self._sda_free_us

    def _with_a_wrong_bit(self, data: bytes, first: int, where: float | None) -> bytes:
        bits = 8 * (len(data) - first)
        if where is None or bits <= 0:
            return data
        self._counts["i2c.wrong"] += 1
        i = int(where * bits)
        changed = bytearray(data)
        changed[first + i // 8] ^= 1 << i % 8
        return bytes(changed)


class BoardFaults:
    """Faults of a board's power and clock; call `step` before each transfer or wait of the board.

    `rate` is the number of seconds that the board's clock counts in one true second.
    """

    def __init__(self, faults: Faults):
        self.rate = 1 + faults.file.clock.oscillator_ppm * 1e-6
        self._stalls = faults.spells("clock.stalls")
        self._resets = faults.spells("power.sensor_resets")
        self._brown_outs = faults.spells("power.brown_outs")

    def step(self, bus: I2CBus | FaultyBus) -> float | None:
        """Apply the faults that have begun; return the duration of a brown-out in us, or None.

        At a brown-out, the caller must stop the board, wait for this duration, call
        `bus.chip.power_on` and boot the board.
        """
        now_us = bus.clock.now_us()
        while spell := self._stalls.begun(now_us):
            bus.clock.pause_us(max(0.0, spell[1] - now_us))
        while spell := self._resets.begun(now_us):
            bus.chip.power_on(now_us)
        off_us = None
        while spell := self._brown_outs.begun(now_us):
            off_us = spell[1] - spell[0]
        return off_us


class Faults:
    """All faults of one run of a virtual board; `seconds` is the duration of the scenario."""

    def __init__(self, file: FaultsFile, seconds: float, seed: int = 0):
        self.file = file
        self.ledger = FaultLedger()
        self._seconds = seconds
        self._seed = seed
        self.to_host = self._damage("to_host", file.to_host)
        self.to_board = self._damage("to_board", file.to_board)

    def rng(self, kind: str) -> np.random.Generator:
        """Return a new random generator for one kind of fault, such as ``i2c``."""
        return np.random.default_rng([_OWN, self._seed, *kind.encode()])

    def spells(self, kind: str) -> Spells:
        """Return the intervals of the fault with the key `kind`, such as ``clock.stalls``."""
        moments = self.file.moments()[kind]
        rng = self.rng(kind)
        return Spells(moments, self._seconds, self.file.from_s, rng, kind, self.ledger)

    def _damage(self, kind: str, file: SerialFaults) -> Damage:
        bursts = self.spells(f"{kind}.bursts")
        return Damage(file, bursts, self.file.from_s, self.rng(kind), kind, self.ledger)


def of_scenario(file: ScenarioFile, seed: int) -> Faults | None:
    """Return the faults of a scenario file; None if it has no faults."""
    return Faults(file.faults, file.seconds, seed) if file.faults else None
