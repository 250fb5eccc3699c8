"""Driver of the light sensor AS7341, which samples without gaps.

The samples arrive by one of two paths: `fifo`, or `registers` if the chip's FIFO does not work. A
real chip must show which one is needed; the other module can then be deleted.

Section numbers refer to the ams datasheet DS000504 v3-00. Every wait has a deadline. On
MicroPython, `poll`, `switch_led` and `read_into` allocate nothing.

The bus is an object with three methods. ``read_into(address, register, buffer)`` reads registers of
the chip at an I2C address. ``write(buffer)`` writes registers of the sensor; the first byte of the
buffer is the number of the first register. Both raise OSError if the chip does not answer.
``recover()`` tries to free the wires after an OSError.
"""

from array import array
from errno import EIO

from .. import const
from ..runtime.common import ADDRESS
from . import chip as c
from . import exposure
from .burst import unpack
from .fifo import Fifo
from .pacing import Pacing
from .registers import Registers
from .smux import CHANNELS, smux_map

_CONFIG = const(0x70)  # bank 1
_GPIO = const(0x73)  # bank 1
_LED = const(0x74)  # bank 1
_ENABLE = const(0x80)
_ATIME = const(0x81)
_ID = const(0x92)
_STATUS2 = const(0xA3)
_CFG0 = const(0xA9)
_CFG1 = const(0xAA)
_CFG3 = const(0xAC)
_CFG6 = const(0xAF)
_CFG8 = const(0xB1)
_PERS = const(0xBD)
_ASTEP = const(0xCA)
_AZ_CONFIG = const(0xD6)
_FD_CFG0 = const(0xD7)
_INTENAB = const(0xF9)
_FIFO_MAP = const(0xFC)

_PON = const(0x01)
_SP_EN = const(0x02)
_SMUXEN = const(0x10)
_ASAT = const(0x80)
_BANK_1 = const(0x10)
_LED_SEL = const(0x08)
_LED_ON = const(0x80)
_SMUX_WRITE = const(0x10)
_CLEAR_SAI_ACT = const(0x01)
_SIX_COUNTS = const(0x7E)

# A reset of the board does not reset the chip, so another program may have left any value in any
# register. `start` writes all registers that can change the time or the counts of a sample.
_SET_UP = (
    (_CFG3, 0x0C),  # no sleep after an interrupt (SAI)
    (_CFG8, 0x80),  # no automatic gain (SP_AGC, FD_AGC)
    (_PERS, 0),  # AINT at every sample
    (_AZ_CONFIG, 0xFF),  # auto-zero only before the first sample
    (_FD_CFG0, 0x21),  # no data of the flicker detector in the FIFO
    (_INTENAB, c.AINT),
    (_FIFO_MAP, _SIX_COUNTS),
    (c.CONTROL, c.FIFO_CLR | _CLEAR_SAI_ACT),
    (_CFG6, _SMUX_WRITE),
)

_POWER_UP_US = const(5_000)
_SMUX_US = const(5_000)
_AUTO_ZERO_US = const(50_000)
_STEP_US = const(2)  # largest error: a little more than half of the exposure's step of 2.78 us
# Time from `start` to the first integration. It is longer than the set-up by any driver at 400 kHz,
# so that recordings do not depend on the driver.
_START_US = const(20_000)
_AGAIN_US = const(500)  # wait after a failed transfer
# First registers of the pairs of registers that `check` reads back.
_CHECKED = (_ENABLE, _CFG0, _ASTEP)
_WRITTEN_ENABLE, _WRITTEN_ATIME = range(2)  # indices of the values written to these registers


class SensorError(Exception):
    """Raised if the sensor is absent, is another chip, lost its settings, or stopped sampling."""


