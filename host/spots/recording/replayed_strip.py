"""Computes the readings of a strip again from its spectra, by the arithmetic of the board.

A spectrum has the counts, what the board has subtracted from them, and the temperature. So contrast
and brightness follow from one spectrum and the calibration, and so does the position. What follows
from the spectra before is computed from them: whether a finger touches, the drift, and the force of
a strip whose silicone creeps.
"""

from array import array
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, NamedTuple

import msgspec

from spots_device.reading import decode, frame, lone
from spots_device.reading.calibration import CalibrationSlot, Conditions
from spots_device.reading.dark import Baseline, Dark
from spots_device.reading.kernel import process
from spots_device.sensor.smux import CHANNELS

from ..link.frames import Spectrum

_FLOOR_SAMPLES = 64  # of `Spectrum.taken_off_q6`
_Q12_SHIFT = 6  # from 1/64 count to Q12
# Flags that belong to the counts.
_KNOWN = decode.SATURATED | decode.DARK_SUBTRACTED | decode.LED_OFF
_TICK_SHIFT = 10  # from us to ticks of 1.024 ms
_NO_TABLES = array("i", bytes(4))

# End of a sentence of the board about its settings, which a recording cannot change.
_SET_THIS = "; set this, or calibrate again"
_NO_DARK = "no dark frame was subtracted: record again after 'spots command dark'"
_AVERAGE = "the counts are rounded means of several samples: record with average=1"


class _Settings(msgspec.Struct, frozen=True):
    """What the board reports in replies, and on which readings depend."""

    id: str = ""
    channels: tuple[str, ...] = ()
    gain: int = 0
    exposure_us: Annotated[int, msgspec.Meta(gt=0)] = 1
    led_mA: int = 0
    led: str = ""
    strain_ppm: int = 0
    average: int = 1

    def after(self, reply: Mapping[str, Any]) -> "_Settings":
        """Return the settings after a reply; the same ones if the reply is invalid."""
        try:
            return msgspec.convert({**msgspec.structs.asdict(self), **reply}, _Settings)
        except msgspec.ValidationError:
            return self


def _calibrate_at(made: Conditions) -> str:
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


class ReplayedStrip:
    """Computes the readings of one strip of a recording again.

    `info` is the reply to ``hello``, `lines` the calibration. `why_not` is why it cannot be used at
    the present settings of the board, None if it can.
    """

    def __init__(self, info: Mapping[str, Any], lines: Sequence[str]):
        self._settings = _Settings()
        self._slot = CalibrationSlot()
        self._slot.use(list(lines))
        self._decode = decode.Decode()
        self._state = state = self._decode.state
        state[decode.AVERAGE] = 1
        self._decode.scale(1, _FLOOR_SAMPLES)
        self._baseline = Baseline(Dark(state))
        self._baseline.rescale(1)
        self._counts = array("i", bytes(4 * CHANNELS))
        head = array("i", bytes(4 * decode.HEAD_SIZE))
        self._work = [state, _NO_TABLES, self._counts, head, None, None, self._use]
        self._spectrum: Spectrum | None = None
        self._is_dark = False
        self._conditions: object = None
        self.why_not: str | None = None
        self.configure(info)

    def configure(self, reply: Mapping[str, Any]) -> None:
        """Take a reply of the board: settings, or the result of an upload."""
        before, self._settings = self._settings, self._settings.after(reply)
        if self._settings == before and reply.get("re") in ("hello", "get"):
            return
        s = self._settings
        conditions = Conditions(s.id, s.channels, s.gain, s.exposure_us, s.led_mA)
        found, self.why_not = self._slot.choose(conditions, s.strain_ppm)
        if self.why_not:
            self.why_not = self.why_not.replace(_SET_THIS, _calibrate_at(conditions))
        if s.average != 1:
            found, self.why_not = None, _AVERAGE
        self._decode.calibration = found
        if conditions != self._conditions:
            self._conditions = conditions
            self._baseline.unstick()
        self._state[decode.EXPOSURE_US] = s.exposure_us
        self._state[decode.AGE_STEP_US] = 0 if s.led == "always" else s.exposure_us

    def take(self, spectrum: Spectrum) -> Values:
        """Return the values of a reading."""
        state, tables, flags = self._state, self._decode.tables, spectrum.flags & _KNOWN
        if flags & decode.LED_OFF:
            self._is_dark = True
        else:
            if self._is_dark:  # as after a dark window
                self._is_dark = False
                state[decode.LEVEL] = state[decode.ODD_US] = 0
            if not flags & decode.DARK_SUBTRACTED:
                tables = _NO_TABLES
                self.why_not = self.why_not or _NO_DARK
            self._take_off(spectrum)
        self._spectrum = spectrum
        self._counts[:] = array("i", spectrum.counts)
        self._work[decode.TABLES] = tables
        process(self._work, flags)
        if spectrum.context & frame.CHANGING and not flags & decode.LED_OFF:
            lone.ignore(state)
        return Values(*state[: decode.FORCE_MN + 1])

    def _take_off(self, spectrum: Spectrum) -> None:
        state, made = self._state, self._decode.calibration
        floor = spectrum.taken_off_q6
        if made is not None:
            if made.thermal is not None and spectrum.temperature_mC != frame.UNKNOWN_MC:
                made.thermal.follow(spectrum.temperature_mC)
            if made.baseline and spectrum.flags & decode.NOT_CALIBRATED:
                # Without a calibration, the board has subtracted no baseline.
                ratio = state[decode.EXPOSURE_US] / made.conditions.exposure_us
                floor = [one + int(rest * ratio) for one, rest in zip(floor, made.baseline)]
        sticks = state[decode.STUCK] >= decode.STUCK_LEAST
        for i, one in enumerate(floor):
            state[decode.FLOOR + i] = one
            # The light that sticks is computed again, to see when a touch ends.
            state[decode.DARK + i] = (one << _Q12_SHIFT) - (
                state[decode.STICK + i] if sticks else 0
            )

    def _use(self) -> bool:
        state, spectrum = self._state, self._spectrum
        assert spectrum
        silicone = self._decode.compensation
        if silicone is not None:
            silicone.take(state, spectrum.t_us >> _TICK_SHIFT)
        flags = state[decode.FLAGS]
        # As `outputs.Outputs.take`.
        if spectrum.context & frame.TWO and flags & decode.TOUCHING and not flags & decode.MISFIT:
            state[decode.FLAGS] = flags | decode.FITS_WITH_DRIFT
        return False


def unknown(flags: int) -> Values:
    """Return the values of a reading that is unknown, from the flags of its touch."""
    return Values(flags & _KNOWN | decode.NOT_CALIBRATED)
