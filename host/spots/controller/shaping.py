"""What turns a reading into a stick's deflection: pure functions of one number."""

from __future__ import annotations


def deflection(value: float, rest: float, low: float, high: float) -> float:
    """Return -1 at `low`, 0 at `rest`, 1 at `high`, in straight lines, and no more beyond.

    Rest need not be in the middle; ``low=-math.inf`` makes an axis of one side.

    Parameters
    ----------
    value : float
        Position or force, in any unit.
    rest, low, high : float
        In the same unit, ``low < rest < high``.

    Returns
    -------
    float
        From -1 to 1.
    """
    share = (value - rest) / (high - rest) if value >= rest else (value - rest) / (rest - low)
    return max(-1.0, min(share, 1.0))


def deadband(u: float, width: float) -> float:
    """Return 0 within `width` (0 to below 1) of 0; the rest is stretched to begin at 0.

    Parameters
    ----------
    u : float
        Deflection, from -1 to 1.
    width : float
        From 0 to below 1.

    Returns
    -------
    float
        From -1 to 1; continuous.
    """
    if abs(u) <= width:
        return 0.0
    return (u - width if u > 0 else u + width) / (1 - width)


def expo(u: float, amount: float) -> float:
    """Return a mix of `u` and its cube: `amount` (0 to 1) makes it finer near 0.

    Parameters
    ----------
    u : float
        Deflection, from -1 to 1.
    amount : float
        0 for a straight line, 1 for the cube.

    Returns
    -------
    float
        From -1 to 1.
    """
    return u - amount * (u - u**3)


def shaped(u: float, width: float, amount: float, invert: bool) -> float:
    """Return a deflection after deadband, expo and inversion.

    Parameters
    ----------
    u : float
        Deflection, from -1 to 1.
    width : float
        Of the deadband, see `deadband`.
    amount : float
        Of the cube, see `expo`.
    invert : bool
        Whether the sign is changed.

    Returns
    -------
    float
        From -1 to 1.
    """
    u = expo(deadband(u, width), amount)
    return -u if invert else u
