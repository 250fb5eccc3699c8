"""Pure functions that convert a position or force to the deflection of an axis."""


def deflection(value: float, rest: float, low: float, high: float) -> float:
    """Map a value to a deflection: -1 at `low`, 0 at `rest`, 1 at `high`, linear in between.

    `rest` need not be in the middle. ``low=-math.inf`` makes a one-sided axis.

    Parameters
    ----------
    value : float
        Position or force, in any unit.
    rest, low, high : float
        Values at rest and at both ends, in the same unit; ``low < rest < high``.

    Returns
    -------
    float
        Deflection, limited to -1 to 1.
    """
    share = (value - rest) / (high - rest) if value >= rest else (value - rest) / (rest - low)
    return max(-1.0, min(share, 1.0))


def deadband(u: float, width: float) -> float:
    """Apply a deadband: return 0 if `u` is within `width` of 0, and rescale larger deflections.

    Parameters
    ----------
    u : float
        Deflection, from -1 to 1.
    width : float
        Half width of the deadband, from 0 to below 1.

    Returns
    -------
    float
        Deflection, from -1 to 1; a continuous function of `u`.
    """
    if abs(u) <= width:
        return 0.0
    return (u - width if u > 0 else u + width) / (1 - width)


def expo(u: float, amount: float) -> float:
    """Mix a deflection with its cube, which makes the axis less sensitive near 0.

    Parameters
    ----------
    u : float
        Deflection, from -1 to 1.
    amount : float
        Share of the cube: 0 for a straight line, 1 for the cube alone.

    Returns
    -------
    float
        Deflection, from -1 to 1.
    """
    return u - amount * (u - u**3)


def shaped(u: float, width: float, amount: float, invert: bool) -> float:
    """Apply deadband, expo and inversion to a deflection.

    Parameters
    ----------
    u : float
        Deflection, from -1 to 1.
    width : float
        Half width of the deadband, see `deadband`.
    amount : float
        Share of the cube, see `expo`.
    invert : bool
        Whether to change the sign.

    Returns
    -------
    float
        Deflection, from -1 to 1.
    """
    u = expo(deadband(u, width), amount)
    return -u if invert else u
