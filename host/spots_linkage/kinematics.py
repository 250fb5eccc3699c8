"""Kinematic calibration: fits lengths and mounting of a linkage to measured end points.

Uses robust least squares of scipy (the extra ``kinematics``), and reports which parameters the
measured points determine.
"""

from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np

from spots.errors import CalibrationError, SettingError, missing

from .fivebar import Linkage, assembled

# Prior standard deviation of each parameter; of a length, as a share of the length. It scales
# parameters of different units. It also keeps a parameter near its start value if the points do not
# determine the parameter.
_LENGTH_SHARE = 0.05
_PRIORS = {
    "offset1_rad": 0.1,
    "offset2_rad": 0.1,
    "gain1": 0.05,
    "gain2": 0.05,
    "frame_x_mm": 20.0,
    "frame_y_mm": 20.0,
    "frame_rad": 0.1,
    "frame_scale": 0.05,
}
# Names of the parameters. Bars are in the order of `Linkage`; `FRAME` is the linkage's position and
# rotation in the measuring frame. `STANDARD` are the parameters that `calibrate` fits by default.
LENGTHS = ("bar1_mm", "bar2_mm", "bar3_mm", "bar4_mm", "base_mm")
MOUNTING = ("offset1_rad", "offset2_rad", "gain1", "gain2")
FRAME = ("frame_x_mm", "frame_y_mm", "frame_rad")
NAMES = LENGTHS + tuple(_PRIORS)
STANDARD = LENGTHS + MOUNTING + FRAME
_ROBUST = 2.0  # residuals of more than this number of standard errors get less weight
_OUTLIER = 5.0  # points with residuals of more than this number of standard errors are outliers
# The points determine a linear combination of parameters if its standard error is below this share
# of its prior standard deviation.
_KNOWN = 0.5
# A combination is reported with the parameters whose coefficients are at least this share of the
# largest one.
_NAMED = 0.3
_ROUNDS = 4  # number of fits; each uses weights and outliers of the previous fit
_NONSENSE = 0.02  # a fit is refused if its median residual is above this share of a bar length


