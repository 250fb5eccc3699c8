"""``spots characterize``: checks the options, measures a sensor, prints tables, draws figures."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from spots.errors import SettingError, printable
from spots_device.reading.decode import AVERAGE_MAX
from spots_device.sensor.exposure import MAX_US, MIN_US

from ..strip.change import NONE
from ..strip.files import SensorFile, load, load_change
from . import figures, report
from .family import family
from .measurements import characterize
from .rezeroed import NO_HAND, Hand


def measure(
    sensor_name: str,
    seed: int,
    exposure_us: int,
    average: int,
    as_json: bool,
    out: str | None,
    change_name: str | None = None,
    hand: Hand = NO_HAND,
) -> None:
    """Measure the accuracy of a simulated sensor; print tables, or one JSON object with `as_json`.

    Sensor and change are names or paths of files. `out` is a folder for figures, if any. SpotsError
    if a file or an option is invalid, or the sensor cannot be calibrated.
    """
    if not MIN_US <= exposure_us <= MAX_US:
        raise SettingError(f"--exposure-us must be from {MIN_US} to {MAX_US}, not {exposure_us}")
    if not 1 <= average <= AVERAGE_MAX:
        raise SettingError(f"--average must be from 1 to {AVERAGE_MAX}, not {average}")
    hand.check()
    sensor = load(SensorFile, sensor_name)
    change = NONE if change_name is None else load_change(change_name)
    folder: Path | None = None
    if out is not None:
        figures.require()
        folder = figures.folder(out)
    with report.progress() as step:
        run = characterize(sensor, seed, exposure_us, average, step, change, hand)
        drawn = []
        if folder is not None:
            step("other lengths and dyes")
            responses = family(sensor, run.series["position"]["channels"], seed, exposure_us)
            drawn = figures.draw(run, responses, folder)
    if as_json:
        print(json.dumps(run.summary))
    else:
        report.show(run.summary)
    for path in drawn:
        print(printable(str(path)), file=sys.stderr)
