"""The planar five-bar linkage: two base joints, four bars, one terminal.

The paper's Eqs. 3 and 4, for bars of any length, and their inverse. Base joints lie at (0, 0) and
(base, 0); both angles count from +y towards the other joint. Everything takes scalars or arrays.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from ..errors import SpotsError

# What rounding alone may put beyond a limit, as a share of the lengths: 0.1 nm on 100 mm.
_ROUNDING = 1e-12
# Bars that are less than this from in line, as the sine of the angle between them, count as so.
_IN_LINE = 1e-9
_BLOCK = 1 << 13  # samples at a time: what is worked on stays in the processor's cache


class Limit(IntEnum):
    """Why a linkage has no solution; `NONE` where it has one.

    Attributes
    ----------
    sentence : str
        The reason, for people.
    """

    sentence: str

    NONE = 0, "the linkage can be there"
    NOT_FINITE = 1, "a value is not a finite number"
    BEYOND_ARM_1 = 2, "farther from joint 1 than its two bars reach"
    BEYOND_ARM_2 = 3, "farther from joint 2 than its two bars reach"
    WITHIN_ARM_1 = 4, "nearer to joint 1 than its two bars of unequal length fold"
    WITHIN_ARM_2 = 5, "nearer to joint 2 than its two bars of unequal length fold"
    AT_JOINT_1 = 6, "on joint 1, where its angle may be any"
    AT_JOINT_2 = 7, "on joint 2, where its angle may be any"
    OTHER_ASSEMBLY = 8, "only the other assembly of the linkage gets there"
    ELBOWS_APART = 9, "the elbows are farther apart than the outer bars reach"
    ELBOWS_CLOSE = 10, "the elbows are closer than the outer bars of unequal length fold"
    ELBOWS_MEET = 11, "the elbows coincide, and the terminal may be anywhere around them"
    SINGULAR = 12, "the outer bars are in line, and the terminal moves while the joints stand"

    def __new__(cls, code: int, sentence: str):
        limit = int.__new__(cls, code)
        limit._value_, limit.sentence = code, sentence
        return limit


class LimitError(SpotsError):
    """A linkage has no answer for a scalar.

    Attributes
    ----------
    limit : Limit
    """

    def __init__(self, limit: Limit, what: str):
        super().__init__(f"no answer for {what}: {limit.sentence}")
        self.limit = limit


class Linkage:
    """A planar five-bar linkage.

    Parameters
    ----------
    bar_mm : float or sequence of 4 floats
        One length for all, or those of inner bar 1, outer bar 1, outer bar 2 and inner bar 2: the
        way round from joint 1 to joint 2.
    base_mm : float
        Between the base joints.
    assembly : {"far", "near"}
        Two terminals go with the same two angles. Seen from elbow 1 towards elbow 2, ``far`` has
        the terminal on the left: beyond the elbows, if these are raised from the base.

    Attributes
    ----------
    side : float
        1 for ``far``, -1 for ``near``.

    Raises
    ------
    SpotsError
        If a length is not positive, or the linkage cannot be closed.

    Notes
    -----
    Where there is no solution, scalars raise `LimitError`, and arrays are masked
    (`numpy.ma.MaskedArray`, NaN beneath the mask); `forward_limits` and `inverse_limits` return the
    reason for each element. Arrays in are always masked arrays out, whether or not anything is
    masked, and masked input stays masked. `inverse` is for elbows that point outwards, as in
    Eqs. 3 and 4.

    Examples
    --------
    >>> linkage = spots.Linkage(bar_mm=100, base_mm=80)
    >>> x_mm, y_mm = linkage.forward(-0.5, 0.4)
    >>> theta1_rad, theta2_rad = linkage.inverse(x_mm, y_mm)
    >>> f"{theta1_rad:.3f} {theta2_rad:.3f}"
    '-0.500 0.400'
    """

    def __init__(self, bar_mm, base_mm: float, assembly: str = "far"):
        try:
            bars = np.broadcast_to(np.asarray(bar_mm, dtype=float), 4)
            base = float(base_mm)
        except (TypeError, ValueError):
            raise SpotsError("a linkage has one bar length, or four, and one base") from None
        lengths = np.append(bars, base)
        if not (np.isfinite(lengths).all() and (lengths > 0).all()):
            raise SpotsError("the lengths of a linkage are positive numbers of mm")
        if 2 * lengths.max() >= lengths.sum():
            raise SpotsError("one length of the linkage is more than the others together reach")
        if assembly not in ("far", "near"):
            raise SpotsError(f"the assembly of a linkage is 'far' or 'near', not '{assembly}'")
        self.bar_mm = tuple(bars.tolist())
        self.base_mm = base
        self.assembly = assembly
        self.side = 1.0 if assembly == "far" else -1.0

    def __repr__(self) -> str:
        bars = ", ".join(f"{bar:g}" for bar in self.bar_mm)
        return f"Linkage(({bars}), {self.base_mm:g}, {self.assembly!r})"

    def forward(self, theta1_rad, theta2_rad):
        """Return where the terminal is.

        Parameters
        ----------
        theta1_rad, theta2_rad : float or array_like
            Shapes that broadcast.

        Returns
        -------
        x_mm, y_mm : float or numpy.ma.MaskedArray

        Raises
        ------
        LimitError
            For scalars, if the linkage cannot be closed at these angles.
        """
        return self._answer(self._forward, ("angles", "rad"), theta1_rad, theta2_rad)

    def inverse(self, x_mm, y_mm):
        """Return the angles with which the terminal is there; Eqs. 3 and 4 of the paper.

        Parameters
        ----------
        x_mm, y_mm : float or array_like
            Shapes that broadcast.

        Returns
        -------
        theta1_rad, theta2_rad : float or numpy.ma.MaskedArray
            From -pi to pi.

        Raises
        ------
        LimitError
            For scalars, if the terminal cannot be there.
        """
        return self._answer(self._inverse, ("terminal", "mm"), x_mm, y_mm)

    def forward_limits(self, theta1_rad, theta2_rad) -> np.ndarray:
        """Return the `Limit` code of each pair of angles.

        Parameters
        ----------
        theta1_rad, theta2_rad : float or array_like
            Shapes that broadcast.

        Returns
        -------
        numpy.ndarray of int8
            0 where the linkage closes.
        """
        return _blocks(self._forward, theta1_rad, theta2_rad)[2]

    def inverse_limits(self, x_mm, y_mm) -> np.ndarray:
        """Return the `Limit` code of each place.

        Parameters
        ----------
        x_mm, y_mm : float or array_like
            Shapes that broadcast.

        Returns
        -------
        numpy.ndarray of int8
            0 where the terminal can be.
        """
        return _blocks(self._inverse, x_mm, y_mm)[2]

    def jacobian(self, theta1_rad, theta2_rad):
        """Return d(x, y)/d(theta1, theta2).

        Parameters
        ----------
        theta1_rad, theta2_rad : float or array_like
            Shapes that broadcast.

        Returns
        -------
        numpy.ndarray or numpy.ma.MaskedArray, shape (..., 2, 2)
            In mm/rad; rows x and y. An array for scalars.

        Raises
        ------
        LimitError
            For scalars, if the linkage cannot be closed or is singular.
        """
        theta1_rad, theta2_rad, scalar = _pair(theta1_rad, theta2_rad)
        with np.errstate(all="ignore"):
            x, y, limit = self._forward(theta1_rad, theta2_rad)
            u1, u2, across = self._outer(theta1_rad, theta2_rad, x, y)
            _, b1, b2, _ = self.bar_mm
            in_line = abs(across) < _IN_LINE * b1 * b2
            limit = np.where((limit == 0) & in_line, Limit.SINGULAR, limit)
            # u_i is constant in length: u_i . dT = u_i . d(elbow_i).
            a1, _, _, a2 = self.bar_mm
            push1 = a1 * (u1[0] * np.cos(theta1_rad) - u1[1] * np.sin(theta1_rad))
            push2 = -a2 * (u2[0] * np.cos(theta2_rad) + u2[1] * np.sin(theta2_rad))
            rows = [[u2[1] * push1, -u1[1] * push2], [-u2[0] * push1, u1[0] * push2]]
            found = np.moveaxis(np.array(rows) / across, (0, 1), (-2, -1))
        if scalar:
            _refuse(limit, ("angles", "rad"), theta1_rad, theta2_rad)
            return found
        bad = np.broadcast_to((limit != 0)[..., None, None], found.shape)
        return np.ma.MaskedArray(np.where(bad, np.nan, found), mask=bad)

    def covariance(self, theta1_rad, theta2_rad, angles_rad2):
        """Return the covariance of the terminal that follows from that of the angles.

        Parameters
        ----------
        theta1_rad, theta2_rad : float or array_like
        angles_rad2 : array_like, shape (..., 2, 2)

        Returns
        -------
        numpy.ndarray or numpy.ma.MaskedArray, shape (..., 2, 2)
            In mm2, of x and y, to first order.

        Raises
        ------
        LimitError
            As `jacobian` does.
        """
        jacobian = self.jacobian(theta1_rad, theta2_rad)
        found = np.asarray(jacobian) @ np.asarray(angles_rad2, dtype=float)
        found = found @ np.swapaxes(np.asarray(jacobian), -1, -2)
        if not isinstance(jacobian, np.ma.MaskedArray):
            return found
        return np.ma.MaskedArray(found, mask=np.isnan(found))

    def outer_angle(self, theta1_rad, theta2_rad):
        """Return the angle between the outer bars, less what is beyond a right one.

        At 0 they are in line, and the terminal moves while the joints stand.

        Parameters
        ----------
        theta1_rad, theta2_rad : float or array_like
            Shapes that broadcast.

        Returns
        -------
        float or numpy.ma.MaskedArray
            In rad, from 0 to pi/2.

        Raises
        ------
        LimitError
            For scalars, if the linkage cannot be closed at these angles.
        """
        x, y = self.forward(theta1_rad, theta2_rad)
        _, b1, b2, _ = self.bar_mm
        *_, across = self._outer(theta1_rad, theta2_rad, x, y)
        sine = np.minimum(abs(across) / (b1 * b2), 1)
        return np.arcsin(sine) if isinstance(x, np.ma.MaskedArray) else float(np.arcsin(sine))

    def _answer(self, solve, names, first, second):
        scalar = np.ndim(first) == np.ndim(second) == 0
        a, b, limit = _blocks(solve, first, second)
        if scalar:
            _refuse(limit, names, first, second)
            return float(a), float(b)
        bad = limit != 0
        a[bad] = b[bad] = np.nan
        return np.ma.MaskedArray(a, mask=bad), np.ma.MaskedArray(b, mask=bad)

    def _outer(self, theta1, theta2, x, y):
        """Return the outer bars as vectors to the terminal, and the cross product of the two."""
        a1, _, _, a2 = self.bar_mm
        u1 = (x - a1 * np.sin(theta1), y - a1 * np.cos(theta1))
        u2 = (x - self.base_mm + a2 * np.sin(theta2), y - a2 * np.cos(theta2))
        return u1, u2, u1[0] * u2[1] - u1[1] * u2[0]

    def _forward(self, theta1, theta2):
        _, b1, b2, _ = self.bar_mm
        x, y, apart2, off2 = assembled(self.bar_mm, self.base_mm, self.side, theta1, theta2)
        # One comparison shows that all is well; which limit it is costs only where it is not.
        limit = np.zeros(np.shape(x), np.int8)
        if (~(off2 >= 0)).any() or (apart2 <= _ROUNDING * b1 * b1).any():
            apart = np.sqrt(apart2)
            codes = Limit.ELBOWS_APART, Limit.ELBOWS_CLOSE, Limit.ELBOWS_MEET
            limit = _bar_limits(apart, b1, b2, *codes)
            limit = np.where(np.isfinite(apart), limit, Limit.NOT_FINITE).astype(np.int8)
        return x, y, limit

    def _inverse(self, x, y):
        a1, b1, b2, a2 = self.bar_mm
        mirrored = self.base_mm - x
        theta1, limit1 = _arm(x, y, a1, b1)
        theta2, limit2 = _arm(mirrored, y, a2, b2)
        limit = np.where(limit1 != 0, limit1, np.where(limit2 != 0, limit2 + 1, 0))
        limit = np.where(np.isfinite(x) & np.isfinite(y), limit, Limit.NOT_FINITE)
        # On the line of the elbows the two assemblies are one.
        *_, across = self._outer(theta1, theta2, x, y)
        other = self.side * across < -_ROUNDING * b1 * b2
        limit = np.where((limit == 0) & other, Limit.OTHER_ASSEMBLY, limit)
        return theta1, theta2, limit.astype(np.int8)


def assembled(bar_mm, base_mm, side, theta1, theta2, least=0.0):
    """Return the terminal at two angles, the square of the elbows' distance, and `off2`.

    The terminal is where two circles about the elbows meet, as in the paper's Eqs. 3 and 4.

    Parameters
    ----------
    bar_mm : sequence of float, length 4
        Lengths of the bars from base joint 1 over the terminal to base joint 2.
    base_mm : float
        Distance of the base joints.
    side : int
        1 or -1: on which side of the line from elbow to elbow the terminal is.
    theta1, theta2 : array_like
        Angles of the base joints, in rad from +y towards the other joint; they broadcast.
    least : float
        Least `off2` that is used, which keeps a fit smooth that passes through angles where the
        linkage cannot be closed.

    Returns
    -------
    x, y : numpy.ndarray
        Place of the terminal, in mm.
    apart2 : numpy.ndarray
        Square of the elbows' distance, in mm**2.
    off2 : numpy.ndarray
        Square of the terminal's distance from the elbows' line, as a share of `apart2`; negative
        where the linkage cannot be closed.
    """
    a1, b1, b2, a2 = bar_mm
    x1, y1 = a1 * np.sin(theta1), a1 * np.cos(theta1)
    across_x = base_mm - a2 * np.sin(theta2) - x1
    across_y = a2 * np.cos(theta2) - y1
    apart2 = across_x * across_x + across_y * across_y
    # Along the line of the elbows, and off it, as shares of their distance.
    along = 0.5 if b1 == b2 else 0.5 + (b1 * b1 - b2 * b2) / (2 * apart2)
    off2 = b1 * b1 / apart2 - along * along
    off = side * np.sqrt(np.maximum(off2, least))
    x = x1 + along * across_x - off * across_y
    y = y1 + along * across_y + off * across_x
    return x, y, apart2, off2


def _arm(x, y, inner, outer):
    """Return the angle of one arm, and the `Limit` code if it is arm 1."""
    reach = np.hypot(x, y)
    # The cosine rule; for equal bars it is Eq. 3's sqrt(x^2 + y^2) / 2l.
    if inner == outer:
        cosine = reach / (inner + outer)
    else:
        cosine = (reach * reach + inner * inner - outer * outer) / (2 * inner * reach)
    theta = np.pi / 2 - np.arctan2(y, x) - np.arccos(np.clip(cosine, -1, 1))
    limit = _bar_limits(
        reach, inner, outer, Limit.BEYOND_ARM_1, Limit.WITHIN_ARM_1, Limit.AT_JOINT_1
    )
    turn = 2 * np.pi
    return np.where(abs(theta) > np.pi, theta - np.copysign(turn, theta), theta), limit


def _bar_limits(apart, a, b, beyond, within, meet):
    """Return the `Limit` codes of two bars with a common end, whose other ends are so far apart."""
    whole, difference = a + b, abs(a - b)
    slack = whole * _ROUNDING
    limit = np.where(apart > whole * (1 + _ROUNDING), beyond, 0)
    limit = np.where(apart < difference - slack, within, limit)
    return np.where((apart <= slack) & (difference <= slack), meet, limit)


def _pair(first, second):
    scalar = np.ndim(first) == np.ndim(second) == 0
    first, second = (np.ma.filled(np.ma.asarray(v, dtype=float), np.nan) for v in (first, second))
    return *np.broadcast_arrays(first, second), scalar


def _blocks(solve, first, second):
    """Solve block by block, which is several times faster than all at once for long arrays."""
    first, second, _ = _pair(first, second)
    shape = first.shape
    first, second = first.ravel(), second.ravel()
    a, b = np.empty(first.size), np.empty(first.size)
    limit = np.empty(first.size, np.int8)
    with np.errstate(all="ignore"):
        for start in range(0, first.size, _BLOCK):
            part = slice(start, start + _BLOCK)
            a[part], b[part], limit[part] = solve(first[part], second[part])
    return a.reshape(shape), b.reshape(shape), limit.reshape(shape)


def _refuse(limit, names, first, second) -> None:
    if limit:
        what, unit = names
        raise LimitError(Limit(int(limit)), f"the {what} ({first:.6g}, {second:.6g}) {unit}")
