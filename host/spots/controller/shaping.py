"""Pure functions that convert a position or force to the deflection of an axis."""


def deflection(value: float, rest: float, low: float, high: float) -> float:
    """Map a value to a deflection: -1 at `low`, 0 at `rest`, 1 at `high`, linear in between.

    `rest` need not be in the middle. ``low=-math.inf`` makes a one-sided axis. Beyond the ends, the
    deflection stays -1 or 1.
    """
    share = (value - rest) / (high - rest) if value >= rest else (value - rest) / (rest - low)
    return max(-1.0, min(share, 1.0))


def deadband(u: float, width: float) -> float:
    """Apply a deadband: return 0 if `u` is within `width` of 0, and rescale larger deflections.

    The result is a continuous function of the deflection; `width` must be below 1.
    """
    if abs(u) <= width:
        return 0.0
    return (u - width if u > 0 else u + width) / (1 - width)


def expo(u: float, amount: float) -> float:
    """Mix a deflection with its cube, which makes the axis less sensitive near 0.

    `amount` is the share of the cube.
    """
    return u - amount * (u - u**3)


def shaped(u: float, width: float, amount: float, invert: bool) -> float:
    """Apply deadband, expo and inversion to a deflection."""
    u = expo(deadband(u, width), amount)
    return -u if invert else u
