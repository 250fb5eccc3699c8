"""Computes the readings of a strip again from its spectra, by the arithmetic of the board.

The firmware of the board runs here, in portable Python. Only the switching of the LED is not
decided again: it is that of the recording.
"""

import struct
from array import array
from collections.abc import Iterator, Sequence
from enum import IntEnum
from types import SimpleNamespace
from typing import Any, NamedTuple

from spots_device.board.settings import checksum
from spots_device.reading import decode as d
from spots_device.reading import snapshot
from spots_device.reading import strip as of_board
from spots_device.reading.calibration import CalibrationSlot
from spots_device.sensor.smux import CHANNELS

STATE = snapshot.KIND
_PER_WINDOW = 4
_UNKNOWN_MC = -(1 << 20)


class State(IntEnum):
    """Single values at the beginning of a STATE frame, in the order of `snapshot.Snapshot`."""

    STEP = 0
    LIT_FLAGS = 1
    TARE_WANTED = 2
    GAIN = 3
    LED_MA = 4
    STRAIN_PPM = 5
    HEAT_MC = 6
    FINGERS = 7
    COUNT = 8
    CHANGING = 9
    LAST = 10
    EVERY = 11
    COUNTED = 12
    LEFT = 13
    LAMP = 14
    MOVED = 15
    CONTRADICTED = 16
    SINCE = 17
    X_UM = 18
    FORCE = 19


SINGLE = len(State)
_PARTS = 3  # of `decode.Decode.state` that follow
INDICES = (
    *range(d.COARSE_SUM),
    *range(d.SUMS, d.FOUND),
    *range(d.STICK, d.BEYOND),
)
_WORD = {at: SINGLE + i for i, at in enumerate(INDICES)}
# Words that belong to the light without the LED, and not to a calibration.
_OF_LIGHT = (*range(d.DARK, d.DARK + CHANNELS), d.AGE_US, d.EVERY_US, d.AGE_STEP_US, d.IDLE_MIN_US)


# End of a sentence of the board about its settings, which a recording cannot change.
_SET_THIS = "; set this, or calibrate again"


def _calibrate_at(made: of_board.Conditions) -> str:
    return (
        f", the recording at gain={made.gain} led_mA={made.led_mA} "
        f"channels={','.join(made.plan)}: set these, and calibrate with --keep-settings"
    )


class Values(NamedTuple):
    """What a reading contains besides its header; all 0 but the flags if it is unknown."""

    flags: int
    contrast_q20: int = 0
    brightness_q20: int = 0
    position_um: int = 0
    force_mN: int = 0


class _Sensor:
    """In place of the driver of the sensor: the samples of the recording."""

    full_scale = 1 << 16
    thermometer = None

    def __init__(self):
        self.pacing = SimpleNamespace(missed=0)
        self.counts = array("i", bytes(4 * CHANNELS))
        self.saturated = False
        self.steady = self.led_on = True
        self.complete = self.gain = self.led_mA = self.exposure_us = 0
        self.plan: tuple[str, ...] = ()

    def switch_led(self, on: bool) -> None:
        self.led_on = on

    def check(self) -> None:
        pass


