"""Judges the readings of a press: long enough, steady, bright enough, and where it should be."""

from __future__ import annotations

import numpy as np

from spots_device.reading.calibration import Conditions

from ..fit.points import Wanted, presses
from ..fit.presses import Noise, Presses
from .session_file import Session, point
from .spectra import Reading

_WINDOW_S = 0.24  # duration of a short reading
# Duration of a reading of a finger's press, by kind of press. It averages the finger's tremor.
_LONG_S = {"mark": 3.0, "hand": 0.75}
_WINDOW_MIN = 8  # samples
_DRIFT_MAX = 0.01  # largest change of the light in a short reading, in log2 units: 0.7 %
# The same limit for a finger, whose tremor looks like a slow drift in a short reading.
_FINGER_DRIFT_MAX = 0.05
_TREMBLE_MAX = 6.0  # largest ratio of the variance of a steady press to that of the noise
_SIGMAS = 5.0  # tolerance of noise in all checks, in standard deviations
_OUTLIER = 0.3  # log2: largest difference from the light expected from other presses
_VARIANCE_MIN = 0.25  # counts**2 of a sample; used while the noise is unknown
_NOISE_POINTS = 6  # least number of presses that show the noise of the sensor


class BadPressError(Exception):
    """Raised if a press is not valid; the message gives the reason."""


class TooDarkError(BadPressError):
    """Raised if no press is seen, or if a channel has less than one count during a press."""


def samples_of(kind: str, exposure_us: int) -> int:
    """Return how many samples a reading of a press of a `Wanted.kind` needs.

    The kind is empty for a short reading of about 0.24 s.
    """
    return max(_WINDOW_MIN, round(_LONG_S.get(kind, _WINDOW_S) * 1e6 / exposure_us))


class Judge:
    """Judges the readings of one press; each method raises `BadPressError` with the reason.

    A press is compared with the earlier ones of its session, if it has one. Presses by hand are
    not: the person reads their places off a ruler later, and the fit finds the outliers.
    """

    def __init__(self, wanted: Wanted, conditions: Conditions, session: Session | None):
        self._wanted, self._conditions = wanted, conditions
        self._session = None if wanted.kind == "hand" else session
        self._noise = _noise(self._session) if self._session else None
        self._window = samples_of("", conditions.exposure_us)

    def steady(self, reading: Reading) -> None:
        """Refuse a short reading that has light in no channel, or whose light changes.

        The brightness may change more for the kinds of presses of a finger, because it trembles.
        """
        if reading.unlit:
            raise TooDarkError("no press is seen")
        if self._noise is None:
            expected = np.maximum(reading.variance, _VARIANCE_MIN)
        else:
            expected = self._noise.variance(np.maximum(reading.counts, 0))
        total = max(reading.counts.sum(), 1.0)
        sigma = np.sqrt(4 * expected.sum() / self._window) / total / np.log(2)
        drift_max = _FINGER_DRIFT_MAX if self._wanted.kind in _LONG_S else _DRIFT_MAX
        if abs(reading.drift) > drift_max + _SIGMAS * sigma:
            raise BadPressError("the light changes: hold still")
        if not reading.saturated and np.mean(reading.variance / expected) > _TREMBLE_MAX:
            raise BadPressError("the colour fluctuates: hold still")

    def lit(self, reading: Reading) -> None:
        """Refuse a saturated or dark channel; the choice of channels takes them as they are."""
        if self._wanted.kind == "choose":
            return
        if reading.saturated:
            raise BadPressError(
                "a channel is saturated: press more gently, or lower gain or LED current"
            )
        if reading.dark:
            raise TooDarkError(
                "the press is too dark: press harder, or raise gain, LED current or exposure"
            )

    def fits(self, reading: Reading) -> None:
        """Refuse a press that does not fit the earlier ones with its force, or at its place."""
        wanted, session = self._wanted, self._session
        fits = _FITS.get(wanted.kind)
        known = session.of(wanted.kind, wanted.strain_ppm) if session else []
        if wanted.kind == "force":
            known = [p for p in known if p.place_um == wanted.place_um]
        if fits and session and len(known) > 1:
            others = presses(known)
            taken = session.referred(point(wanted, reading, self._conditions))
            noise = self._noise or Noise.of(others)
            fits(others, wanted, np.array(taken.counts), noise, self._window)


def _noise(session: Session) -> Noise | None:
    """Return the noise of the sensor, or None if there are too few presses to estimate it."""
    known = [p for p in session.points if p.kind != "choose"]
    if len(known) < _NOISE_POINTS:
        return None
    read = presses(known)
    found = Noise.of(read)
    # Few presses with one force do not separate the two parts of the noise. A constant part that
    # is too small would reject weak presses.
    return Noise(max(found.constant, float(np.median(read.variance))), found.per_count)


def _fits_place(known: Presses, wanted: Wanted, counts: np.ndarray, noise: Noise, window: int):
    """Check the light of a press against presses with the same force at other positions.

    There are at least two earlier presses. The counts are dark-subtracted means of `window`
    samples. BadPressError if colour or brightness does not fit the neighbouring presses.
    """
    order = np.argsort(known.position_um)
    places, logs, log = known.position_um[order], known.logs[order], np.log2(counts)
    # Change of the colour from the first place to the last: log2 of the counts minus their mean.
    way = logs[-1] - logs[0]
    way = way - way.mean()
    at = int(np.searchsorted(places, wanted.place_um))
    contrasts = np.insert(logs @ way, at, log @ way)
    sigma = np.sqrt(2 * noise.log_variance(counts) @ way**2 / window)
    if (np.diff(contrasts) < -_SIGMAS * sigma).any():
        raise BadPressError(
            "the colour does not fit the neighbouring presses: check the position of this press "
            "and of the previous one"
        )
    near = np.sort(np.argsort(np.abs(places - wanted.place_um))[:2])
    if np.abs(places[near] - wanted.place_um).min() > 1.5 * np.ptp(places[near]):
        return
    line = np.polyfit(places[near] - wanted.place_um, logs[near].mean(axis=1), 1)
    if abs(log.mean() - line[1]) > _OUTLIER:
        raise BadPressError(
            "the brightness does not fit the neighbouring presses: press all with the same force"
        )


def _fits_force(known: Presses, wanted: Wanted, counts: np.ndarray, noise: Noise, window: int):
    """Check the light of a press against presses with other forces at the same position.

    The arguments are those of `_fits_place`. BadPressError if the brightness does not increase with
    the force.
    """
    forces = np.append(known.force_mN, wanted.force_mN)
    light = np.append(known.logs.mean(axis=1), np.log2(counts).mean())
    sigma = np.sqrt(2 * noise.log_variance(counts).sum() / window) / len(counts)
    if (np.diff(light[np.argsort(forces)]) < -_SIGMAS * sigma).any():
        raise BadPressError(
            "the brightness does not increase with the force: check this force and the previous one"
        )


_FITS = {"position": _fits_place, "strain": _fits_place, "force": _fits_force}