@dataclass(frozen=True)
class Kinematics:
    """Result of a kinematic calibration.

    Attributes
    ----------
    names : tuple of str
        Names of the fitted (free) parameters.
    values, standard_errors : dict of str to float
        Value and standard error of each parameter, by name. The error of a fixed parameter is 0. If
        the points do not determine a parameter, its error is close to its prior standard deviation:
        5 % of a length, or the value in `_PRIORS`.
    assembly : str
        ``far`` or ``near``, see `Linkage`.
    unidentified : tuple of tuple of str
        Groups of parameters that the points do not determine separately. To determine the rest of a
        group, leave one of its parameters out of the argument `free` of `calibrate`.
    rank : int
        Number of independent combinations of the free parameters that the points determine.
    condition : float
        Condition number of the Jacobian whose columns are scaled by the prior standard deviations;
        infinite if the Jacobian is singular.
    residual_rms_mm, residual_max_mm : float
        Root mean square and maximum distance between measured and fitted positions, in mm, without
        the outliers.
    misfit : float
        Scatter of the residuals divided by the scatter that the given standard errors predict;
        about 1 if the standard errors are right.
    outliers : tuple of int
        Indices of the points that do not fit; these points are excluded from the result.
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
        """Linkage with the fitted lengths; its origin is joint 1."""
        bars = [self.values[name] for name in LENGTHS[:4]]
        return Linkage(bars, self.values["base_mm"], self.assembly)

    @property
    def offset_rad(self) -> tuple[float, float]:
        """Offsets of encoder 1 and encoder 2 in rad, see `Encoder`."""
        return self.values["offset1_rad"], self.values["offset2_rad"]

    @property
    def gain(self) -> tuple[float, float]:
        """Gains of encoder 1 and encoder 2: joint angle per calibrated angle, see `Encoder`."""
        return self.values["gain1"], self.values["gain2"]

    def terminal(self, angles_rad) -> tuple:
        """Return the position of the end point in the measuring frame.

        Parameters
        ----------
        angles_rad : array_like, shape (2, ...)
            Calibrated angles of encoder 1 and encoder 2 in rad, without `offset_rad` and `gain`.

        Returns
        -------
        x_mm, y_mm : float or numpy.ma.MaskedArray
            Position in mm, in the coordinate frame of the arguments `x_mm` and `y_mm` of
            `calibrate`.
        """
        theta = [o + g * a for o, g, a in zip(self.offset_rad, self.gain, angles_rad)]
        return framed(self.values, *self.linkage.forward(*theta))

    def report(self) -> str:
        """Return a readable report: parameters, errors and warnings."""
        rows = []
        for name in NAMES:
            error = self.standard_errors[name]
            known = f"+- {error:.2g}" if name in self.names else "fixed"
            rows.append(f"{name:12} {self.values[name]:12.5f}  {known}")
        rows.append(
            f"residual {self.residual_rms_mm:.3f} mm rms, {self.residual_max_mm:.3f} mm at most; "
            f"{self.misfit:.2f} times the residual expected from the given errors; "
            f"rank {self.rank} of {len(self.names)}, condition {self.condition:.3g}"
        )
        if self.outliers:
            rows.append(f"points that do not fit: {', '.join(map(str, self.outliers))}")
        for group in self.unidentified:
            rows.append(
                f"these points do not determine {', '.join(group)}: measure more points that are "
                "far apart, or, in Python, leave one of these parameters out of 'free'"
            )
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
    """Fit lengths and encoder mounting of a linkage to measured positions of its end point.

    Parameters
    ----------
    angles_rad : array_like, shape (2, n)
        Calibrated angles of encoder 1 and encoder 2 at each of n points, in rad, without offset and
        gain of the mounting.
    x_mm, y_mm : array_like, shape (n,)
        Measured position of the linkage's end point at each of the n points, in mm. The coordinate
        frame is that of the measuring device, for example a grid.
    start : Linkage
        Nominal linkage, where the fit starts.
    angle_sigma_rad : float or array_like, shape (2, n)
        Standard error of the angles in rad, see `encoder.Angle.sigma_rad`.
    place_sigma_mm : float
        Standard error of each measured coordinate, in mm.
    offset_rad, gain : pair of float
        Nominal mounting of encoder 1 and encoder 2, see `Encoder`.
    free : tuple of str
        Names of the parameters to fit, from `NAMES`; other parameters keep their nominal values.
        ``frame_x_mm``, ``frame_y_mm`` and ``frame_rad`` are position and rotation of the linkage in
        the measuring frame. ``frame_scale`` is the number of measured units per mm, for positions
        from a photo of unknown scale; the default `STANDARD` does not include it.

    Returns
    -------
    Kinematics

    Raises
    ------
    CalibrationError, SettingError
        If scipy is missing, an argument has a wrong shape or value, there are too few points, or no
        linkage near the nominal one fits the points.
    """
    if find_spec("scipy") is None:
        raise missing("kinematic calibration needs", "scipy", "kinematics")
    angles, x_mm, y_mm = (np.asarray(one, dtype=float) for one in (angles_rad, x_mm, y_mm))
    if not (x_mm.ndim == 1 and x_mm.shape == y_mm.shape and angles.shape == (2, len(x_mm))):
        raise SettingError("angles_rad must have shape (2, n), and x_mm and y_mm shape (n,)")
    places = np.stack([x_mm, y_mm], axis=-1)
    if not (np.isfinite(angles).all() and np.isfinite(places).all()):
        raise SettingError(
            "angles and positions of a kinematic calibration must be finite numbers: remove the "
            "points with other values"
        )
    angle_sigma_rad = np.broadcast_to(np.asarray(angle_sigma_rad, dtype=float), angles.shape)
    if not ((angle_sigma_rad > 0).all() and place_sigma_mm > 0):
        raise SettingError("the standard errors of angles and positions must be more than 0")
    if not free or set(free) - set(NAMES):
        raise SettingError(f"free must name one or more of these parameters: {', '.join(NAMES)}")
    _check_enough(len(places), set(free))
    values = dict(zip(NAMES, (*start.bar_mm, start.base_mm, *offset_rad, *gain, 0, 0, 0, 1)))
    names = tuple(name for name in NAMES if name in free)
    fit = _Fit(angles, places, values, names, start.side)
    scale = np.full((len(places), 2, 2), np.eye(2) / place_sigma_mm)
    found = np.zeros(len(names))
    outlier = np.zeros(len(places), bool)
    for _ in range(_ROUNDS):
        found = fit.solve(np.where(outlier[:, None, None], 0, scale), found)
        scale = fit.weights(found, angle_sigma_rad, place_sigma_mm)
        residual_mm = fit.residual_mm(found)
        distance = np.hypot(*np.einsum("nij,nj->in", scale, residual_mm)) / np.sqrt(2)
        misfit = float(np.median(distance) / np.sqrt(np.log(2)))  # Rayleigh's median
        outlier = distance > _OUTLIER * max(misfit, 1)
    if not np.median(np.hypot(*residual_mm.T)) < _NONSENSE * np.mean(start.bar_mm):
        raise CalibrationError(
            "no linkage near the nominal one fits the points: check its lengths, assembly, offsets "
            "and gains; measure angles and position at the same moment; give positions in mm, and "
            "angles in the unit of the argument or column (_rad or _deg)"
        )
    _check_enough(int((~outlier).sum()), names, f"without {outlier.sum()} outliers, ")
    jacobian = fit.jacobian(found, scale)[np.repeat(~outlier, 2)]
    errors, unidentified, rank, condition = _identified(jacobian, names, max(misfit, 1.0))
    off_mm = np.hypot(*residual_mm[~outlier].T)
    return Kinematics(
        names,
        fit.values(found),
        dict.fromkeys(NAMES, 0.0) | dict(zip(names, (fit.priors * errors).tolist())),
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
    """Least-squares fit of a linkage to n measured positions.

    The argument `found` of the methods is an array of shape (p,): differences of the p free
    parameters from their start values, divided by their prior standard deviations. `scale` has
    shape (n, 2, 2): matrices from `weights` that divide residuals by their standard errors
    (whitening).
    """

    def __init__(self, angles, places, start, names, side):
        self._angles, self._places, self._side = angles, places, side
        self._start, self._names = start, names
        self.priors = np.array([_PRIORS.get(name, _LENGTH_SHARE * start[name]) for name in names])

    def values(self, found) -> dict[str, float]:
        """Return all parameters by name, in mm and rad, from the scaled parameters `found`."""
        shifts = dict(zip(self._names, (self.priors * found).tolist()))
        return {name: value + shifts.get(name, 0) for name, value in self._start.items()}

    def residual_mm(self, found) -> np.ndarray:
        """Return measured minus fitted positions in mm, shape (n, 2)."""
        return self._places - self._terminal(self.values(found), self._angles)

    def jacobian(self, found, scale) -> np.ndarray:
        """Return d(whitened residuals)/d(found), shape (2n, p); `scale` whitens the residuals."""
        slopes = _slopes(self.residual_mm, found, 1e-5)
        return np.einsum("nij,pnj->nip", scale, slopes).reshape(-1, len(found))

    def solve(self, scale, begin) -> np.ndarray:
        """Fit with the matrices `scale`, starting from `begin`; return `found` of the best fit."""
        from scipy.optimize import least_squares

        def residuals(found):
            white = np.einsum("nij,nj->ni", scale, self.residual_mm(found))
            # Soft L1 loss for the points, squared loss for the priors.
            square = (white**2).sum(axis=1, keepdims=True) / _ROBUST**2
            weaker = np.sqrt(2 / (np.sqrt(1 + square) + 1))
            return np.append((white * weaker).ravel(), found)

        return least_squares(residuals, begin, method="trf", xtol=1e-12, ftol=1e-12).x

    def weights(self, found, angle_sigma_rad, place_sigma_mm) -> np.ndarray:
        """Return whitening matrices of the residuals, shape (n, 2, 2).

        They are computed at the parameters `found`. `angle_sigma_rad` (shape (2, n)) and
        `place_sigma_mm` are the standard errors of the measured angles and coordinates.
        """
        values = self.values(found)

        def turned(shift_rad):
            return self._terminal(values, self._angles + shift_rad[:, None])

        slopes = np.stack(_slopes(turned, np.zeros(2), 1e-6), axis=-1)
        slopes *= angle_sigma_rad.T[:, None, :]
        covariance = slopes @ slopes.transpose(0, 2, 1) + place_sigma_mm**2 * np.eye(2)
        return np.linalg.inv(np.linalg.cholesky(covariance))

    def _terminal(self, values, angles) -> np.ndarray:
        bar_mm = [values[name] for name in LENGTHS[:4]]
        t1 = values["offset1_rad"] + values["gain1"] * angles[0]
        t2 = values["offset2_rad"] + values["gain2"] * angles[1]
        # A fit may pass through lengths with which the outer bars cannot meet.
        x, y, *_ = assembled(bar_mm, values["base_mm"], self._side, t1, t2, least=1e-12)
        return np.stack(framed(values, x, y), axis=-1)


def _slopes(function, at, step):
    """Return the derivatives of `function` with respect to each element of the array `at`.

    They are central differences at `at`, with the step `step`.
    """
    shifts = step * np.eye(len(at))
    return [(function(at + shift) - function(at - shift)) / (2 * step) for shift in shifts]


def framed(values, x_mm, y_mm):
    """Transform positions from the frame of the base joints into the measuring frame.

    Parameters
    ----------
    values : mapping of str to float
        Parameters by name: ``frame_scale``, ``frame_rad``, ``frame_x_mm`` and ``frame_y_mm``.
    x_mm, y_mm : array_like
        Positions in the frame of the base joints, in mm.

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


def _identified(jacobian: np.ndarray, names: tuple[str, ...], misfit: float):
    """Find out which of p parameters the points of a fit determine.

    `jacobian` is the whitened one of `_Fit.jacobian`, shape (2n, p); `misfit` is that of
    `Kinematics`. Returned are standard errors divided by the prior standard deviations, shape (p,),
    and unidentified, rank and condition of `Kinematics`.
    """
    _, sizes, ways = np.linalg.svd(jacobian, full_matrices=False)
    sizes = sizes / misfit
    left = 1 / np.sqrt(1 + sizes**2)  # remaining share of the prior, in each direction
    errors = np.sqrt(((ways * left[:, None]) ** 2).sum(axis=0))
    groups = []
    for way in ways[left > _KNOWN]:
        share = np.abs(way) / np.abs(way).max()
        groups.append(tuple(name for name, one in zip(names, share) if one > _NAMED))
    condition = sizes[0] / sizes[-1] if sizes[-1] > 0 else np.inf
    return errors, tuple(groups), len(names) - len(groups), float(condition)


def _check_enough(places, free, where=""):
    if 2 * places < len(free):
        raise CalibrationError(
            f"{where}{places} points give {2 * places} numbers, too few for {len(free)} free "
            "parameters: measure more points"
        )
