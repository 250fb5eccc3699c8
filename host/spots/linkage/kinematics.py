"""Kinematic calibration: a linkage's lengths and mounting, from places where its terminal was.

Robust least squares by scipy, the extra ``kinematics``; and which parameters the places determine.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np

from ..errors import SpotsError, missing
from .fivebar import Linkage, assembled

# What is unknown about each parameter beforehand: the scale in which parameters of different units
# are compared, and a weak pull towards the start that decides only what the places leave open.
_LENGTH_SHARE = 0.05
_RANGES = {
    "offset1_rad": 0.1,
    "offset2_rad": 0.1,
    "gain1": 0.05,
    "gain2": 0.05,
    "frame_x_mm": 20.0,
    "frame_y_mm": 20.0,
    "frame_rad": 0.1,
    "frame_scale": 0.05,
}
LENGTHS = ("bar1_mm", "bar2_mm", "bar3_mm", "bar4_mm", "base_mm")
MOUNTING = ("offset1_rad", "offset2_rad", "gain1", "gain2")
FRAME = ("frame_x_mm", "frame_y_mm", "frame_rad")
NAMES = LENGTHS + tuple(_RANGES)
STANDARD = LENGTHS + MOUNTING + FRAME
_ROBUST = 2.0  # standard errors, from which on a residual pulls less than its square
_OUTLIER = 5.0
_KNOWN = 0.5  # a direction is determined if the places leave less than this of its prior range
_NAMED = 0.3  # of the largest share, to be named with it
_ROUNDS = 4  # of weights, and outliers, that follow from the last fit
_NONSENSE = 0.02  # of a bar: a fit with larger residuals is refused


@dataclass(frozen=True)
class Kinematics:
    """What a kinematic calibration found, and how well.

    Attributes
    ----------
    names : tuple of str
        Of the free parameters.
    values, standard_errors : dict of str to float
        Of all parameters; the errors of the fixed ones are 0. Where something is not determined
        (`unidentified`), errors are what was unknown beforehand.
    assembly : str
    unidentified : tuple of tuple of str
        Groups of parameters that these places do not separate: give one of each group.
    rank : int
        How many independent combinations of the free parameters the places determine.
    condition : float
        Of the Jacobian, its columns scaled by what was unknown: largest over smallest singular
        value; infinite if the smallest is 0.
    residual_rms_mm, residual_max_mm : float
        Distances of the measured terminals from those of the fit, without the outliers.
    misfit : float
        Scatter of the residuals over what the given errors explain; about 1 if both are right.
    outliers : tuple of int
        Places that do not fit.
    """

    names: tuple[str, ...]
    values: dict[str, float]
    standard_errors: dict[str, float]
    assembly: str
    unidentified: tuple[tuple[str, ...], ...]
    rank: int
    condition: float
    residual_rms_mm: float
    residual_max_mm: float
    misfit: float
    outliers: tuple[int, ...]

    @property
    def linkage(self) -> Linkage:
        """The linkage, in the frame of its own base joints."""
        bars = [self.values[name] for name in LENGTHS[:4]]
        return Linkage(bars, self.values["base_mm"], self.assembly)

    @property
    def offset_rad(self) -> tuple[float, float]:
        """Of the two encoders, see `Encoder`."""
        return self.values["offset1_rad"], self.values["offset2_rad"]

    @property
    def gain(self) -> tuple[float, float]:
        """Of the two encoders."""
        return self.values["gain1"], self.values["gain2"]

    def terminal(self, angles_rad) -> tuple:
        """Return terminals in the frame of the measured places.

        Parameters
        ----------
        angles_rad : array_like, shape (2, ...)
            As the calibration was given them.

        Returns
        -------
        x_mm, y_mm : float or numpy.ma.MaskedArray
        """
        theta = [o + g * a for o, g, a in zip(self.offset_rad, self.gain, angles_rad)]
        return framed(self.values, *self.linkage.forward(*theta))

    def report(self) -> str:
        """Return all of it as text."""
        rows = []
        for name in NAMES:
            error = self.standard_errors[name]
            known = f"+- {error:.2g}" if name in self.names else "given"
            rows.append(f"{name:12} {self.values[name]:12.5f}  {known}")
        rows.append(
            f"residual {self.residual_rms_mm:.3f} mm rms, {self.residual_max_mm:.3f} mm at most; "
            f"{self.misfit:.2f} times what the errors explain; "
            f"rank {self.rank} of {len(self.names)}, condition {self.condition:.3g}"
        )
        if self.outliers:
            rows.append(f"places that do not fit: {', '.join(map(str, self.outliers))}")
        for group in self.unidentified:
            if len(group) == 1:
                rows.append(f"these places do not determine {group[0]}: give it")
            else:
                rows.append(f"these places do not separate {', '.join(group)}: give one of them")
        return "\n".join(rows)


def calibrate(
    angles_rad,
    x_mm,
    y_mm,
    start: Linkage,
    *,
    angle_sigma_rad,
    place_sigma_mm: float,
    offset_rad=(0.0, 0.0),
    gain=(1.0, 1.0),
    free: tuple[str, ...] = STANDARD,
) -> Kinematics:
    """Fit the lengths and encoder mounting of a linkage to measured terminal positions.

    Parameters
    ----------
    angles_rad : array_like, shape (2, n)
        The angle of each encoder at each place.
    x_mm, y_mm : array_like, shape (n,)
        The measured terminal, in the frame of the ruler, grid or machine that measured it.
    start : Linkage
        The nominal linkage.
    angle_sigma_rad : float or array_like, shape (2, n)
        Standard error of the angles, see `Angle.sigma_rad`.
    place_sigma_mm : float
        Standard error of a coordinate of a place.
    offset_rad, gain : pair of float
        Nominal mounting of the encoders, see `Encoder`.
    free : tuple of str
        The parameters to fit, from `NAMES`; the others stay fixed. The frame is the position of
        joint 1 in the measured frame, the rotation between the two and, for a picture of unknown
        scale, its units per mm.

    Returns
    -------
    Kinematics

    Raises
    ------
    SpotsError
        If scipy is missing, the arguments do not go together, there are fewer numbers than
        unknowns, or the angles and places have nothing to do with each other.
    """
    if find_spec("scipy") is None:
        raise missing("kinematic calibration needs", "scipy", "kinematics")
    angles, places = _checked(angles_rad, x_mm, y_mm, free)
    angle_sigma_rad = np.broadcast_to(np.asarray(angle_sigma_rad, dtype=float), angles.shape)
    if not ((angle_sigma_rad > 0).all() and place_sigma_mm > 0):
        raise SpotsError("the standard errors of angles and places are more than 0")
    values = dict(zip(NAMES, (*start.bar_mm, start.base_mm, *offset_rad, *gain, 0, 0, 0, 1)))
    names = tuple(name for name in NAMES if name in free)
    centre = np.array([values[name] for name in names])
    ranges = np.array(
        [_RANGES.get(name, _LENGTH_SHARE * value) for name, value in zip(names, centre)]
    )
    fit = _Fit(angles, places, values, names, start.side)
    scale = np.full((len(places), 2, 2), np.eye(2) / place_sigma_mm)
    found = np.zeros(len(names))  # in units of the ranges, from the start
    outlier = np.zeros(len(places), bool)
    for _ in range(_ROUNDS):
        found = fit.solve(np.where(outlier[:, None, None], 0, scale), centre, ranges, found)
        at = centre + ranges * found
        scale = fit.weights(at, angle_sigma_rad, place_sigma_mm)
        residual_mm = fit.residual_mm(at)
        distance = np.hypot(*np.einsum("nij,nj->in", scale, residual_mm)) / np.sqrt(2)
        misfit = float(np.median(distance) / np.sqrt(np.log(2)))  # Rayleigh's median
        outlier = distance > _OUTLIER * max(misfit, 1)
    if not np.median(np.hypot(*residual_mm.T)) < _NONSENSE * np.mean(start.bar_mm):
        raise SpotsError(
            "the angles and places do not go together: is each pair of the same moment, "
            "in mm, and in the unit of angle that its name has?"
        )
    _check_enough(int((~outlier).sum()), names, f"without the {outlier.sum()} that do not fit, ")
    jacobian = fit.jacobian(at, ranges, scale)[np.repeat(~outlier, 2)]
    errors, unidentified, rank, condition = _identified(jacobian, names, max(misfit, 1.0))
    off_mm = np.hypot(*residual_mm[~outlier].T)
    return Kinematics(
        names,
        values | dict(zip(names, at.tolist())),
        dict.fromkeys(NAMES, 0.0) | dict(zip(names, (ranges * errors).tolist())),
        start.assembly,
        unidentified,
        rank,
        condition,
        float(np.sqrt((off_mm**2).mean())),
        float(off_mm.max()),
        misfit,
        tuple(np.flatnonzero(outlier).tolist()),
    )


class _Fit:
    def __init__(self, angles, places, values, names, side):
        self._angles, self._places, self._side = angles, places, side
        self._values, self._names = values, names

    def residual_mm(self, at) -> np.ndarray:
        """Return measured less fitted terminals, shape (n, 2)."""
        values = self._values | dict(zip(self._names, at))
        return self._places - self._terminal(values, self._angles)

    def jacobian(self, at, ranges, scale) -> np.ndarray:
        """Return the whitened Jacobian by the parameters in units of their ranges, (2n, p)."""
        step = 1e-5
        columns = []
        for i in range(len(at)):
            shift = np.zeros(len(at))
            shift[i] = step * ranges[i]
            slope = (self.residual_mm(at + shift) - self.residual_mm(at - shift)) / (2 * step)
            columns.append(np.einsum("nij,nj->ni", scale, slope).ravel())
        return np.array(columns).T

    def solve(self, scale, centre, ranges, begin) -> np.ndarray:
        """Return the best parameters in units of the ranges."""
        from scipy.optimize import least_squares

        def residuals(found):
            white = np.einsum("nij,nj->ni", scale, self.residual_mm(centre + ranges * found))
            # Soft L1 of what the places say, and the plain square of what was known before.
            square = (white**2).sum(axis=1, keepdims=True) / _ROBUST**2
            weaker = np.sqrt(2 / (np.sqrt(1 + square) + 1))
            return np.append((white * weaker).ravel(), found)

        return least_squares(residuals, begin, method="trf", xtol=1e-12, ftol=1e-12).x

    def weights(self, at, angle_sigma_rad, place_sigma_mm) -> np.ndarray:
        """Return what makes the residual of each place of unit variance, shape (n, 2, 2)."""
        values = self._values | dict(zip(self._names, at))
        step = 1e-6
        slopes = []
        for joint in (0, 1):
            shift = np.zeros((2, 1))
            shift[joint] = step
            ahead = self._terminal(values, self._angles + shift)
            slopes.append((ahead - self._terminal(values, self._angles - shift)) / (2 * step))
        slopes = np.stack(slopes, axis=-1) * angle_sigma_rad.T[:, None, :]
        covariance = slopes @ slopes.transpose(0, 2, 1) + place_sigma_mm**2 * np.eye(2)
        return np.linalg.inv(np.linalg.cholesky(covariance))

    def _terminal(self, values, angles) -> np.ndarray:
        bar_mm = [values[name] for name in LENGTHS[:4]]
        t1 = values["offset1_rad"] + values["gain1"] * angles[0]
        t2 = values["offset2_rad"] + values["gain2"] * angles[1]
        # A fit may pass through angles at which the linkage cannot be closed.
        x, y, *_ = assembled(bar_mm, values["base_mm"], self._side, t1, t2, least=1e-12)
        return np.stack(framed(values, x, y), axis=-1)


def framed(values, x_mm, y_mm):
    """Transform places from the frame of the base joints into the measuring frame.

    Parameters
    ----------
    values : mapping of str to float
        ``frame_scale``, ``frame_rad``, ``frame_x_mm`` and ``frame_y_mm``.
    x_mm, y_mm : array_like
        Places in the frame of the base joints, in mm.

    Returns
    -------
    tuple of array_like
        x and y in the measuring frame, in mm.
    """
    cos = values["frame_scale"] * np.cos(values["frame_rad"])
    sin = values["frame_scale"] * np.sin(values["frame_rad"])
    return (
        values["frame_x_mm"] + cos * x_mm - sin * y_mm,
        values["frame_y_mm"] + sin * x_mm + cos * y_mm,
    )


def _identified(jacobian, names, misfit):
    """Return errors in units of the ranges, groups not separated, rank and condition."""
    _, sizes, ways = np.linalg.svd(jacobian, full_matrices=False)
    sizes = sizes / misfit
    left = 1 / np.sqrt(1 + sizes**2)  # of what was unknown, in each direction
    errors = np.sqrt(((ways * left[:, None]) ** 2).sum(axis=0))
    groups = []
    for way in ways[left > _KNOWN]:
        share = np.abs(way) / np.abs(way).max()
        groups.append(tuple(name for name, one in zip(names, share) if one > _NAMED))
    condition = sizes[0] / sizes[-1] if sizes[-1] > 0 else np.inf
    return errors, tuple(groups), len(names) - len(groups), float(condition)


def _checked(angles_rad, x_mm, y_mm, free):
    angles, x_mm, y_mm = (np.asarray(v, dtype=float) for v in (angles_rad, x_mm, y_mm))
    if not (x_mm.ndim == 1 and x_mm.shape == y_mm.shape and angles.shape == (2, len(x_mm))):
        raise SpotsError("a kinematic calibration takes two angles, an x and a y for each place")
    places = np.stack([x_mm, y_mm], axis=-1)
    if not (np.isfinite(angles).all() and np.isfinite(places).all()):
        raise SpotsError("the angles and places of a kinematic calibration are finite numbers")
    strange = sorted(set(free) - set(NAMES))
    if strange or not free:
        raise SpotsError(f"free parameters are some of {', '.join(NAMES)}")
    _check_enough(len(places), set(free))
    return angles, places


def _check_enough(places, free, where=""):
    if 2 * places < len(free):
        raise SpotsError(
            f"{where}{places} places are {2 * places} numbers, fewer than the {len(free)} that "
            "are free: measure more, or free less"
        )
