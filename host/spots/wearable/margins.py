"""Confidence that a measured value is above or below the limit of a gesture."""

import math

# The confidence is 50 % at a limit, and 88 % where a value is a quarter better than its limit.
_STEEPNESS = 8.0


def above(value: float, limit: float) -> float:
    """Return the confidence that a value is above a limit: 0.5 at it, 0.9 at 1.27 times it."""
    return 1 / (1 + math.exp(-_STEEPNESS * (value / limit - 1)))


def below(value: float, limit: float) -> float:
    """Return the confidence that a value is below a limit; 0.5 at the limit."""
    return 1 - above(value, limit)