class _Strip(of_board.Strip):
    """A strip whose LED is switched by the recording."""

    _forced = False

    def force(self, samples: int) -> None:
        """Begin a series of dark samples."""
        self._forced = True
        self._start_blink(self.sensor)
        self._forced = False
        self._dark._left = samples

    def _start_blink(self, sensor: Any) -> None:
        if self._forced:
            super()._start_blink(sensor)

    def _warm(self) -> None:
        pass  # STATE frames contain the temperature

    def load(self, words: Sequence[int], own: bool) -> None:
        """Use the state of a STATE frame, or only that of the light (`own` false)."""
        state, dark, baseline, ambient = self._reading, self._dark, self.baseline, self._ambient
        self._state, self.lit_flags = words[State.STEP], words[State.LIT_FLAGS]
        self.sensor.led_on = True
        dark.count, dark.changing, dark._last = (
            words[State.COUNT],
            words[State.CHANGING],
            words[State.LAST],
        )
        dark._every, dark._exposure_us = words[State.EVERY], words[_WORD[d.AGE_STEP_US]]
        ambient._total = words[State.LAMP]
        arrays = snapshot.arrays(self)
        for at in INDICES if own else _OF_LIGHT:
            state[at] = words[_WORD[at]]
        state[d.STREAMED] = 0
        at = SINGLE + len(INDICES)
        dark_only = (dark.window, ambient._lamp)
        for one in arrays[_PARTS:]:
            if own or any(one is other for other in dark_only):
                part = words[at : at + len(one)]
                for i, value in enumerate(part):
                    one[i] = value
            at += len(one)
        if own:
            self._tare_wanted = bool(words[State.TARE_WANTED])
            baseline._count, baseline.left = words[State.COUNTED], words[State.LEFT]
            ambient._moved = words[State.MOVED]
            ambient._is_contradicted = bool(words[State.CONTRADICTED])
            silicone = self.decode.compensation
            if silicone:
                silicone._t, silicone._x_um = words[State.SINCE], words[State.X_UM]
                silicone._force = words[State.FORCE]
        else:
            baseline.update()
        self._choose()


class Sample(NamedTuple):
    """A spectrum of a recording; `t_us` is the time of its reading."""

    t_us: int
    flags: int
    counts: tuple[int, ...]


