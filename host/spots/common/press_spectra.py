"""The spectra of presses along the strip: lines ``spectrum`` and ``tint`` of a calibration."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, cast

import numpy as np
from numpy.polynomial import Chebyshev, chebyshev, polynomial

from spots_device.sensor.smux import CHANNELS

_PLACES = 16  # places along the strip; a polynomial through them is a smooth curve
_ONE_Q16 = 1 << 16
_ONE_Q20 = 1 << 20
_NAME, _TINT = "spectrum", "tint"
_TEMPERATURE, _WARM = "temperature", "warm"
# Positions and brightnesses of the lines ``tint``. A polynomial through them is the change that
# `calibrate.fit.cross` has fitted.
_TINT_PLACES, _TINT_LIGHTS = 3, 6


class PressSpectra:
    """Smooth curves of log2 of the counts of a firm press along the strip, one for each channel.

    The lines of a calibration, see `spots_device.reading.calibration_lines`, must have at least two
    lines ``spectrum``. `plan` names the six channels; `ends_um` are the first and the last
    position.

    >>> made = statements((0, 85_000), lambda x_um: x_um[:, None] * [1e-4] * 6)
    >>> PressSpectra(["plan F3 F4 F5 F6 F7 F8", *made]).logs(42_500).round(2).tolist()
    [4.25, 4.25, 4.25, 4.25, 4.25, 4.25]
    """

    def __init__(self, lines: Sequence[str]):
        words = [line.split() for line in lines]
        self.plan = next(tuple(row[1:]) for row in words if row[:1] == ["plan"])
        rows = np.array([row[1:] for row in words if row[:1] == [_NAME]], float)
        place_um, logs = rows[:, 0], rows[:, 1:] / _ONE_Q16
        self.ends_um = float(place_um.min()), float(place_um.max())
        self._curves: list[Any] = [
            Chebyshev.fit(place_um, log, len(place_um) - 1) for log in logs.T
        ]
        self._slopes: list[Any] = [curve.deriv() for curve in self._curves]
        tints = np.array([row[1:] for row in words if row[:1] == [_TINT]], float)
        self._tint = None
        if len(tints) == _TINT_PLACES * _TINT_LIGHTS:
            x_um, light, change = tints[:, 0], tints[:, 1] / _ONE_Q16, tints[:, 2:] / _ONE_Q16
            self._lights = float(light.min()), float(light.max())
            self._tint = np.linalg.solve(self._polynomials(x_um, light), change)

        self._warm = None
        ranges = [row[1:] for row in words if row[:1] == [_TEMPERATURE]]
        warm = np.array([row[1:] for row in words if row[:1] == [_WARM]], float)
        if ranges and len(warm):
            made, low, high = map(float, ranges[0])
            self._shares = (low - made) / (high - low), (high - made) / (high - low)
            change = warm[:, 1:] / _ONE_Q20
            self._warm = polynomial.polyfit(warm[:, 0], change, len(warm) - 1)

    def logs(self, x_um: float | np.ndarray) -> np.ndarray:
        """Return log2 of the counts at positions `x_um`; shape (..., 6)."""
        return self._at(self._curves, x_um)

    def slopes(self, x_um: float | np.ndarray) -> np.ndarray:
        """Return the derivatives of log2 of the counts in 1/um at positions `x_um`; (..., 6)."""
        return self._at(self._slopes, x_um)

    def changes(self, x_um: np.ndarray, light: np.ndarray) -> np.ndarray:
        """Return the changes of log2 of the counts with the force, for n presses; shape (n, 6).

        `light` is the brightness in log2 units, minus that of a firm press.
        """
        if self._tint is None:
            return np.zeros((len(x_um), CHANNELS))
        return self._polynomials(x_um, light.clip(*self._lights)) @ self._tint

    def warmed(
        self, x_um: float, residual: np.ndarray, variance: np.ndarray, channels: list[int]
    ) -> np.ndarray:
        """Return the part of a residual that a known change with the temperature explains.

        The board shifts its tables with the temperature, so this part is no error. The residual is
        log2 of the counts minus the expected ones, for the given indices of channels, shape (n,).
        """
        if self._warm is None:
            return np.zeros(len(channels))
        change = np.asarray(polynomial.polyval(x_um, self._warm))[channels]
        # Another force or position is not a change of the temperature.
        causes = np.stack([change, self.slopes(x_um)[channels], np.ones(len(channels))], axis=1)
        weights = 1 / np.sqrt(variance)
        found = np.linalg.lstsq(causes * weights[:, None], residual * weights, rcond=None)[0]
        return change * np.clip(found[0], *self._shares)

    def _polynomials(self, x_um: np.ndarray, light: np.ndarray) -> np.ndarray:
        share = 2 * (x_um - self.ends_um[0]) / np.ptp(self.ends_um) - 1
        places = _powers(share, _TINT_PLACES)
        lights = _powers(_share(light, self._lights), _TINT_LIGHTS)
        return np.einsum("na,nb->nab", places, lights).reshape(len(x_um), -1)

    def _at(self, curves: list[Any], x_um: float | np.ndarray) -> np.ndarray:
        x_um = np.clip(x_um, *self.ends_um)
        return np.stack([curve(x_um) for curve in curves], axis=-1)


def press_spectra(lines: Sequence[str] | None) -> PressSpectra | None:
    """Return the spectra of the presses of a calibration; None if its lines do not contain them."""
    if lines is None or sum(line.startswith(_NAME + " ") for line in lines) < 2:
        return None
    return PressSpectra(lines)


def without(lines: Iterable[str]) -> list[str]:
    """Return the lines of a calibration without those that only the host uses."""
    return [line for line in lines if line.split(" ")[0] not in (_NAME, _TINT)]


def _powers(share: np.ndarray, count: int) -> np.ndarray:
    """Return Chebyshev polynomials of the degrees 0 to count - 1; shape (n, count)."""
    return np.asarray(cast(Any, chebyshev).chebvander(share, count - 1))


def statements(ends_um: Sequence[float], logs: Callable[[np.ndarray], np.ndarray]) -> list[str]:
    """Return the lines ``spectrum`` of a calibration.

    ``logs(x_um)`` returns log2 of the counts of firm presses at n positions, shape (n, 6).
    """
    low, high = ends_um
    place_um = np.round(low + (high - low) * (1 + chebyshev.chebpts2(_PLACES)) / 2)
    rows = np.column_stack([place_um, np.round(logs(place_um) * _ONE_Q16)])
    return [" ".join([_NAME, *(str(int(value)) for value in row)]) for row in rows]


def tint_statements(
    ends_um: Sequence[float],
    lights: tuple[float, float],
    logs: Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> list[str]:
    """Return the lines ``tint`` of a calibration.

    `lights` are least and largest brightness, see `PressSpectra.changes`; ``logs(x_um, light)``
    returns the changes of n presses, shape (n, 6).
    """
    places = np.linspace(ends_um[0], ends_um[1], _TINT_PLACES)
    nodes = (1 + chebyshev.chebpts2(_TINT_LIGHTS)) / 2
    low, high = np.exp2(np.array(lights) / 2)
    knots = 2 * np.log2(low + nodes * (high - low))
    x_um, light = np.repeat(places, _TINT_LIGHTS), np.tile(knots, _TINT_PLACES)
    rows = np.column_stack([x_um, light * _ONE_Q16, logs(x_um, light) * _ONE_Q16]).round()
    return [" ".join([_TINT, *(str(int(value)) for value in row)]) for row in rows]


def _share(light: np.ndarray, lights: tuple[float, float]) -> np.ndarray:
    """Return the square root of the light, scaled from -1 to 1 between both ends of `lights`."""
    low, high = np.exp2(np.array(lights) / 2)
    return 2 * (np.exp2(light / 2) - low) / (high - low) - 1


def shifted(words: list[Any], change: np.ndarray) -> None:
    """Add a change of log2 of the six counts to the numbers of a line ``spectrum``, in place."""
    for channel in range(CHANNELS):
        words[1 + channel] += round(float(change[channel]) * _ONE_Q16)
