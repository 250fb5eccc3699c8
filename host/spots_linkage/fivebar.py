"""The planar five-bar linkage: two arms on two base joints, which meet at a common end point.

An arm consists of an inner and an outer bar, joined at the elbow. This module computes the joint
angles for an end point (Eqs. 3 and 4 of the paper, here for bars of any length), and the end point
for joint angles. The base joints lie at (0, 0) and (base, 0). Each joint's angle is measured from
+y towards the other joint. Functions take scalars or arrays.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from spots.errors import SettingError

from .limits import Limit, LimitError

# Rounding errors may exceed a limit by this share of the lengths: 0.1 nm on 100 mm.
_ROUNDING = 1e-12
# Two bars are in line if the sine of the angle between them is less than this value.
_IN_LINE = 1e-9
_ANGLES = "the angles ({:.6g}, {:.6g}) rad"
_MOST_RAD = 4 * np.pi  # an angle beyond it is in degrees
_TERMINAL = "an end point at ({:.6g}, {:.6g}) mm"


class Linkage:
    """A planar five-bar linkage.

    Parameters
    ----------
    bar_mm : float or sequence of 4 floats
        Bar lengths in mm: one length for all bars, or four lengths. Their order is from joint 1
        via the end point to joint 2: inner bar 1, outer bar 1, outer bar 2, inner bar 2.
    base_mm : float
        Distance of the two base joints, in mm.
    assembly : {"far", "near"}
        Which of the two possible end points to use. An elbow joins an inner and an outer bar. Seen
        from elbow 1 towards elbow 2, the ``far`` end point lies on the left.

    Attributes
    ----------
    side : float
        The assembly as a number: 1 for ``far``, -1 for ``near``.

    Raises
    ------
    SettingError
        If an argument is invalid, or the lengths cannot form a linkage.

    Notes
    -----
    If there is no solution, a method raises `LimitError` for scalars. For arrays, a method always
    returns masked arrays (`numpy.ma.MaskedArray`); elements without a solution are NaN and masked.
    `forward_limits` and `inverse_limits` return the reason for each element. Masked input elements
    stay masked. `inverse` assumes that the elbows point outwards, as Eqs. 3 and 4 do.

    Examples
    --------
    >>> linkage = spots_linkage.Linkage(bar_mm=100, base_mm=80)
    >>> x_mm, y_mm = linkage.forward(-0.5, 0.4)
    >>> theta1_rad, theta2_rad = linkage.inverse(x_mm, y_mm)
    >>> f"{theta1_rad:.3f} {theta2_rad:.3f}"
    '-0.500 0.400'
    """

    def __init__(self, bar_mm, base_mm: float, assembly: str = "far"):
        try:
            bars = np.broadcast_to(np.asarray(bar_mm, dtype=float), 4)
            lengths = np.append(bars, float(base_mm))
        except (TypeError, ValueError):
            raise SettingError(
                "a linkage needs one bar length or four, and one base length, all numbers in mm"
            ) from None
        if not (np.isfinite(lengths).all() and (lengths > 0).all()):
            raise SettingError("each length of a linkage must be a positive number of mm")
        if 2 * lengths.max() >= lengths.sum():
            raise SettingError(
                f"the length {lengths.max():g} mm must be below the sum of the other lengths: "
                "check the four bars and the base"
            )
        if assembly not in ("far", "near"):
            raise SettingError(
                f"the assembly of a linkage must be 'far' or 'near', not '{assembly}'"
            )
        self.bar_mm = tuple(bars.tolist())
        self.base_mm = float(base_mm)
        self.assembly = assembly
        self.side = 1.0 if assembly == "far" else -1.0

    def __repr__(self) -> str:
        bars = ", ".join(f"{bar:g}" for bar in self.bar_mm)
        return f"Linkage(({bars}), {self.base_mm:g}, {self.assembly!r})"

    def forward(self, theta1_rad, theta2_rad):
        """Return the position of the end point for two joint angles.

        Parameters
        ----------
        theta1_rad, theta2_rad : float or array_like
            Angles of joint 1 and joint 2, in rad; the shapes must broadcast.

        Returns
        -------
        x_mm, y_mm : float or numpy.ma.MaskedArray
            Position of the end point, in mm.

        Raises
        ------
        LimitError
            For scalars, if there is no solution at these angles.
        """
        return _answer(self._forward, _ANGLES, theta1_rad, theta2_rad)

    def inverse(self, x_mm, y_mm):
        """Return the joint angles for a position of the end point (Eqs. 3 and 4 of the paper).

        Parameters
        ----------
        x_mm, y_mm : float or array_like
            Position of the end point, in mm; the shapes must broadcast.

        Returns
        -------
        theta1_rad, theta2_rad : float or numpy.ma.MaskedArray
            Angles of joint 1 and joint 2, in rad, from -pi to pi.

        Raises
        ------
        LimitError
            For scalars, if there is no solution for this position.
        """
        return _answer(self._inverse, _TERMINAL, x_mm, y_mm)

    def forward_limits(self, theta1_rad, theta2_rad) -> np.ndarray:
        """Return the `Limit` code of each pair of joint angles.

        Parameters
        ----------
        theta1_rad, theta2_rad : float or array_like
            Angles of joint 1 and joint 2, in rad; the shapes must broadcast.

        Returns
        -------
        numpy.ndarray of int8
            Codes; 0 where there is a solution.
        """
        return self._forward(*_arrays(_ANGLES, theta1_rad, theta2_rad))[-1]

    def inverse_limits(self, x_mm, y_mm) -> np.ndarray:
        """Return the `Limit` code of each position.

        Parameters
        ----------
        x_mm, y_mm : float or array_like
            Positions of the end point, in mm; the shapes must broadcast.

        Returns
        -------
        numpy.ndarray of int8
            Codes; 0 where there is a solution.
        """
        return self._inverse(*_arrays(_TERMINAL, x_mm, y_mm))[-1]

    def jacobian(self, theta1_rad, theta2_rad):
        """Return the Jacobian d(x, y)/d(theta1, theta2) of the end point's position.

        Parameters
        ----------
        theta1_rad, theta2_rad : float or array_like
            Angles of joint 1 and joint 2, in rad; the shapes must broadcast.

        Returns
        -------
        numpy.ndarray or numpy.ma.MaskedArray, shape (..., 2, 2)
            Jacobian in mm/rad, with a row for x and a row for y. A plain array for scalars.

        Raises
        ------
        LimitError
            For scalars, if there is no solution at these angles, or the outer bars are in line.
        """
        (found,) = _answer(self._jacobian, _ANGLES, theta1_rad, theta2_rad)
        return found

    def covariance(self, theta1_rad, theta2_rad, angles_rad2):
        """Return the covariance of the end point's position, from the covariance of the angles.

        Parameters
        ----------
        theta1_rad, theta2_rad : float or array_like
            Angles of joint 1 and joint 2, in rad; the shapes must broadcast.
        angles_rad2 : array_like, shape (..., 2, 2)
            Covariance of the two angles, in rad**2.

        Returns
        -------
        numpy.ndarray or numpy.ma.MaskedArray, shape (..., 2, 2)
            Covariance of x and y in mm**2, to first order.

        Raises
        ------
        LimitError
            Under the same conditions as in `jacobian`.
        SettingError
            If an argument is wrong.
        """
        jacobian = self.jacobian(theta1_rad, theta2_rad)
        slopes = np.asarray(jacobian)
        try:
            found = slopes @ np.asarray(angles_rad2, dtype=float) @ np.swapaxes(slopes, -1, -2)
        except (TypeError, ValueError):
            raise SettingError(
                "the covariance of the angles must be an array of numbers, shape (..., 2, 2)"
            ) from None
        return np.ma.masked_invalid(found) if np.ma.isMaskedArray(jacobian) else found

    def outer_angle(self, theta1_rad, theta2_rad):
        """Return the angle by which the outer bars deviate from a straight line.

        At 0 the bars are in line: the end point can move although both joints are fixed.

        Parameters
        ----------
        theta1_rad, theta2_rad : float or array_like
            Angles of joint 1 and joint 2, in rad; the shapes must broadcast.

        Returns
        -------
        float or numpy.ma.MaskedArray
            The acute angle between the two outer bars, in rad, from 0 to pi/2.

        Raises
        ------
        LimitError
            For scalars, if there is no solution at these angles.
        """
        (found,) = _answer(self._outer_angle, _ANGLES, theta1_rad, theta2_rad)
        return found

    @np.errstate(all="ignore")
    def _forward(self, theta1, theta2):
        _, b1, b2, _ = self.bar_mm
        x, y, apart2, off2 = assembled(self.bar_mm, self.base_mm, self.side, theta1, theta2)
        limit = np.zeros(np.shape(x), np.int8)
        # This test is cheap; the exact limits take as long to compute as the solution.
        if not ((off2 >= 0) & (apart2 > _ROUNDING * b1 * b1)).all():
            apart = np.sqrt(apart2)
            codes = Limit.ELBOWS_APART, Limit.ELBOWS_CLOSE, Limit.ELBOWS_MEET
            limit = _bar_limits(apart, b1, b2, *codes)
            limit = np.where(np.isfinite(apart), limit, Limit.NOT_FINITE).astype(np.int8)
        return x, y, limit

    @np.errstate(all="ignore")
    def _inverse(self, x, y):
        a1, b1, b2, a2 = self.bar_mm
        theta1, limit1 = _arm(x, y, a1, b1)
        theta2, limit2 = _arm(self.base_mm - x, y, a2, b2)
        limit = np.where(limit1 != 0, limit1, np.where(limit2 != 0, limit2 + 1, 0))
        limit = np.where(np.isfinite(x) & np.isfinite(y), limit, Limit.NOT_FINITE)
        # If the end point is on the line through the elbows, both assemblies are the same.
        *_, across = self._outer(theta1, theta2, x, y)
        other = self.side * across < -_ROUNDING * b1 * b2
        limit = np.where((limit == 0) & other, Limit.OTHER_ASSEMBLY, limit)
        return theta1, theta2, limit.astype(np.int8)

    @np.errstate(all="ignore")
    def _jacobian(self, theta1, theta2):
        a1, b1, b2, a2 = self.bar_mm
        x, y, limit = self._forward(theta1, theta2)
        u1, u2, across = self._outer(theta1, theta2, x, y)
        limit = np.where((limit == 0) & (abs(across) < _IN_LINE * b1 * b2), Limit.SINGULAR, limit)
        # The length of each outer bar u_i is constant: u_i . d(end point) = u_i . d(elbow_i).
        push1 = a1 * (u1[0] * np.cos(theta1) - u1[1] * np.sin(theta1))
        push2 = -a2 * (u2[0] * np.cos(theta2) + u2[1] * np.sin(theta2))
        rows = np.array([[u2[1] * push1, -u1[1] * push2], [-u2[0] * push1, u1[0] * push2]])
        return np.moveaxis(rows / across, (0, 1), (-2, -1)), limit

    def _outer_angle(self, theta1, theta2):
        _, b1, b2, _ = self.bar_mm
        x, y, limit = self._forward(theta1, theta2)
        *_, across = self._outer(theta1, theta2, x, y)
        return np.arcsin(np.minimum(abs(across) / (b1 * b2), 1)), limit

    def _outer(self, theta1, theta2, x, y):
        """Return the outer bars as vectors from elbow to end point, and their cross product."""
        a1, _, _, a2 = self.bar_mm
        u1 = (x - a1 * np.sin(theta1), y - a1 * np.cos(theta1))
        u2 = (x - self.base_mm + a2 * np.sin(theta2), y - a2 * np.cos(theta2))
        return u1, u2, u1[0] * u2[1] - u1[1] * u2[0]


def assembled(
    bar_mm: Sequence[float],
    base_mm: float,
    side: int,
    theta1: ArrayLike,
    theta2: ArrayLike,
    least: float = 0.0,
):
    """Return the position of the end point for two joint angles; do not check that it exists.

    The outer bars are the radii of two circles around the elbows. The end point is one of the two
    intersections of these circles. `side` is 1 for the assembly ``far``, -1 for ``near``; bars and
    angles are those of `Linkage`. A value of `least` above 0 replaces a lower `off2`, which keeps a
    fit smooth at angles where the outer bars cannot meet.

    Returned are x and y in mm, the squared distance `apart2` of the elbows, and `off2`: the squared
    distance of the end point from the line through the elbows, divided by `apart2`; negative where
    the outer bars cannot meet.
    """
    a1, b1, b2, a2 = bar_mm
    x1, y1 = a1 * np.sin(theta1), a1 * np.cos(theta1)
    across_x = base_mm - a2 * np.sin(theta2) - x1
    across_y = a2 * np.cos(theta2) - y1
    apart2 = across_x * across_x + across_y * across_y
    # Coordinates along and off the line through the elbows, divided by the elbows' distance.
    along = 0.5 if b1 == b2 else 0.5 + (b1 * b1 - b2 * b2) / (2 * apart2)
    off2 = b1 * b1 / apart2 - along * along
    off = side * np.sqrt(np.maximum(off2, least))
    x = x1 + along * across_x - off * across_y
    y = y1 + along * across_y + off * across_x
    return x, y, apart2, off2


def _arm(x, y, inner, outer):
    """Return the angle of an arm's inner bar in rad, and a `Limit` code as for arm 1.

    If the arm is arm 2 and the code is not 0, the caller adds 1 to get the code of arm 2. (`x`,
    `y`) is the end point relative to the arm's base joint, with x towards the other joint. `inner`
    and `outer` are the lengths of the arm's bars. All are in mm.
    """
    reach = np.hypot(x, y)
    # The cosine rule; for equal bars it is Eq. 3's sqrt(x^2 + y^2) / 2l.
    if inner == outer:
        cosine = reach / (inner + outer)
    else:
        cosine = (reach * reach + inner * inner - outer * outer) / (2 * inner * reach)
    theta = np.pi / 2 - np.arctan2(y, x) - np.arccos(np.clip(cosine, -1, 1))
    codes = Limit.BEYOND_ARM_1, Limit.WITHIN_ARM_1, Limit.AT_JOINT_1
    wrapped = np.where(abs(theta) > np.pi, theta - np.copysign(2 * np.pi, theta), theta)
    return wrapped, _bar_limits(reach, inner, outer, *codes)


def _bar_limits(apart: ArrayLike, a: float, b: float, beyond: Limit, within: Limit, meet: Limit):
    """Return the `Limit` codes of two bars of lengths `a` and `b` that are joined at one end.

    The codes `beyond`, `within` and `meet` are for free ends that are too far apart, too close
    together, or coincide.
    """
    whole, difference = a + b, abs(a - b)
    slack = whole * _ROUNDING
    limit = np.where(apart > whole * (1 + _ROUNDING), beyond, 0)
    limit = np.where(apart < difference - slack, within, limit)
    return np.where((apart <= slack) & (difference <= slack), meet, limit)


def _arrays(what, first, second):
    try:
        if first is None or second is None:
            raise TypeError  # NumPy takes None for NaN
        found = np.broadcast_arrays(
            *(np.ma.filled(np.ma.asarray(v, dtype=float), np.nan) for v in (first, second))
        )
    except (TypeError, ValueError):
        raise SettingError(
            "angles in rad and positions in mm must be numbers, or arrays whose shapes broadcast"
        ) from None
    if what == _ANGLES and max(np.abs(one).max(initial=0.0) for one in found) > _MOST_RAD:
        raise SettingError(
            f"an angle of a linkage is in rad, at most {_MOST_RAD:.4g}: convert degrees with "
            "numpy.radians"
        )
    return found


def _answer(solve, what: str, first: ArrayLike, second: ArrayLike):
    """Call `solve`; raise LimitError or mask elements where the linkage has no solution.

    ``solve(first, second)`` returns the results and, as last value, the `Limit` codes. LimitError
    is for scalar arguments; its text is `what`, formatted with both arguments. Otherwise the
    results are masked arrays.
    """
    *found, limit = solve(*_arrays(what, first, second))
    if limit.ndim == 0:
        if limit:
            raise LimitError(Limit(int(limit)), what.format(first, second))
        return tuple(one if one.ndim else one.item() for one in found)
    bad = limit != 0
    # Jacobians have two axes more than `bad`: row and column, which come last.
    masks = (np.broadcast_to(bad.T, one.T.shape).T for one in found)
    return tuple(
        np.ma.MaskedArray(np.where(mask, np.nan, one), mask) for one, mask in zip(found, masks)
    )