class ReplayedStrip:
    """Computes the readings of one strip of a recording again.

    `uid` is the id of the strip, `plan` the channels of its ADCs. The lines of the calibration are
    empty without one; `own` is whether the board uses it. `name` is its checksum. `why_not` is why
    it cannot be used at the present settings of the board, None if it can. `why_unknown` is why the
    readings after the last STATE frame cannot be computed; empty if they can.
    """

    def __init__(self, uid: str | None, plan: Sequence[str], lines: Sequence[str], own: bool):
        self._uid, self.own, self.name = uid, own, checksum(lines)
        self._sensor = _Sensor()
        self._sensor.plan = tuple(plan)
        self._slot = CalibrationSlot()
        self._slot.use(list(lines))
        self._clock = SimpleNamespace(ticks_us=lambda: 0, ticks_diff=lambda one, other: one - other)
        self._new_strip()
        self._key: object = None
        self._series: list[Sample] = []
        self.why_not: str | None = None
        self.why_unknown = ""
        self.is_known = False

    def _new_strip(self) -> None:
        head = array("i", bytes(4 * d.HEAD_SIZE))
        time = SimpleNamespace(head=head, last=0, ticks=self._ticks)
        framer = SimpleNamespace(send=None, payload=None, encoded=None)
        outputs = SimpleNamespace(active=False, streams_contacts=False)
        settings = SimpleNamespace(values={})
        self._head = head
        self._strip = _Strip(
            0, self._uid, self._sensor, framer, time, self._clock, settings, outputs
        )
        self._strip._mains_hz = self._strip._missed = 0

    def _ticks(self) -> int:
        return self._head[d.TIME_HIGH] << 6 | self._head[d.TIME_LOW] >> 10

    @property
    def plan(self) -> tuple[str, ...]:
        """Channels of the ADCs."""
        return self._sensor.plan

    @plan.setter
    def plan(self, plan: Sequence[str]) -> None:
        self._sensor.plan = tuple(plan)

    def lose(self) -> Iterator[Values]:
        """Frames are missing, or the recording ends: nothing is known until the next state."""
        if self._series:
            self._strip.force(len(self._series))
        for one in self._series:
            yield self._process(one, steady=False)  # without light, its values are known
        self._series.clear()
        self.is_known = False

    def load(self, body: bytes) -> Iterator[Values]:
        """Take the content of a STATE frame."""
        yield from self._end_series()
        words = struct.unpack(f"<{len(body) // 4}i", body)
        sensor, strip = self._sensor, self._strip
        self.why_unknown = _why_unknown(words)
        if self.why_unknown:
            self.is_known = False
            return
        sensor.gain, sensor.led_mA = words[State.GAIN], words[State.LED_MA]
        sensor.exposure_us = words[_WORD[d.EXPOSURE_US]]
        conditions = of_board.Conditions(
            self._uid, self.plan, sensor.gain, sensor.exposure_us, sensor.led_mA
        )
        key = conditions, words[State.STRAIN_PPM]
        begins = key != self._key or not self.is_known
        found = strip.decode.calibration
        if begins:
            self._key = key
            found, self.why_not = self._slot.choose(*key)
            if self.why_not:
                self.why_not = self.why_not.replace(_SET_THIS, _calibrate_at(conditions))
            if not words[State.LIT_FLAGS]:
                found = None
            strip.conditions = conditions
            if not self.own:
                strip.load(words, True)
                strip._baseline_of = self  # the baseline restarts
                strip._tare_wanted = False
                for at in (d.DRIFT, d.SLOPE, d.SEEN, d.LEARNS, d.FRESH, d.TOUCHED, d.LEVEL):
                    strip._reading[at] = 0
                strip._reading[d.ODD_US] = 0
            strip.use_calibration(found)
            if found is not None and found.compensation is not None and not self.own:
                silicone = found.compensation
                silicone._t = silicone._x_um = silicone._force = 0
                for i in range(len(silicone._state)):
                    silicone._state[i] = 0
        if found is not None and found.thermal is not None and words[State.HEAT_MC] != _UNKNOWN_MC:
            found.thermal.follow(words[State.HEAT_MC])
        strip.load(words, self.own)
        self.is_known = True

    def take(self, sample: Sample) -> Iterator[Values]:
        """Take the next spectrum; yield the values of readings, in order, as soon as known."""
        kind = sample.flags & (d.LED_OFF | d.DARK_SUBTRACTED)
        if not self.is_known:
            yield unknown(sample.flags)
        elif kind == d.LED_OFF and self._strip.lit_flags:
            self._series.append(sample)
        else:
            yield from self._end_series()
            yield self._process(sample, steady=not kind & d.LED_OFF)

    def _end_series(self) -> Iterator[Values]:
        # The first one or two samples of a series began before the LED was off. So the length of
        # the series shows how many were dark: one, or a multiple of four.
        if not self._series:
            return
        count = len(self._series)
        dark = 1 if count < _PER_WINDOW else count - count % _PER_WINDOW
        self._strip.force(dark)
        for i, one in enumerate(self._series):
            yield self._process(one, steady=i >= count - dark)
        self._series.clear()

    def _process(self, sample: Sample, steady: bool) -> Values:
        sensor, head, strip = self._sensor, self._head, self._strip
        for i, count in enumerate(sample.counts):
            sensor.counts[i] = count
        sensor.steady = steady
        sensor.saturated = bool(sample.flags & d.SATURATED)
        head[d.TIME_LOW], head[d.TIME_HIGH] = sample.t_us & 0xFFFF, sample.t_us >> 16
        head[d.LESS_US] = sensor.exposure_us >> 1
        strip.take()
        state = strip._reading
        return Values(
            state[d.FLAGS],
            state[d.CONTRAST],
            state[d.BRIGHTNESS],
            state[d.POSITION_UM],
            state[d.FORCE_MN],
        )


def unknown(flags: int) -> Values:
    """Return the values of a reading that is unknown, from the flags of its spectrum."""
    return Values(flags & (d.SATURATED | d.DARK_SUBTRACTED | d.LED_OFF) | d.NOT_CALIBRATED)


def _why_unknown(words: Sequence[int]) -> str:
    if words[_WORD[d.AVERAGE]] != 1:
        return "the counts are rounded means of several samples: record with average=1"
    if words[State.FINGERS]:
        return "keys or contacts were on: record with keys=0, and without the stream of contacts"
    return ""
