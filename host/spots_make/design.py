"""``spots design``: finds dye and exposure for the best resolution on a strip of a given length.

With ``--out`` it also writes moulds, drawings and instructions for the strip, see shape.py.

The predicted resolution is the Cramer-Rao bound of `bound.Bound`, for a press with the force
`measurements.FORCE_MN`. Gain and LED current are those that the command ``autoexpose`` would set.
All values except length and dye are those of the default sensor.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from spots.calibrate.fit.presses import FULL_MN
from spots.common import atomic
from spots.errors import FileError, SettingError, printable
from spots_device.board.settings import DEFAULT_CHANNELS
from spots_device.reading.decode import AVERAGE_MAX
from spots_device.sensor.exposure import (
    AGAIN,
    DEFAULT_GAIN,
    DEFAULT_LED_MA,
    DONE,
    MAX_US,
    MIN_US,
    actual_us,
    full_scale,
    registers,
)
from spots_device.sensor.search import Search
from spots_sim.measure import figures
from spots_sim.measure.bound import Bound
from spots_sim.measure.measurements import FORCE_MN, PLACES
from spots_sim.person.stage import NEAR_UM
from spots_sim.strip.files import SensorFile, load, to_toml

from . import drawing, mould, parts
from . import recipe as recipes
from . import shape as dims
from .shape import StripShape

_SENSOR_FILE = "sensor.toml"
LED_MAX_MA = 100  # of the virtual board, the same as in boards/virtual/board.toml
# Above this exposure, full scale does not grow: more samples are averaged instead.
_LONGEST_US = 182_000
_DYES_PER_MM = (1e-4, 1.0)
# The search for the dye tries `_COARSE` strengths over this range. Then it repeatedly tries `_FINE`
# strengths around the best one, until neighbouring strengths differ by less than `_FINE_SHARE`.
_COARSE, _FINE = 25, 7
_FINE_SHARE = 5e-3
# With fewer counts at the far end, rounding dominates a channel, and the bound is not valid for
# its logarithm.
_COUNTS_MIN = 10.0
# Limits of the options: a value outside them was probably given in another unit.
_LENGTHS_MM = 1.0, 10_000.0
_SENSOR = atomic.Kind("a sensor file", lambda path: load(SensorFile, path))
_FINEST_UM = 1e-3
_SLOWEST_HZ = math.ceil(1e9 / (AVERAGE_MAX * MAX_US)) / 1e3  # rounded up, as messages show it
_FASTEST_HZ = 1e6 / MIN_US


@dataclass(frozen=True)
class Design:
    """A strip, the settings to read it with, and its expected resolution.

    `gain` (register code) and `led_mA` are what the command ``autoexpose`` will set. `average` is
    the number of samples in a reading. `sigma_um` is the resolution expected at each of the
    positions `x_um`, shape (n,).
    """

    sensor: SensorFile
    exposure_us: int
    average: int
    gain: int
    led_mA: int
    x_um: np.ndarray
    sigma_um: np.ndarray

    @property
    def resolution_um(self) -> float:
        """Mean of the expected resolution in um, over positions from 5 to 95 % of the length."""
        return float(self.sigma_um.mean())

    @property
    def dye_per_mm(self) -> float:
        """Strength of the dye, as its decay coefficient per mm."""
        return self.sensor.dye.strength_per_mm

    def summary(self) -> dict:
        """Return the design as ``spots design --json`` prints it."""
        return {
            "length_mm": self.sensor.length_mm,
            "dye_per_mm": round(self.dye_per_mm, 5),
            "exposure_us": self.exposure_us,
            "average": self.average,
            "rate_hz": round(1e6 / (self.exposure_us * self.average), 3),
            "gain": self.gain,
            "led_mA": self.led_mA,
            "resolution_um": round(self.resolution_um, 3),
            "worst_um": round(float(self.sigma_um.max()), 3),
            "along": [
                {"position_mm": round(x / 1000, 3), "resolution_um": round(sigma, 3)}
                for x, sigma in zip(self.x_um.tolist(), self.sigma_um.tolist())
            ],
        }


def timing(rate_hz: float) -> tuple[int, int]:
    """Return exposure in us and samples per reading that give about `rate_hz` readings a second."""
    reading_us = 1e6 / rate_hz
    average = min(AVERAGE_MAX, max(1, math.ceil(reading_us / _LONGEST_US)))
    exposure_us = min(MAX_US, max(MIN_US, int(reading_us / average)))
    return actual_us(*registers(exposure_us)), average


def best(length_mm: float, rate_hz: float) -> Design:
    """Return the design whose mean resolution along the strip is best.

    SettingError if the far end is too dark with every dye.
    """
    base = load(SensorFile, "default")
    exposure_us, average = timing(rate_hz)

    def at(dye_per_mm: float) -> Design | None:
        dye = msgspec.structs.replace(base.dye, strength_per_mm=float(dye_per_mm))
        sensor = msgspec.structs.replace(base, length_mm=length_mm, dye=dye)
        return _predicted(sensor, exposure_us, average)

    dyes = np.geomspace(*_DYES_PER_MM, _COARSE)
    while True:
        found = [(design.resolution_um, i, design) for i, d in enumerate(dyes) if (design := at(d))]
        if not found:
            raise SettingError(
                f"the end of a {length_mm:g} mm strip is too dark at {rate_hz:g} Hz with any dye: "
                "choose a shorter strip or a lower rate"
            )
        _, i, design = min(found)
        if dyes[1] < dyes[0] * (1 + _FINE_SHARE):
            return design
        dyes = np.geomspace(dyes[max(i - 1, 0)], dyes[min(i + 1, len(dyes) - 1)], _FINE)


def _predicted(sensor: SensorFile, exposure_us: int, average: int) -> Design | None:
    setting = _searched(sensor, exposure_us)
    if setting is None:
        return None
    bound = Bound(sensor, DEFAULT_CHANNELS, *setting, average)
    gain, _, led_mA = setting
    if bound.counts(1000 * sensor.length_mm, FORCE_MN).min() < _COUNTS_MIN:
        return None
    x_um = PLACES * 1000 * sensor.length_mm
    sigma_um = np.array([bound.sigma(x, FORCE_MN)[0] for x in x_um])
    return Design(sensor, exposure_us, average, gain, led_mA, x_um, sigma_um)


def _searched(sensor: SensorFile, exposure_us: int) -> tuple[int, int, int] | None:
    """Return the setting that ``autoexpose`` would find for a sensor at a fixed exposure.

    The setting is gain code, exposure in us and LED current in mA; None if the light is too weak or
    too strong at every setting.
    """
    full = full_scale(*registers(exposure_us))
    search = Search(DEFAULT_GAIN, DEFAULT_LED_MA, exposure_us, LED_MAX_MA)
    outcome = AGAIN
    while outcome == AGAIN and search.exposure_us == exposure_us:
        setting = search.gain, exposure_us, search.led_mA
        peak = round(Bound(sensor, DEFAULT_CHANNELS, *setting).counts(NEAR_UM, FULL_MN).max())
        outcome = search.step(min(peak, full), full, peak >= full)
    # If the search would lengthen the exposure, gain and current are at their maximum.
    return setting if outcome in (DONE, AGAIN) else None


def design(length_mm: float, resolution_um: float, rate_hz: float) -> Design:
    """Return a design that reaches a mean resolution, for a given length and rate.

    SettingError if a value is out of range, the strip is too dark, or the resolution cannot be
    reached. In the last case, the message has the best resolution at this rate.
    """
    for name, value, low, high in (
        ("length-mm", length_mm, *_LENGTHS_MM),
        ("resolution-um", resolution_um, _FINEST_UM, 1000 * length_mm),
        ("rate-hz", rate_hz, _SLOWEST_HZ, _FASTEST_HZ),
    ):
        if not low <= value <= high:
            unit = name.rpartition("-")[2].replace("hz", "Hz")
            raise SettingError(f"--{name} must be from {low:.3g} to {high:g} {unit}, not {value:g}")
    found = best(length_mm, rate_hz)
    if found.resolution_um <= resolution_um:
        return found
    raise SettingError(
        f"a resolution of {resolution_um:g} um over {length_mm:g} mm cannot be reached at "
        f"{rate_hz:g} Hz: the best resolution is {found.resolution_um:.3g} um, with a dye strength "
        f"of {found.dye_per_mm:.3g} per mm; {_slower(length_mm, resolution_um, rate_hz)}"
    )


def _slower(length_mm: float, resolution_um: float, rate_hz: float) -> str:
    if best(length_mm, _SLOWEST_HZ).resolution_um > resolution_um:
        return f"no rate down to {_SLOWEST_HZ:.3g} Hz suffices: choose a shorter strip"
    low_hz, high_hz = _SLOWEST_HZ, rate_hz
    while high_hz > 1.01 * low_hz:
        middle_hz = math.sqrt(low_hz * high_hz)
        if best(length_mm, middle_hz).resolution_um <= resolution_um:
            low_hz = middle_hz
        else:
            high_hz = middle_hz
    # Rounded down, so that the resolution can be reached at the printed rate.
    digits = 10.0 ** (math.floor(math.log10(low_hz)) - 2)
    return f"choose a rate of at most {math.floor(low_hz / digits) * digits:.3g} Hz"


def sensor_toml(found: Design) -> str:
    """Return the sensor file of a design as TOML text."""
    lines = [
        f"# Designed for {found.sensor.length_mm:g} mm: {found.resolution_um:.3g} um expected with",
        f"# exposure_us={found.exposure_us} average={found.average}.",
        "# Other values are those of default.toml, which names their sources.",
        "",
    ]
    return "\n".join(lines) + "\n" + to_toml(found.sensor)


def design_command(options: argparse.Namespace) -> None:
    """Run ``spots design`` with the options that `cli` parsed.

    The folder ``options.out`` gets the sensor file and a figure. If moulds can be made for the
    length, it also gets moulds, drawings and recipe. If ``options.out`` is None, no files are
    written.
    """
    out, shape = options.out, None
    recipe = recipes.checked(options.strips)
    if out is not None:
        figures.require()
        figures.check_folder(out)
        if Path(out, _SENSOR_FILE).is_file():
            raise FileError(f"{out} has a design: name another folder, or remove it", Path(out))
        if dims.has_moulds(options.length_mm):
            mould.require()
            shape = StripShape(options.length_mm, options.breakout)
    found = design(options.length_mm, options.resolution_um, options.rate_hz)
    print(json.dumps(found.summary()) if options.json else _text(found))
    if out is None:
        return
    folder = figures.folder(out)
    sensor_file = folder / _SENSOR_FILE
    atomic.write_text(sensor_toml(found), sensor_file, _SENSOR)
    made = [sensor_file, _plot(found, options.resolution_um, folder / "resolution.png")]
    if shape is not None:
        made += _to_make(shape, recipe, found, options, folder)
    for path in made:
        print(printable(str(path)), file=sys.stderr)
    if shape is None:
        low, high = dims.LENGTHS_MM
        print(
            f"no moulds were made: moulds are for strips of {low:g} to {high:g} mm",
            file=sys.stderr,
        )


def _to_make(shape, strips: int, found: Design, options, folder: Path) -> list[Path]:
    """Write moulds, drawings and recipe of a design into a folder; return the files."""
    line = (
        f"spots design --length-mm {options.length_mm:g} "
        f"--resolution-um {options.resolution_um:g} --rate-hz {options.rate_hz:g}"
    )
    recipe = folder / "build.md"
    atomic.write_text(recipes.text(shape, strips, found.dye_per_mm, line), recipe, recipes.KIND)
    bill = folder / "parts.csv"
    atomic.write_text(parts.csv_text(shape, strips), bill, parts.KIND)
    return [recipe, bill, *drawing.write(shape, folder), *mould.write(shape, folder)]


def _text(found: Design) -> str:
    summary = found.summary()
    ends = summary["along"][0], summary["along"][-1]
    rows = {
        "length": f"{summary['length_mm']:g} mm",
        "dye": f"{summary['dye_per_mm']:g} per mm",
        "reading": f"{found.average} x {found.exposure_us / 1000:g} ms, {summary['rate_hz']:g} Hz",
        "setting": f"gain {found.gain}, {found.led_mA} mA, as 'autoexpose' finds them",
        "resolution": f"{found.resolution_um:.3g} um, the mean from 5 to 95 % of the length",
        "": ", ".join(
            f"{end['resolution_um']:.3g} um at {end['position_mm']:g} mm" for end in ends
        ),
    }
    return "\n".join(f"{name:<12}{value}" for name, value in rows.items())


def _plot(found: Design, wanted_um: float, path: Path) -> Path:
    figure, axis = figures.panels()
    x_mm = found.x_um / 1000
    figures.line(axis, 0, x_mm, found.sigma_um, "expected")
    axis.axhline(found.resolution_um, color="black", label=f"mean, {found.resolution_um:.3g} µm")
    axis.axhline(wanted_um, color="#D55E00", linestyle="--", label=f"wanted, {wanted_um:g} µm")
    title = (
        f"{found.sensor.length_mm:g} mm with a dye strength of {found.dye_per_mm:.3g} per mm, "
        f"{found.exposure_us * found.average / 1000:.4g} ms a reading"
    )
    figures.label(axis, title, "position (mm)", "resolution (µm)", ylim=(0, None))
    figures.legend(axis)
    return figures.save(figure, path)
