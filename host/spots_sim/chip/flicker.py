"""The flicker detector of a simulated AS7341."""

from __future__ import annotations

import numpy as np

# FD_STATUS: bits of a complete measurement, and the bit of each frequency. No document defines the
# duration of a measurement, or the smallest flicker that is detected.
_VALID, _HZ = 0x2C, {100: 0x01, 120: 0x02}
_DURATION_US, _STEP_US, _LEAST = 500_000.0, 1000.0, 0.01


def flicker_status(light, since_us: float | None, now_us: float) -> int:
    """Return the register FD_STATUS of a detector that is on since `since_us`, or off if None.

    `light` has ``outside``, see `as7341`.
    """
    if since_us is None or now_us - since_us < _DURATION_US:
        return 0
    at_us = np.arange(now_us - _DURATION_US, now_us, _STEP_US)
    outside = np.array([light.outside(t, t + _STEP_US) for t in at_us.tolist()])
    swings = {hz: 2 * abs(np.mean(outside * np.exp(-2e-6j * np.pi * hz * at_us))) for hz in _HZ}
    found = max(swings, key=swings.get)
    return _VALID | (_HZ[found] if swings[found] > _LEAST * outside.mean() else 0)
