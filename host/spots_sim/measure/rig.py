"""A simulated and calibrated strip that returns readings of known presses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from spots.calibrate.fit.fit import fit
from spots.calibrate.fit.presses import Noise
from spots.calibrate.fit.shift import shifted
from spots.calibrate.session import baseline
from spots.link.connect import upload
from spots.link.frames import Spectrum, Touch
from spots_device.reading.dark import _DARK_EVERY_US, _WINDOW_SAMPLES, _WINDOWS
from spots_device.reading.decode import DARK_SAMPLES, LED_OFF

from ..person.kept import kept
from ..person.loading import silicone_lines
from ..person.stage import Stage, check_light, led_settings
from ..strip.change import NONE
from ..strip.files import SensorFile

_DARK_TIMEOUT_S = 60.0
_SILICONE_US = 100_000  # longest exposure for the loads that calibrate the silicone
_REQUEST_US = 2_000_000  # duration of a dark frame on request


class Rig:
    """A calibrated strip on a simulated stage (`stage.Stage`). Use it in a ``with`` statement.

    `average` is the number of samples in a reading. With `compensated`, the board compensates
    hysteresis and creep, if the sensor file has them. `along` has the presses of the calibration at
    positions along the whole strip, by strain in ppm; `noise` is estimated from them. `lines` is
    the text of the original calibration, without the corrections of `shift`.
    """

    def __init__(
        self,
        sensor: SensorFile,
        seed: int,
        exposure_us: int,
        average: int,
        compensated: bool = True,
    ):
        self._silicone: tuple[str, ...] = ()
        if compensated and not sensor.silicone.ideal:
            self._silicone = _silicone(sensor.unchanged(), min(exposure_us, _SILICONE_US))
        self.stage = Stage(sensor, seed, f"exposure_us={exposure_us}")
        self.board = self.stage.board
        self.average = average
        self._shift = None
        try:
            self.stage.expose(exposure_us)
            self._baseline = baseline.line(self.stage.reader.baseline)
            self.along = {0: self.stage.along()}
            self._pressed = self.stage.pressed()
            self.noise = Noise.of(self.along[0], self._pressed)
            self._use()
        except BaseException:
            self.board.close()
            raise

    def __enter__(self) -> Rig:
        return self

    def __exit__(self, *exception) -> None:
        self.board.close()

    @property
    def conditions(self):
        """Board and settings for which the calibration is valid."""
        return self.stage.reader.conditions

    @property
    def shifted_lines(self) -> tuple[str, ...]:
        """Text lines of the calibration on the board, with the corrections of `shift`."""
        return tuple(shifted(self.lines, *self._shift)) if self._shift else self.lines

    @property
    def reading_us(self) -> int:
        """Duration of one reading in us."""
        return self.conditions.exposure_us * self.average

    def learn_strains(self, percents) -> None:
        """Calibrate at further strains of the strip: `percents`, a sequence of int in per cent."""
        self.board.command("set average=1")
        # The strip as it was calibrated at rest: unchanged, and pressed by the indenter.
        changed, self.stage.held.changed = self.stage.held.changed, NONE
        by_hand, self.stage.by_hand = self.stage.by_hand, False
        for percent in percents:
            self.stage.held.strain = percent / 100
            self.stage.release()
            self.stage.reader.set_up(untouched=True)
            self.along[10_000 * percent] = self.stage.along()
        self.stage.held.strain = 0.0
        self.stage.held.changed, self.stage.by_hand = changed, by_hand
        self._use()

    def shift(self, place_um: Sequence[float], shifts: ArrayLike) -> None:
        """Correct the calibration on the board as a re-zero does; see `spots.calibrate.fit.shift`.

        `shifts` has shape (n, 6) in units of log2: n marks, six channels.
        """
        self._shift = place_um, shifts
        self._send()

    def set_average(self, average: int) -> None:
        """Set the number of samples that the board averages in a reading."""
        self.board.command(f"set average={average}")
        self.average = average

    def _use(self) -> None:
        check_light(self.along[0], self._pressed)
        fitted = fit(self.along, self._pressed, self.noise, self.conditions)
        self.use((*fitted, *self._baseline, *self._silicone))

    def use(self, lines) -> None:
        """Use another calibration of this strip: `lines`, a sequence of str."""
        self.lines = tuple(lines)
        self._send()

    def _send(self) -> None:
        upload(self.board, self.shifted_lines)
        self.board.command(f"set average={self.average}")
        self._dark = np.array(self._dark_frame()) / DARK_SAMPLES
        self.board.command("stream touch spectrum")

    def _dark_frame(self) -> list[int]:
        """Take a dark frame; return each channel's sum of `DARK_SAMPLES` samples without light.

        The board averages the dark frame over as many samples as it can, to reduce the noise.
        """
        exposure_us = self.conditions.exposure_us
        self.stage.release()
        self.board.command("dark", timeout_s=_DARK_TIMEOUT_S)
        missing = _WINDOWS - min(_WINDOWS, _REQUEST_US // (_WINDOW_SAMPLES * exposure_us))
        for _ in range(missing):
            self.settle()
        return self.board.command("get")["dark"]

    def readings(self, position_um: float, force_mN: float, count: int):
        """Press the strip; return readings whose integration lies completely within the press.

        The counts, shape (count, 6), are dark-subtracted means over the samples of each reading,
        rounded by the board.
        """
        self.stage.press(position_um, force_mN)
        return self._held(count)

    def lift(self, seconds: float) -> None:
        """Lift the indenter, and wait for this time in seconds of the board."""
        self.stage.release()
        for _ in self.board.frames(seconds):
            pass

    def settle(self) -> None:
        """Lift the indenter, and wait until the board has measured the light without a press."""
        self.lift(1.2e-6 * max(_DARK_EVERY_US, 100 * self.conditions.exposure_us))

    def turned(self, angle_deg: float, direction: int, count: int):
        """Turn the joint whose indenter presses the strip; return readings as `readings` does.

        `direction` is 1 if the angle is reached from below, -1 if from above.
        """
        self.stage.turn(angle_deg, direction)
        return self._held(count)

    def _held(self, count: int):
        begun_s = self.board.now_s() + 0.5e-6 * self.reading_us
        touches, spectra = [], []
        for frame in self.board.frames():
            if frame.time_s < begun_s or frame.flags & LED_OFF:
                continue
            if isinstance(frame, Touch):
                touches.append(frame)
            elif isinstance(frame, Spectrum):
                spectra.append(frame.counts)
                if len(spectra) == count:
                    break
        return touches[:count], np.array(spectra, dtype=float) - self._dark


@kept(tuple[str, ...])
def _silicone(sensor: SensorFile, exposure_us: int) -> tuple[str, ...]:
    with Rig(sensor, 0, exposure_us, 1, compensated=False) as rig:
        lines = rig.lines
    return silicone_lines(sensor, lines, led_settings(sensor))