class AS7341:
    """One AS7341 that samples six diodes without a gap, on a bus as in the module docstring.

    A runtime with its own driver of the chip overrides `_configure` and `_light`. Such a runtime
    still uses this class to write the SMUX map and to read the samples. The path in use, see
    `registers.Registers.read`, reads samples into `burst`; `at` is the place of the next one of
    the `waits` that `poll` has not returned yet, `step_us` the time between two of them except the
    newest. `asked` and `known` are the ticks before and after the first transfer of this read.
    """

    def __init__(self, bus, clock):
        self.bus = bus
        self._clock = clock
        self.ticks_us = clock.ticks_us
        self.ticks_diff = clock.ticks_diff
        self._add = clock.ticks_add
        self._pair = bytearray(2)
        self._byte = bytearray(1)
        self.burst = bytearray(c.BURST_SIZE)
        self.asked = self.known = self.at = self.step_us = 0
        self.waits = 0
        self._first = self._path = Fifo(self, Registers(self))
        self._led_code = 0
        self.led = "ldr"  # one of `light.LEDS`
        self.gpio = None  # set by the runtime: ``gpio(on)`` switches the LED by its pin
        # Set by the runtime, if the board can measure it: ``thermometer()`` returns the temperature
        # of the board in units of 0.001 degrees Celsius.
        self.thermometer = None
        self._check = 0
        self._settled = 0
        self.pacing = Pacing(clock)
        self.counts = array("i", bytes(4 * CHANNELS))
        self.saturated = False
        self.steady = False
        self.complete = 0
        self.gain = 0
        self.plan = ()
        self.exposure_us = 0
        self.full_scale = 0
        self.led_mA = 0
        self.led_on = False
        self.retries = 0  # failed transfers while sampling; each was repeated

    def start(self, plan, gain, exposure_us, led_mA, mains_hz=0):
        """Identify the chip, set it up and start sampling; call it again after an error.

        `plan` names six diodes for ADC 0 to 5, see `smux.PIXELS`; `gain` is the code of CFG1, 0 to
        10 for 0.5x to 512x; `led_mA` is 0, or 4 to 258. With the `mains_hz` of flickering lamps,
        `pacing` corrects the error of the chip's oscillator, a few per cent; with 0, the attribute
        `exposure_us` becomes the nearest value that the chip allows. SensorError if no AS7341
        answers, or a register does not contain the written value; OSError if a transfer fails.
        """
        began = self.ticks_us()
        self._identify()
        image = smux_map(plan)
        pacing = self.pacing
        pacing.learn()
        atime, astep = exposure.registers(
            pacing.nominal_us(exposure_us) if mains_hz else exposure_us
        )
        self.write(_ENABLE, _PON)  # SP_EN off: the chip may have been running
        self._write_bank_1(_CONFIG, _LED_SEL)  # samples follow each other, without sync (SPM)
        self._write_bank_1(_GPIO, 0)  # no photodiode at a pin
        self._configure(atime, astep, gain, led_mA)
        for register, value in _SET_UP:
            self.write(register, value)
        self.bus.write(b"\x00" + image)
        self.write(_ENABLE, _PON | _SMUXEN)
        self._clock.sleep_us(_SMUX_US)
        self.plan = tuple(plan)
        self.gain = gain
        chip_us = exposure.actual_us(atime, astep)
        self.exposure_us = exposure_us if mains_hz else chip_us
        self.full_scale = exposure.full_scale(atime, astep)
        self.led_mA = led_mA
        self._written = bytearray((_PON, atime, 0, gain, astep & 0xFF, astep >> 8))
        for _ in _CHECKED:
            self.check()  # this also checks that the SMUX command is complete
        self._written[_WRITTEN_ENABLE] = _PON | _SP_EN
        if self.led != "ldr":
            self._light(False)  # the breakout's own LED, which may have been on
        self.switch_led(True)
        left_us = _START_US - self.ticks_diff(self.ticks_us(), began)
        if left_us > 0:
            self._clock.sleep_us(left_us)
        self.write(c.STATUS, c.AINT)
        self.write(_ENABLE, _PON | _SP_EN)
        self.waits = self.known = self.at = 0
        self.follow(self._first)
        self.complete = now = self.ticks_us()
        self._settled = self._add(now, -self.exposure_us)  # the LED is on already
        pacing.start(now, chip_us)

    def drifted(self):
        """Return whether the measured exposure differs too much from the attribute `exposure_us`.

        The limit is 0.7 of the exposure's smallest step, because rounding to steps alone causes
        errors up to 0.5 of it. The next `start` with `mains_hz` corrects the exposure. Allocates
        nothing if the result is False.
        """
        pacing = self.pacing
        expected_us = pacing.sampled * self.exposure_us
        step_us = pacing.sampled * _STEP_US * (self._written[_WRITTEN_ATIME] + 1)
        return not pacing.lasted_us - step_us <= expected_us <= pacing.longest_us + step_us

    def stop(self):
        """Stop sampling and switch the LED off."""
        self.switch_led(False)
        self.write(_ENABLE, _PON)

    def follow(self, path):
        """Read the samples by a path from the next poll on, see `registers.Registers`."""
        self._path = path
        self.read = path.start()

    def switch_led(self, on):
        """Switch the LED on or off.

        The attribute `steady` is False for samples that began before this call.

        With the setting ``led=always``, the user must unplug the LED or plug it in again. This
        call then only records the state of the LED.
        """
        if self.led == "ldr":
            on = on and self.led_mA > 0
            self._light(on)
        elif self.led == "gpio":
            self.gpio(on)
        self.led_on = on
        self.steady = False
        self._settled = self.ticks_us()

    def poll(self):
        """Fetch a new sample; return whether there is one. Allocates nothing.

        One transfer can read several samples. This call returns the oldest sample, and the next
        calls return the following ones, in the attributes `counts`, `saturated`, `steady` and
        `complete` (ticks at the end of the integration). SensorError if no sample arrived for two
        exposures plus the duration of the chip's auto-zero, or if the chip samples more slowly than
        its exposure allows; OSError if all transfers failed during this time.
        """
        waits = self.waits
        if not waits:
            self.asked = self.ticks_us()
            try:
                waits = self.read()
            except OSError:
                self._fail()
                if self._is_overdue():
                    raise
                return False
            if waits < 1:
                return False if waits else self._wait()
        elif waits > 1:
            self.complete = self._add(self.complete, self.step_us)
        else:
            self.complete = self.pacing.held(self.asked, self.known, 1)
        self.waits = waits - 1
        self.saturated = unpack(self.burst, self.counts, self.at) >= self.full_scale
        if self.burst[c.ASTATUS_AT] >= _ASAT:
            self.saturated = True
        self.at += c.SAMPLE_SIZE
        if not self.steady:
            self._settle()
        return True

    def read_byte(self, register):
        self._byte[0] = c.UNREAD
        self.bus.read_into(ADDRESS, register, self._byte)
        if self._byte[0] == c.UNREAD:
            raise OSError(EIO)
        return self._byte[0]

    def _fail(self):
        self._path.fail()
        self.recover()
        if not self._is_overdue():
            self.retries += 1
            self._clock.sleep_us(_AGAIN_US)

    def _wait(self):
        if self._is_overdue():
            raise SensorError("the AS7341 stopped sampling; check its supply and wiring")
        pacing = self.pacing
        if pacing.is_slow():
            raise SensorError(
                "the AS7341 samples every %d us instead of every %d us; check its supply and wiring"
                % (pacing.lasted_us // pacing.sampled, pacing.exposure_us)
            )
        pacing.early(self.asked)
        return False

    def _settle(self):
        # Not called after `steady` is True: ticks wrap, so that old ticks compare wrongly.
        # The sample began at most `longest_us` before its end: the oscillator may be 1/16 slow.
        longest_us = (self.exposure_us * 17 >> 4) + self.pacing.slack_us
        self.steady = self.ticks_diff(self.complete, self._settled) >= longest_us

    def check(self):
        """Check that two registers of the chip still contain the written values, else SensorError.

        Each call checks the next two registers; three calls check all six. The check is necessary
        because I2C has no checksum, and because a chip can lose its register values.
        """
        i = self._check
        self._check = (i + 1) % len(_CHECKED)
        self._pair[0] = ~self._written[2 * i] & 0xFF
        self.bus.read_into(ADDRESS, _CHECKED[i], self._pair)
        if self._pair[0] != self._written[2 * i] or self._pair[1] != self._written[2 * i + 1]:
            raise SensorError("the AS7341 has lost its settings; check its supply and wiring")

    def recover(self):
        """Free the wires of the bus after a failed transfer; a runtime can override this method."""
        self.bus.recover()

    def saturation(self):
        """Return the saturation of the last sample (STATUS2): 'analog', 'digital' or None."""
        status = self.read_byte(_STATUS2)
        return "analog" if status & 0x08 else "digital" if status & 0x10 else None

    def report(self, reply):
        """Add counters and state of this sensor to a reply to ``get`` (dict); no bus transfer."""
        reply["missed"] = self.pacing.missed
        reply["retries"] = self.retries
        reply["fifo"] = self._path.fifo
        reply["full_scale"] = self.full_scale

    def _is_overdue(self):
        longest_us = 2 * self.exposure_us + _AUTO_ZERO_US
        return self.ticks_diff(self.asked, self.complete) > longest_us

    def _configure(self, atime, astep, gain, led_mA):
        """Write exposure (registers `atime` and `astep`), gain code and LED current to the chip.

        Called while the chip is powered and does not sample.
        """
        self.write(_ATIME, atime)
        self.bus.write(bytes((_ASTEP, astep & 0xFF, astep >> 8)))
        self.write(_CFG1, gain)
        self._led_code = exposure.led_code(led_mA)

    def _light(self, on):
        """Switch the chip's LED driver on or off."""
        self._write_bank_1(_CONFIG, _LED_SEL)
        self._write_bank_1(_LED, self._led_code | (_LED_ON if on else 0))

    def _identify(self):
        try:
            self._ask_id()
        except OSError:
            # The chip does not answer for about 200 us after power-up (section 8.2). A third
            # attempt is left to the caller, because each failure allocates an exception.
            self._clock.sleep_us(_POWER_UP_US)
            try:
                self._ask_id()
            except OSError:
                self.recover()
                raise SensorError("no chip answers at 0x39; check wiring and supply")
        if self._byte[0] >> 2 != 9:
            raise SensorError(
                "the chip at 0x39 is not an AS7341 (ID 0x%02x): check the breakout" % self._byte[0]
            )

    def _ask_id(self):
        self.write(_CFG0, 0)  # a failed transfer may have left bank 1 selected
        self.read_byte(_ID)

    def _write_bank_1(self, register, value):
        self.write(_CFG0, _BANK_1)
        try:
            self.write(register, value)
        finally:
            self.write(_CFG0, 0)

    def write(self, register, value):
        self._pair[0] = register
        self._pair[1] = value
        self.bus.write(self._pair)
