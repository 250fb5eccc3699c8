"""Notices a drift that moves positions, from the mean spectra of many presses.

The spectrum of one reading is noisy: only its flags show a large drift. Here, readings of one press
are averaged, and a sequential test (CUSUM) adds up the evidence of all presses. The estimated error
of the position of each press, in um, is compared with its standard deviation.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

import numpy as np

from spots_device.reading import decode
from spots_device.sensor.smux import CHANNELS

from ..common.press_spectra import PressSpectra, press_spectra
from ..link.frames import Spectrum, Touch
from . import drift_model
from .run_length import MOST, threshold

WRONG_UM = 500.0  # positions that are wrong by more than this are reported
# A false alarm comes once in a week of typing: 200 presses a minute (40 words), day and night.
PRESSES_A_WEEK = 200.0 * 60 * 24 * 7
_READINGS_MIN = 4  # of a press, without its first and last ones
_EDGE = 2  # readings at the beginning and at the end of a press: its force changes fast
_READINGS_MAX = 64  # a longer press counts as several presses
_JUMP_UM = 2000.0  # a jump between two readings is another finger
_NET_MIN = 20.0  # counts; a channel with less light is mostly noise
# Noise of a sample in counts**2: rounding, read noise, and the share of the count that is noise.
_READ_VARIANCE, _SHARE_NOISE = 0.1, 1e-4
# The light of the untouched strip has a rounding error of about this size, in counts.
_FLOOR_ERROR = 0.1
_UNCERTAIN_UM = 150.0  # standard deviation of the errors of a calibration by hand
# Two fingers with changing forces change the estimates of one press more than noise does: by so
# many standard deviations of the variance. The usual variance is the median of so many presses.
_UNSTEADY, _SCATTERS = 5.0, 15
_MEAN_PRESSES = 10  # the reported error is a mean over about so many presses
# The untouched strip: readings in the mean, and readings after a touch that are left out, because
# the guides may stick together for a moment.
_FLOOR_READINGS, _FLOOR_MIN, _AFTER, _BEFORE = 256, 32, 20, 3
_LIGHT_READINGS = 200  # over which changes of the ambient light are measured
_DARK_VARIANCE = 0.3  # counts**2; largest variance of a channel without a change of the light
_DARKS = 20  # samples with the LED off, over which such changes are measured
_MOVING_COUNTS = 12.0  # standard deviation of the sum of all channels while the light changes
_GRID = 60  # positions for which the changes of the spectrum are computed


_MISFITS = 4  # presses in a row whose readings are untrusted, before advice
_REZERO = "a re-zero is advised: spots rezero"


def cause_of(error_um: np.ndarray) -> str:
    """Return the probable cause of errors by group, such as `Notice.error_um`, in words."""
    return drift_model.GROUPS[int(np.argmax(np.abs(error_um[:-1])))]


class Floor:
    """Light of the untouched strip: ambient light, dark counts, and light without a press.

    `counts` are six means, None before enough readings without a touch. `changes` are the standard
    deviations of the changes of this light within some seconds. `moving` is whether the ambient
    light changes: contact that sticks changes `counts`, too, but no sample with the LED off.
    """

    def __init__(self, dark: Sequence[float] | None = None):
        self.counts = None if dark is None else np.array(dark)
        self.changes, self.moving = np.zeros(CHANNELS), False
        self._readings = 0
        self._since_touch = 0
        self._touch: Touch | None = None
        self._latest: list[np.ndarray] = []
        self._sum, self._recent = np.zeros(CHANNELS), np.zeros(CHANNELS)
        self._squares = np.zeros(CHANNELS)
        self._unlit = 0  # successive samples with the LED off; it was on in a part of the first one
        self._darks: deque[Sequence[int]] = deque(maxlen=_DARKS)

    def follow(self, frame: Touch | Spectrum) -> Touch | None:
        """Take a frame; return the touch of the same reading if `frame` is its spectrum."""
        if isinstance(frame, Touch):
            self._touch = frame
            return None
        self._follow_dark(frame)
        touch, self._touch = self._touch, None
        if touch is None or touch.t_us != frame.t_us or frame.flags & decode.LED_OFF:
            return None
        if touch.touching:
            # The latest readings may be of a finger that was not a touch yet.
            self._since_touch = 0
            self._latest.clear()
        elif not touch.force_mN > 0:
            self._since_touch += 1
            if self._since_touch > _AFTER:
                self._latest.append(np.array(frame.counts, float))
            if len(self._latest) > _BEFORE:
                self._add(self._latest.pop(0))
        return touch

    def _follow_dark(self, frame: Spectrum) -> None:
        is_off = frame.flags & (decode.LED_OFF | decode.DARK_SUBTRACTED) == decode.LED_OFF
        self._unlit = self._unlit + 1 if is_off else 0
        if self._unlit > 1:
            self._darks.append(frame.counts)
            variance = np.var(self._darks, axis=0)
            change = np.sqrt(np.maximum(variance - _DARK_VARIANCE, 0.0)).sum()
            self.moving = bool(change > _MOVING_COUNTS)

    def _add(self, counts: np.ndarray) -> None:
        self._readings += 1
        share = max(1 / self._readings, 1 / _FLOOR_READINGS)
        self._sum += share * (counts - self._sum)
        if self._readings >= _FLOOR_MIN:
            self.counts = self._sum
        share = max(1 / self._readings, 1 / _LIGHT_READINGS)
        step = counts - self._recent
        self._recent += share * step
        if self._readings > 1:
            self._squares += share * (step * step - self._squares)
        self.changes = np.sqrt(np.maximum(self._squares - _DARK_VARIANCE, 0.0))
        if not self._darks:  # the LED is always on
            self.moving = self._readings >= _FLOOR_MIN and self.changes.sum() > _MOVING_COUNTS


class Cusum:
    """Sequential test for a shift of a mean to both sides; `run_length` gives the threshold.

    If `alarm`, the evidence exceeds the threshold.
    """

    def __init__(self, wrong_um: float, presses: float):
        self.alarm = False
        self._shift_um, self._presses = 2 * wrong_um, presses
        self._up = self._down = 0.0
        self._shift = 1.0

    def take(self, value_um: float, sigma_um: float) -> None:
        """Take the value of a press, whose mean is 0 without a shift, and its deviation."""
        shift = self._shift_um / sigma_um
        self._shift += (shift - self._shift) / _MEAN_PRESSES
        most = threshold(self._shift, self._presses)
        z = value_um / sigma_um
        for name, side in (("_up", z), ("_down", -z)):
            added = min(shift * side - shift**2 / 2, MOST * most)
            setattr(self, name, min(max(0.0, getattr(self, name) + added), 2 * most))
        self.alarm = max(self._up, self._down) > most


class Notice:
    """Watches the presses of a strip for a drift since the calibration.

    `spectra` are those of presses at the calibration. The dark counts of each channel are used
    until readings without a touch arrive. An error of `wrong_um` is reported; a false alarm comes
    after a mean of `presses` presses. The attribute `presses` counts the presses so far.

    `error_um` are the mean estimated errors of the latest presses, by group of
    `drift_model.GROUPS`; the last element is the error by all causes.
    """

    def __init__(
        self,
        spectra: PressSpectra,
        average: int = 1,
        dark: Sequence[float] | None = None,
        wrong_um: float = WRONG_UM,
        presses: float = PRESSES_A_WEEK,
    ):
        self._spectra = spectra
        known = [i for i, name in enumerate(spectra.plan) if name in drift_model.BANDS_NM]
        known.sort(key=lambda i: drift_model.BANDS_NM[spectra.plan[i]][0])
        self._known = known
        self._plan = tuple(spectra.plan[i] for i in known)
        low, high = (spectra.logs(x)[known] for x in spectra.ends_um)
        self._decays = tuple(((low - high) / np.ptp(spectra.ends_um)).tolist())
        self._average, self._wrong_um = average, wrong_um
        count = len(drift_model.GROUPS) + 1
        self._test = Cusum(wrong_um, 2 * presses)  # half of the false alarms on each side
        self.error_um, self.wrong, self.presses = np.zeros(count), False, 0
        self.floor = Floor(dark)
        self._misfits = 0  # presses in a row whose readings are untrusted
        self._run: list[tuple[float, Sequence[int], int]] = []
        # Variances of the readings of the latest presses, relative to the expected ones.
        self._scatters: deque[float] = deque(maxlen=_SCATTERS)

    @property
    def sentence(self) -> str:
        """Advice for the user; empty if the strip is right, or while the ambient light changes."""
        if self.floor.moving:
            return ""
        cause = f"the probable cause is {cause_of(self.error_um)}; next: {_REZERO}"
        if self.wrong:
            error_mm = abs(float(self.error_um[-1])) / 1000
            return f"positions are probably wrong by {error_mm:.1f} mm: {cause}"
        # The errors of several causes may cancel, but each cause changes other places differently.
        # An LED that is still cold causes smaller errors.
        if self._misfits >= _MISFITS and np.abs(self.error_um).max() > self._wrong_um:
            return f"presses are untrusted, because they do not fit the calibration: {cause}"
        return ""

    def take(self, frame: Touch | Spectrum) -> None:
        """Take a frame of the strip; a spectrum belongs to the reading of the same time."""
        touch = self.floor.follow(frame)
        if touch is None or not isinstance(frame, Spectrum):
            return
        if not touch.touching:
            self._end()
            return
        run = self._run
        invalid = touch.flags & (decode.SATURATED | decode.NOT_CALIBRATED)
        jump = run and abs(run[-1][0] - touch.position_um) > _JUMP_UM
        if invalid or jump or touch.flags & decode.DROPPED or len(run) >= _READINGS_MAX:
            self._end()
        if not invalid:
            run.append((touch.position_um, frame.counts, touch.flags))

    def _end(self) -> None:
        """End a press: use the mean of its readings."""
        run = self._run[_EDGE : len(self._run) - _EDGE]
        self._run.clear()
        if len(run) < _READINGS_MIN or self.floor.counts is None or self.floor.moving:
            return
        place_um = np.array([one[0] for one in run])
        net = np.array([one[1] for one in run], float) - self.floor.counts
        lit = (net >= _NET_MIN).all(axis=1)
        if lit.sum() < _READINGS_MIN:
            return
        found = self.estimate(place_um[lit], net[lit])
        if found is None:
            return
        self._judge(*found)
        misfits = sum(bool(one[2] & decode.MISFIT) for one in run)
        self._misfits = self._misfits + 1 if 2 * misfits > len(run) else 0

    def estimate(
        self, place_um: np.ndarray, net: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the probable errors of the position of one press, and their standard deviations.

        `place_um` has the positions of two or more readings, `net` their counts minus those of the
        untouched strip, shape (n, 6). The errors are as in `error_um`. None instead of both if the
        readings differ more than noise explains.
        """
        known, spectra, count = self._known, self._spectra, len(net)
        residuals = np.log2(net) - spectra.logs(place_um)
        light = residuals @ net.mean(axis=0) / net.mean(axis=0).sum()
        residuals = (residuals - spectra.changes(place_um, light))[:, known]
        mean = net[:, known].mean(axis=0)
        per_log = 1 / (mean * math.log(2))
        variance = _READ_VARIANCE / self._average + (_SHARE_NOISE * mean) ** 2 + 1e-5 * mean
        variance = (variance + (self._average > 1) / 12) * per_log**2
        x_um = float(place_um.mean())
        residuals = residuals - spectra.warmed(x_um, residuals.mean(axis=0), variance, known)
        length_um = np.ptp(spectra.ends_um)
        grid_um = round(x_um / length_um * _GRID) / _GRID * length_um
        causes = drift_model.changes(self._plan, self._decays, grid_um)
        by = drift_model.weights(causes, spectra.slopes(x_um)[known], variance)
        each = residuals @ by.T
        noise = by**2 @ variance
        scatter = float(each[:, -1].var(ddof=1) / noise[-1])
        self._scatters.append(scatter)
        usual = max(1.0, median(self._scatters))
        if scatter > usual * (1 + _UNSTEADY * math.sqrt(2 / (count - 1))):
            return None
        noise = noise * usual / count + by**2 @ (_FLOOR_ERROR * per_log) ** 2
        noise += (by @ (self.floor.changes[known] * per_log)) ** 2  # light changes all channels
        return each.mean(axis=0), np.sqrt(noise + _UNCERTAIN_UM**2)

    def _judge(self, errors_um: np.ndarray, sigmas_um: np.ndarray) -> None:
        self.presses += 1
        share = max(1 / self.presses, 1 / _MEAN_PRESSES)
        self.error_um += share * (errors_um - self.error_um)
        self._test.take(float(errors_um[-1]), float(sigmas_um[-1]))
        if self._test.alarm:
            self.wrong = True
        elif self.wrong and abs(self.error_um[-1]) < self._wrong_um / 2:
            self.wrong = False


def notice_for(
    lines: Sequence[str] | None, settings: Mapping[str, Any], **options: Any
) -> Notice | None:
    """Return a `Notice` for a strip; None if its calibration has no spectra, or it is stretched.

    `lines` are the calibration on the board, if known; `settings` are from its reply to ``hello``
    or ``get``.
    """
    spectra = press_spectra(lines)
    if spectra is None or settings.get("strain_ppm"):
        return None
    if sum(name in drift_model.BANDS_NM for name in spectra.plan) < 4:
        return None
    return Notice(spectra, settings.get("average") or 1, **options)
