"""A simulated AS7341 at register level: it answers I2C transfers byte by byte.

It is written from the ams datasheet DS000504 v3-00 and application note AN000666 v1-01 alone. It
shares no constant with the firmware's driver, because it tests that driver. A behaviour that no
document defines is a field of `Quirks`; a driver must work with every value.

The chip contains no optics. A light source computes what the photodiodes collect in an interval:
``light.collect(start_us, end_us, led_mA) -> dict`` returns counts at gain 1x by diode name. For the
flicker detector, ``light.outside(start_us, end_us)`` returns the mean ambient light.
``light.switch(on)`` sets the board's pin for an LED that is not wired to the chip.
``light.temperature_C(now_us)`` returns the temperature; only the board's thermometer asks for it.
"""

from __future__ import annotations

import math
import struct

from .converter import STEP_US, ChipNoise, Converter
from .fifo import Fifo
from .flicker import flicker_status
from .quirks import Quirks

AUTO_ZERO_US = 15_000.0  # duration of an auto-zero, which corrects the offset of the ADCs
WAIT_US = 2780.0  # unit of the wait time between samples; 16 times as long with the bit WLONG
LOW_POWER_US = 500.0  # assumed: start of the oscillator before each sample in low-power mode
POWER_ON_US = 200.0  # time after power-on before the chip acknowledges its address

_SIX = struct.Struct("<6H")
_SEVEN = struct.Struct("<7H")

_EXPOSURE = 0x81, 0xCA, 0xCB  # registers ATIME and ASTEP

# DS000504: consecutive samples outside the thresholds before an interrupt, by the code APERS; FIFO
# entries before an interrupt, by the code FIFO_TH.
_PERSISTENCE = (0, 1, 2, 3, 5, 10, 15, 20, 25, 30, 35, 40, 45, 50, 55, 60)
_FIFO_LEVELS = (1, 4, 8, 16)
# DS000504, CFG10: limits of the automatic gain in 1/8 of full scale, by the codes AGC_H and AGC_L.
_AGC_HIGH = (4, 5, 6, 7)
_AGC_LOW = (1, 2, 3, 4)
# Writes to these registers have no effect: identity, status, counts, and the FIFO's level and data.
_READ_ONLY = {0x90, 0x91, 0x92, *range(0x94, 0xA8), 0xDB, 0xFD, 0xFE, 0xFF}

_RESET_VALUES = {
    0x81: 0x00, 0x92: 0x24, 0xAA: 0x09, 0xAC: 0x0C, 0xAF: 0x10, 0xB1: 0x88, 0xB3: 0xF2, 0xBE: 0x02,
    0xCA: 0xE7, 0xCB: 0x03, 0xCF: 0x99, 0xD6: 0xFF, 0xD7: 0x21,
}  # fmt: skip


