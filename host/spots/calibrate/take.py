"""Taking a press: watch the readings until it is held, and judge it."""

from __future__ import annotations

import numpy as np

from ..errors import SpotsError
from .presses import Noise, Presses
from .session import Wanted
from .spectra import Reading, SpectrumReader

_TRIES = 5
_WINDOW_S = 0.24
_MARK_S = 1.5
_WINDOW_MIN = 8  # samples
_DRIFT_MAX = 0.01  # log2: 0.7 % of the light
_TREMBLE_MAX = 6.0  # times the variance that the noise explains
_SIGMAS = 5.0
_OUTLIER = 0.3  # log2, that the light may differ from what the neighbours suggest
_VARIANCE_MIN = 0.25  # counts**2, of a sample, where the noise is not known yet


class BadPressError(Exception):
    """A press is not taken; the text gives the reason."""


class Taker:
    """Takes presses, one at a time.

    Parameters
    ----------
    reader : SpectrumReader
    presser : presser.Presser
    guide : guide.Guide

    Attributes
    ----------
    noise : Noise or None
        Noise of the sensor; None until it is known.
    given_up : str
        What is left of the session after too many bad presses.
    """

    given_up = "presses taken so far are stored; the same command continues"

    def __init__(self, reader: SpectrumReader, presser, guide):
        self.reader = reader
        self.noise: Noise | None = None
        self._presser = presser
        self._guide = guide

    @property
    def window(self) -> int:
        """How many samples make a reading."""
        return max(_WINDOW_MIN, round(_WINDOW_S * 1e6 / self.reader.info["exposure_us"]))

    @property
    def mark_samples(self) -> int:
        """How many samples make the reading of a mark, whose noise shifts whole tables."""
        return max(self.window, round(_MARK_S * 1e6 / self.reader.info["exposure_us"]))

    def take(self, wanted: Wanted, judge=lambda reading: None, as_it_is=False) -> Reading:
        """Have a press made and return its reading; it is still held then.

        Parameters
        ----------
        wanted : Wanted
        judge : callable
            Raises `BadPressError` if the reading does not fit the press.
        as_it_is : bool
            Whether a reading with channels that are saturated or dark will do.

        Returns
        -------
        Reading

        Raises
        ------
        SpotsError
            If every attempt was bad.
        """
        for _ in range(_TRIES):
            self._presser.press(wanted)
            try:
                reading = self._held(as_it_is)
                if wanted.kind == "mark":
                    reading = self._held_longer()
                judge(reading)
                return reading
            except BadPressError as bad:
                trouble = f"{wanted}: {bad}"
            self._guide.say(f"{trouble}; press again")
            if wanted.angle_deg is None:  # the indenter of a joint stays on the strip
                self.release()
        raise SpotsError(f"{trouble}; {self.given_up}")

    def release(self) -> None:
        """Wait until nothing is pressed.

        Raises
        ------
        SpotsError
            If it stays pressed.
        """
        peak = self.reader.read(2).counts.max()
        self._presser.release()
        end_s = self.reader.board.now_s() + self._presser.patience_s
        while self.reader.board.now_s() < end_s:
            now = self.reader.read(2).counts.max()
            if now < max(1.0, peak / 2):
                return
        raise SpotsError("the strip stays bright though nothing should press it: shade the sensor")

    def _held(self, as_it_is: bool) -> Reading:
        end_s = self.reader.board.now_s() + self._presser.patience_s
        trouble, steady = "no press is seen", 0
        while self.reader.board.now_s() < end_s:
            reading = self.reader.read(self.window)
            now = self._unsteady(reading)
            trouble = now or trouble
            steady = 0 if now else steady + 1
            self._guide.watch(reading, now, steady / self._presser.steady)
            if steady < self._presser.steady:
                continue
            if reading.saturated and not as_it_is:
                raise BadPressError(
                    "a channel is saturated: press less, or lower gain or LED current"
                )
            if reading.dark and not as_it_is:
                raise BadPressError(
                    "too dark: press harder, or raise gain, LED current or exposure"
                )
            return reading
        raise BadPressError(trouble)

    def _held_longer(self) -> Reading:
        reading = self.reader.read(self.mark_samples)
        trouble = self._unsteady(reading)
        if trouble:
            raise BadPressError(trouble)
        return reading

    def _unsteady(self, reading: Reading) -> str | None:
        if (reading.counts < 1).all():
            return "no press is seen"
        if self.noise is not None:
            counts = np.maximum(reading.counts, 0)
            expected = self.noise.constant + self.noise.per_count * counts
        else:
            expected = np.maximum(reading.variance, _VARIANCE_MIN)
        total = max(reading.counts.sum(), 1.0)
        sigma = np.sqrt(4 * expected.sum() / self.window) / total / np.log(2)
        if abs(reading.drift) > _DRIFT_MAX + _SIGMAS * sigma:
            return "the light changes: hold still"
        if not reading.saturated and np.mean(reading.variance / expected) > _TREMBLE_MAX:
            return "the colour trembles: hold still"
        return None


def judge_place(known: Presses, place_um: float, counts: np.ndarray, noise: Noise, window: int):
    """Judge a press among others along the strip, all with one force.

    Parameters
    ----------
    known : Presses
        Those that were taken.
    place_um : float
    counts : numpy.ndarray, shape (6,)
    noise : Noise
    window : int
        Samples in a reading.

    Raises
    ------
    BadPressError
        If colour or brightness do not lie where the neighbours suggest.
    """
    if len(known.position_um) < 2:
        return
    places, logs = known.position_um, known.logs
    order = np.argsort(places)
    places, logs, log = places[order], logs[order], np.log2(counts)
    # From the first to the last place the colour goes this way, whatever the brightness does.
    way = logs[-1] - logs[0]
    way = way - way.mean()
    at = int(np.searchsorted(places, place_um))
    contrasts = np.insert(logs @ way, at, log @ way)
    sigma = np.sqrt(2 * noise.log_variance(counts) @ way**2 / window)
    if (np.diff(contrasts) < -_SIGMAS * sigma).any():
        raise BadPressError(
            "the colour does not lie between those of its neighbours, the response would not be "
            "monotone: check this place, and the last one"
        )
    near = np.sort(np.argsort(np.abs(places - place_um))[:2])
    if np.abs(places[near] - place_um).min() > 1.5 * np.ptp(places[near]):
        return
    line = np.polyfit(places[near] - place_um, logs[near].mean(axis=1), 1)
    if abs(log.mean() - line[1]) > _OUTLIER:
        raise BadPressError("the light is not what its neighbours suggest: press as hard as there")


def judge_force(known: Presses, force_mN: float, counts: np.ndarray, noise: Noise, window: int):
    """Judge a press among others at one place, all with other forces.

    Parameters
    ----------
    known : Presses
        Those that were taken.
    force_mN : float
        Force of the new press, in mN.
    counts : numpy.ndarray, shape (6,)
        Its dark-subtracted counts.
    noise : Noise
        Noise of the sensor.
    window : int
        Samples in a reading.

    Raises
    ------
    BadPressError
        If the light does not grow with the force.
    """
    forces = np.append(known.force_mN, force_mN)
    light = np.append(known.logs.mean(axis=1), np.log2(counts).mean())
    sigma = np.sqrt(2 * noise.log_variance(counts).sum() / window) / len(counts)
    if (np.diff(light[np.argsort(forces)]) < -_SIGMAS * sigma).any():
        raise BadPressError(
            "the light does not grow with the force: check this force, and the last one"
        )
