"""Measures whether strips of different lengths and dye strengths have the same response.

The response is the logarithm of the ratio of two channels, as a function of the position.
"""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np

from ..person.stage import Stage
from ..strip.files import SensorFile

LENGTHS_MM = (30.0, 85.0, 200.0)
DYES = (0.5, 1.0, 2.0)  # dye strength relative to that of the sensor
_PLACES = 18
_SAMPLES = 12
_LIT = 4.0  # minimum counts: below this, rounding dominates the logarithm
_CURVE_DEGREE = 7


@dataclass(frozen=True)
class Response:
    """Natural logarithm of the ratio of two channels' counts along a strip.

    Positions are counted from the sensor's end; both arrays have shape (n,).
    """

    x_um: np.ndarray
    log_ratio: np.ndarray


def family(
    sensor: SensorFile, channels: tuple[str, str], seed: int, exposure_us: int
) -> dict[str, dict[float, Response]]:
    """Measure the responses of strips of different lengths and dyes, with the real firmware.

    The ratio is the second channel divided by the first. The keys are ``length``, with responses by
    length in mm, and ``dye``, with responses by relative dye strength.
    """

    def measured(**changes):
        return _response(msgspec.structs.replace(sensor, **changes), channels, seed, exposure_us)

    def dyed(times: float):
        strength = times * sensor.dye.strength_per_mm
        return msgspec.structs.replace(sensor.dye, strength_per_mm=strength)

    return {
        "length": {mm: measured(length_mm=mm) for mm in LENGTHS_MM},
        "dye": {times: measured(dye=dyed(times)) for times in DYES},
    }


def departure_um(lengths: dict[float, Response]) -> float:
    """Return the largest position error if the longest strip's response is used for all lengths.

    It is 0 if the response does not depend on the length of the strip. The keys are lengths in mm.
    """
    longest = lengths[max(lengths)]
    degree = min(_CURVE_DEGREE, len(longest.x_um) // 2)
    curve = np.polynomial.Chebyshev.fit(longest.x_um, longest.log_ratio, degree)
    slope = curve.deriv()
    return float(
        max(
            np.abs((other.log_ratio - curve(other.x_um)) / slope(other.x_um)).max()
            for length_mm, other in lengths.items()
            if length_mm != max(lengths)
        )
    )


def _response(sensor: SensorFile, channels, seed: int, exposure_us: int) -> Response:
    with Stage(sensor, seed, f"exposure_us={exposure_us}") as stage:
        stage.expose(exposure_us)
        along = stage.along(_PLACES, _SAMPLES)
        i, j = (stage.reader.conditions.plan.index(name) for name in channels)
    along = along.keep((along.counts > _LIT).all(axis=1))
    return Response(along.position_um, np.log(along.counts[:, j] / along.counts[:, i]))
