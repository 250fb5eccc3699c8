"""The exposure for keys: the shortest one at which every key of a layout is certain."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from spots_device.board.settings import DEFAULT_US
from spots_device.fingers.tracker import ContactTracker
from spots_device.keys.layout import (
    HIGH,
    KEY_SIZE,
    LOW,
    default_lines,
    parse,  # pyright: ignore[reportUnknownVariableType]
)
from spots_device.reading.calibration import Calibration

_LIGHT_PRESS_MN = 1000.0  # 97 % of the touches of typing people are firmer
# A key is certain if three standard deviations of a light press are at most this share of its
# width. Then the noise moves no press out of its key that is aimed at the middle 70 % of the key.
_SHARE = 0.15
_SIGMAS = 3
# At shorter exposures two fingers are often not distinguished; longer ones would be slow to type.
_LEAST_US, _MOST_US, _STEP_US = 4_000, 20_000, 250


def shortest_us(
    calibration: Sequence[str], layout: Sequence[str], strain_ppm: int = 0
) -> int | None:
    """Return the shortest exposure at which every key of a layout is certain, in us.

    A shorter exposure reports a touch earlier, but the position is noisier. A calibration is valid
    at any exposure. The noise is the limit that the board itself assumes, that of the end of the
    strip where the positions are noisiest.

    The result is at least 4000; None if not even 20 ms suffice, or if another version of the
    firmware has made the lines. Without a layout, the default layout counts.
    """
    try:
        made: Any = Calibration(calibration, strain_ppm)
        keys: Any = parse(layout or default_lines())
    except ValueError:
        return None
    tracker: Any = ContactTracker(None)
    tracker.set_layout(keys, made.length_um, made.decay)
    rows = range(0, len(keys.keys), KEY_SIZE)
    width_um = min(keys.keys[i + HIGH] - keys.keys[i + LOW] for i in rows) * made.length_um / 1000
    forces_mN: list[float] = list(made.forces_mN)
    brightnesses: list[float] = list(made.brightnesses)
    made_at = float(np.interp(_LIGHT_PRESS_MN, forces_mN, brightnesses))
    for exposure_us in range(_LEAST_US, _MOST_US + 1, _STEP_US):
        longer = math.log2(exposure_us / made.conditions.exposure_us)
        noise_um = tracker.noise_um(round(made_at + longer * (1 << 20)))
        if _SIGMAS * noise_um <= _SHARE * width_um:
            return exposure_us
    return None


def is_automatic(exposure_us: int, chosen_us: int | None) -> bool:
    """Return whether an exposure may be replaced: the default, or one that `shortest_us` chose."""
    # The board rounds exposures to the steps of its sensor.
    return any(abs(exposure_us - one) <= one // 100 for one in (DEFAULT_US, chosen_us or _MOST_US))


def sentence(exposure_us: int, chosen_us: int | None) -> str:
    """Return what an exposure means for the keys, with the result of `shortest_us` for them."""
    now = f"exposure of {exposure_us / 1000:.1f} ms"
    if chosen_us is None:
        return f"{now}: at no exposure every key is certain; make the keys wider, or fewer"
    if abs(exposure_us - chosen_us) <= chosen_us // 100:
        return f"{now}, the shortest at which every key is certain"
    least = f"from {chosen_us / 1000:.1f} ms on every key is certain"
    if exposure_us > chosen_us:
        return f"{now}; {least}: 'set exposure_us={chosen_us}' types faster"
    return f"{now} is too short: {least}; send 'set exposure_us={chosen_us}'"