class AS7341:
    """A simulated AS7341, a light sensor with six ADCs; its power is switched on at time 0.

    `light` has ``collect``, ``outside`` and ``switch``, see the module docstring.
    """

    address = 0x39

    def __init__(self, light, noise: ChipNoise, rng, quirks: Quirks | None = None):
        self._light = light
        self._converter = Converter(noise, rng)
        self._quirks = quirks = quirks or Quirks()
        self._step_us = STEP_US * (1 + quirks.clock_error_percent / 100)
        self._now = 0.0
        self.samples = 0
        self.integrating_us = 0.0
        self.power_on(0.0)

    def power_on(self, now_us: float) -> None:
        """Reset all registers at the time `now_us`, as at power-on."""
        self._now = self._on_since = max(now_us, self._now)
        self._main = bytearray(256)
        for register, value in _RESET_VALUES.items():
            self._main[register] = value
        self._bank1 = bytearray(256)
        self._bank1[0x74] = 0x04
        self._smux_ram = bytearray(20)
        self._converter.route(self._smux_ram)
        self._pointer = 0
        self._smux_done = None
        self._zeroed = False
        self._start = None  # start of the running integration, in us
        self._end_us = math.inf  # its end; infinite while no integration runs
        self._part_start = 0.0  # time up to which its light is collected, in us
        self._collected: dict[str, float] = {}  # counts at gain 1x, by diode
        self._cycle = 0
        self._live = (0, bytes(12))  # ASTATUS and counts of the last sample
        self._latched = self._live
        self._first = False  # whether the running sample is the first one since SP_EN was set
        self._outside = 0  # consecutive samples outside the thresholds
        self._fifo = Fifo()
        self._flicker_since = None
        self._auto_gain = None  # code of the automatic gain; None before its first sample

    # I2C transfers. A controller calls advance(now) first, so that time never decreases.

    def answers(self) -> bool:
        """Return whether the chip acknowledges its I2C address now."""
        return self._now - self._on_since >= POWER_ON_US

    def write(self, data: bytes) -> None:
        """Handle a write transfer: the address of the first register, then the register values."""
        if not data:
            return
        self._pointer = data[0]
        for value in data[1:]:
            self._set(self._pointer, value)
            self._pointer = (self._pointer + 1) & 0xFF

    def read(self, size: int, byte_us: float = 0.0) -> bytes:
        """Handle a read transfer: return the bytes from the register pointer on.

        The chip stores a sample that ends during a transfer at once: if a transfer finds the FIFO
        empty, its last bytes may be of such a sample. Therefore it needs the duration of a byte.
        """
        data = bytearray()
        began_us = self._now
        while len(data) < size:
            pointer = self._pointer
            if 0x95 <= pointer <= 0xA0 and not self._bank1_selected():  # counts, read most often
                counts = self._latched[1][pointer - 0x95 :][: size - len(data)]
                data += counts
                self._pointer = pointer + len(counts)
                continue
            if data and pointer == 0xFE and not self._fifo:
                self.advance(began_us + byte_us * len(data))
            if self._fifo and pointer == 0xFE and size - len(data) > 1 and not self._main[0xA9]:
                entries = size - len(data) >> 1  # both bytes of each entry
                data += self._fifo.take(entries)
            else:
                data.append(self._get(pointer))
                # A transfer of any length reads the FIFO from its last two registers.
                if pointer != 0xFD or not self._quirks.fifo_level_alone:
                    self._pointer = 0xFE if pointer == 0xFF else pointer + 1
        return bytes(data)

    def advance(self, now_us: float) -> None:
        """Simulate the chip up to the time `now_us`."""
        if now_us > self._now:
            self._now = now_us
        else:
            now_us = self._now
        if self._smux_done is not None and now_us >= self._smux_done:
            self._smux_done = None
            self._run_smux()
        while now_us >= self._end_us:
            self._complete(self._end_us)

    def switch_light(self, on: bool) -> None:
        """Switch an LED that is wired to a pin of the board, by calling ``light.switch(on)``."""
        self._collect(self._now)
        self._light.switch(on)

    def temperature_C(self, now_us: float) -> float:
        """Return the temperature beside the chip."""
        return self._light.temperature_C(now_us)

    # Registers.

    def _bank1_selected(self) -> bool:
        return bool(self._main[0xA9] & 0x10)

    def _get(self, register: int) -> int:
        if register >= 0x80:
            if self._bank1_selected() and register != 0xA9:
                return 0
            if register == 0x94:
                return self._latch()
            if 0x95 <= register <= 0xA0:
                return self._latched[1][register - 0x95]
            if register in _COMPUTED:
                return _COMPUTED[register](self)
            return self._main[register]
        if register < 0x14:
            return self._smux_ram[register]
        if 0x60 <= register <= 0x74 and self._bank1_selected():
            return self._get_bank1(register)
        return 0

    def _get_bank1(self, register: int) -> int:
        if register == 0x60:
            return self._latch()
        if register in (0x61, 0x62):
            return self._latched[1][register - 0x61]
        if 0x63 <= register <= 0x65:
            return self._steps() >> (8 * (register - 0x63)) & 0xFF
        if register <= 0x6F:
            return self._latched[1][2 + register - 0x66]
        return self._bank1[register]

    def _latch(self) -> int:
        self._latched = self._live
        if self._quirks.avalid_clears_on_read:
            self._main[0xA3] &= ~0x40
        return self._latched[0]

    def _set(self, register: int, value: int) -> None:
        if register < 0x14:
            self._smux_ram[register] = value
        elif 0x60 <= register <= 0x74:
            if self._bank1_selected() and register >= 0x70:
                before_mA = self._led_mA()
                self._bank1[register] = value
                if register == 0x70:
                    self._run_or_stop()
                # Collect only if the light changes, so that noise does not depend on other writes.
                if self._led_mA() != before_mA:
                    self._collect(self._now, before_mA)
        elif register == 0xA9:
            self._main[register] = value
        elif register < 0x80 or self._bank1_selected() or register in _READ_ONLY:
            return
        elif register == 0x93:
            self._main[register] &= ~value
        elif register == 0x80:
            self._set_enable(value)
        elif register == 0xFA:
            if value & 0x02:
                self._fifo = Fifo()
                self._main[0xA7] &= ~0x80
            if value & 0x01 and self._main[0xA7] & 0x02:
                self._main[0xA7] &= ~0x02
                self._run_or_stop()
        else:
            self._main[register] = value
            if register in (0xAA, 0xB1):
                self._auto_gain = None
            if register in _EXPOSURE and self._start is not None:
                self._end_us = self._end()

    def _set_enable(self, value: int) -> None:
        before = self._main[0x80]
        self._main[0x80] = value
        if not value & 0x01:
            self._zeroed = False
        if value & 0x12 == 0x12:
            self._main[0x80] &= ~0x10  # refused while the chip samples
        elif value & 0x10 and not before & 0x10:
            self._smux_done = self._now + self._quirks.smux_us
        if not value & 0x40:
            self._flicker_since = None
        elif self._flicker_since is None:
            self._flicker_since = self._now
        self._run_or_stop()

    def _run_or_stop(self) -> None:
        # In the modes SYNS and SYND, a sample waits for an edge at the pin GPIO, which has none.
        # After an interrupt with the bit SAI, the chip sleeps until SAI_ACT is cleared.
        running = (
            self._main[0x80] & 0x03 == 0x03
            and not self._bank1[0x70] & 0x03
            and not self._main[0xA7] & 0x02
        )
        if running and self._start is None:
            self._first = True
            self._begin(self._now + self._auto_zero_at_start())
        elif not running and self._start is not None:
            self._collect(self._now)
            self.integrating_us += max(0.0, self._now - self._start)
            self._start = None
            self._end_us = math.inf

    def _run_smux(self) -> None:
        self._main[0x80] &= ~0x10
        command = self._main[0xAF] >> 3 & 3
        if command == 2:
            self._converter.route(self._smux_ram)

    # Integration.

    def _steps(self) -> int:
        astep = self._main[0xCA] | self._main[0xCB] << 8
        return (self._main[0x81] + 1) * (astep + 1)

    def _full_scale(self) -> int:
        return min(65535, self._steps())

    def _auto_zero_at_start(self) -> float:
        wanted = self._main[0xD6] != 0
        if wanted and (self._quirks.auto_zero_at_every_start or not self._zeroed):
            self._zeroed = True
            return AUTO_ZERO_US
        return 0.0

    def _begin(self, start_us: float) -> None:
        self._start = self._part_start = start_us
        self._end_us = self._end()
        self._collected = {}
        self._main[0xA3] &= ~0x40

    def _end(self) -> float:
        return self._start + self._steps() * self._step_us

    def _led_mA(self) -> float:
        on = self._bank1[0x70] & 0x08 and self._bank1[0x74] & 0x80
        return 4.0 + 2.0 * (self._bank1[0x74] & 0x7F) if on else 0.0

    def _collect(self, until_us: float, led_mA: float | None = None) -> None:
        if self._start is None or until_us <= self._part_start:
            return
        lit_mA = self._led_mA() if led_mA is None else led_mA
        part = self._light.collect(self._part_start, until_us, lit_mA)
        if before := self._collected:
            part = before | {diode: before.get(diode, 0.0) + n for diode, n in part.items()}
        self._collected = part
        self._part_start = until_us

    def _complete(self, end_us: float) -> None:
        self._collect(end_us)
        full_scale = self._full_scale()
        counts, overloaded = self._converter.convert(
            self._collected, self._gain(), end_us - self._start, full_scale
        )
        if self._main[0x80] & 0x40:  # the flicker detector uses the last ADC
            counts[5] = 0
        saturation = (0x10 if max(counts) >= full_scale else 0) | (0x08 if overloaded else 0)
        self._live = ((0x80 if saturation else 0) | self._gain(), _SIX.pack(*counts))
        self._set_gain(counts)
        self._main[0xA3] = 0x40 | saturation
        if saturation:
            self._main[0x93] |= 0x80
        if self._first:  # these are the counts for a driver that never reads ASTATUS
            self._latched = self._live
            self._first = False
        if self._persists(counts) and (
            self._main[0xF9] & 0x08 or not self._quirks.aint_needs_sp_ien
        ):
            self._main[0x93] |= 0x08
        self._push(counts)
        if self._main[0xAC] & 0x10 and self._main[0x93] & self._main[0xF9] & 0x08:
            self._main[0xA7] |= 0x02
        self.samples += 1
        self.integrating_us += end_us - self._start
        self._cycle += 1
        every = self._main[0xD6]
        pause = AUTO_ZERO_US if 0 < every < 255 and self._cycle % every == 0 else 0.0
        if self._main[0x80] & 0x08:
            pause += (self._main[0x83] + 1) * WAIT_US * (16 if self._main[0xA9] & 0x04 else 1)
        if self._main[0xA9] & 0x20:
            pause += LOW_POWER_US
        if self._main[0xA7] & 0x02:
            self._start = None
            self._end_us = math.inf
            return
        self._start = self._part_start = end_us + pause
        self._end_us = self._end()
        self._collected = {}

    def _gain(self) -> int:
        """Return the code of the gain in use: that of CFG1, or the automatic one."""
        gain = self._main[0xAA] & 0x1F if self._auto_gain is None else self._auto_gain
        return min(gain, 10)

    def _set_gain(self, counts: list[int]) -> None:
        """Set the automatic gain (SP_AGC) for the next sample by the counts of this one."""
        if not self._main[0xB1] & 0x04:
            self._auto_gain = None
            return
        gain = self._gain()
        eighths = 8 * counts[min(self._main[0xB5] & 7, 5)] / self._full_scale()
        if eighths > _AGC_HIGH[self._main[0xB3] >> 6]:
            gain -= 1
        elif eighths < _AGC_LOW[self._main[0xB3] >> 4 & 3]:
            gain += 1
        self._auto_gain = max(0, min(gain, self._main[0xCF] & 0x0F))

    def _persists(self, counts: list[int]) -> bool:
        count = counts[min(self._main[0xB5] & 7, 5)]
        low, high = struct.unpack_from("<2H", self._main, 0x84)
        self._outside = 0 if low <= count <= high else self._outside + 1
        least = _PERSISTENCE[self._main[0xBD] & 0xF]
        return least == 0 or self._outside >= least

    def _push(self, counts: list[int]) -> None:
        """Append to the FIFO the values that FIFO_MAP selects from ASTATUS and the six counts.

        With the bit FIFO_WRITE_FD, the FIFO is for the flicker detector, whose data this simulation
        does not contain.
        """
        if self._main[0xD7] & 0x80:
            return
        wanted = self._main[0xFC]
        values = _SEVEN.pack(self._live[0], *counts)
        entries = [values[2 * i : 2 * i + 2] for i in range(7) if wanted & 1 << i]
        if self._quirks.fifo_reversed:
            entries.reverse()
        if self._fifo.push(entries, self._quirks.fifo_overwrites):
            self._main[0xA7] |= 0x80
        if self._main[0xF9] & 0x04 and len(self._fifo) >= _FIFO_LEVELS[self._main[0xB1] >> 6]:
            self._main[0x93] |= 0x04


# Registers whose values are computed at each read.
_COMPUTED = {
    0xDB: lambda chip: flicker_status(chip._light, chip._flicker_since, chip._now),
    0xFD: lambda chip: len(chip._fifo),
    0xFE: lambda chip: chip._fifo.low(),
    0xFF: lambda chip: chip._fifo.high(),
}
