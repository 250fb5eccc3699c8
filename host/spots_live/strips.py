"""Tables of simulated strips for the page: the light of a press, and calibrations."""

from __future__ import annotations

import numpy as np

from spots.calibrate.fit.expect import expected
from spots_device.board.settings import checksum
from spots_device.reading.calibration import Calibration
from spots_sim.measure.rezeroed import recalibrated
from spots_sim.person.stage import board_lines, calibrate
from spots_sim.strip.change import Change
from spots_sim.strip.files import SensorFile, load
from spots_sim.strip.optics import Optics

BOARD_ID = "7ab00000000000f1"  # of the board in a tab
# Strips to choose from: their title on the page, and whether their calibration is re-zeroed.
STRIPS = {
    "default": ("ideal", False),
    "real": ("aged", False),
    "real-rezeroed": ("aged, re-zeroed", True),
    "first": ("home-made", False),
    "first-rezeroed": ("home-made, re-zeroed", True),
}
# What the control "drift" of the page reaches at its end: about 2 mm, which no reading shows.
DRIFT = Change(dye_percent=-5.0)
_STEP_MM = 1.0  # between positions of the table; the page interpolates the logarithms: below 1 um
_SHARES = 0.0, 0.5, 1.0  # contact shares, if the colour depends on them
_WIDTH_MM = 4.0  # contact of a finger, as in `files.Finger`


def strip(name: str) -> dict:
    """Return all that the page needs of a strip of `STRIPS` but its light, for JSON."""
    title, rezeroed = STRIPS[name]
    sensor = load(SensorFile, light_of(name))
    lines = board_lines(recalibrated(sensor) if rezeroed else calibrate(sensor), BOARD_ID)
    made = Calibration(lines).conditions
    position_um, logs = expected(lines)
    return {
        "title": title,
        "light": light_of(name),
        "settings": (
            f"set gain={made.gain} exposure_us={made.exposure_us} led_mA={made.led_mA} "
            f"channels={','.join(made.plan)}"
        ),
        "calibration": {"lines": lines, "checksum": checksum(lines)},
        "expected": {
            "from_um": float(position_um[0]),
            "step_um": float(position_um[1] - position_um[0]),
            "logs": logs.round(3),
        },
    }


def light_of(name: str) -> str:
    """Return the name of the light of a strip, for `light`: a re-zero does not change it."""
    return name.partition("-")[0]


def light(name: str) -> dict:
    """Return what `light.js` needs to compute the light of presses, see `world.World`."""
    sensor = load(SensorFile, name)
    contact, led, around, noise = (
        sensor.contact,
        sensor.led,
        sensor.surroundings,
        sensor.converter,
    )
    now, drifted = Optics(sensor, sensor.change), Optics(sensor, sensor.change + DRIFT)
    places_mm = np.arange(0, sensor.length_mm + _STEP_MM / 2, _STEP_MM)
    shares = _SHARES if now.coloured else (1.0,)
    dust = sum(
        (percent / 100 * now.press(place, 0.0) for place, percent in contact.dust),
        np.zeros(len(now.names)),
    )
    return {
        "diodes": now.names,
        "length_mm": sensor.length_mm,
        "step_mm": _STEP_MM,
        "logs": [_logs(now, places_mm, share) for share in shares],
        "drift": [
            (_logs(drifted, places_mm, share) - _logs(now, places_mm, share)) for share in shares
        ],
        "dust": dust,
        "ambient": now.ambient(1.0),
        "contact": {
            name: getattr(contact, name)
            for name in ("threshold_mN", "half_mN", "early_share", "early_mN")
        },
        "led": {
            "uW_cm2_per_mA": now.source_uW_cm2(1.0) * (1 + 1 / led.bend_mA),
            "bend_mA": led.bend_mA,
            "noise_ppm_10ms": led.noise_ppm_10ms,
        },
        "lamp": {
            "uW_cm2": around.irradiance_uW_cm2,
            "flicker_percent": around.flicker_percent,
            "flicker_hz": around.flicker_hz,
        },
        "noise": {
            "read_counts": noise.read_noise_counts,
            "electrons_per_count_1x": noise.electrons_per_count_1x,
            "dark_counts_512x": noise.dark_counts_512x,
            "ratio_ppm": noise.ratio_noise_ppm,
        },
    }


def _logs(optics: Optics, places_mm: np.ndarray, share: float) -> np.ndarray:
    # Natural logarithms of the count rates, by place and diode.
    given = {"share": share} if optics.coloured else {}
    rates = [optics.press(float(place), _WIDTH_MM, skin=True, **given) for place in places_mm]
    return np.log(rates)
