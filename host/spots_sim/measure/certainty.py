"""Compares the errors of single readings with their `sigma_um`, by force.

A stage calibrates a simulated strip. If its sensor file has a change (ageing), the strip then
changes, and is re-zeroed with three marks. Then presses at random places with random forces give
one reading each. Prints one line of JSON for each range of forces:

    python -m spots_sim.measure.certainty default real first --exposure-us 10000
"""

from __future__ import annotations

import argparse
import json
import math

import numpy as np

from spots.cli import arguments

from ..strip.change import NONE
from ..strip.files import SensorFile, load
from .rezeroed import Hand, age
from .rig import Rig

_BORDERS_N = 0.25, 0.5, 1.0, 3.0, 9.0  # of the ranges of forces
_ENDS = 0.04  # share of the length at both ends that is not pressed
_LIFTED_S = 0.5  # longer than some readings, so that the board sees the end of each touch
_MARKS = 3


def normalised(name: str, exposure_us: int, seed: int, presses: int) -> list[dict]:
    """Press a strip, and return rows with errors and sigmas of the trusted readings.

    ``median`` is that of the error divided by its sigma, 0.67 for a normal distribution;
    ``within_2_percent`` is the share of errors of at most two sigmas, 95.4 for it.
    """
    sensor = load(SensorFile, name)
    rng = np.random.default_rng((seed, 8))
    found = []
    with Rig(sensor, seed, exposure_us, 1) as rig:
        changes = sensor.change != NONE
        age(rig, sensor.change, Hand(_MARKS if changes else 0), seed)
        rig.board.learn(rig.shifted_lines, rig.board.info)
        for _ in range(presses):
            place_um = rng.uniform(_ENDS, 1 - _ENDS) * rig.stage.length_um
            force_N = math.exp(rng.uniform(*np.log([_BORDERS_N[0], _BORDERS_N[-1]])))
            rig.lift(_LIFTED_S)
            (touch,), _ = rig.readings(place_um, 1000 * force_N, 1)
            if touch.trusted:
                found.append((force_N, abs(touch.position_um - place_um), touch.sigma_um))
    force_N, off_um, sigma_um = np.array(found).T
    rows = []
    for low_N, high_N in zip(_BORDERS_N, _BORDERS_N[1:]):
        own = (low_N <= force_N) & (force_N < high_N)
        ratio = off_um[own] / sigma_um[own]
        rows.append(
            {
                "sensor": name,
                "exposure_us": exposure_us,
                "forces_N": [low_N, high_N],
                "readings": int(own.sum()),
                "error_rms_um": round(float(np.sqrt(np.mean(off_um[own] ** 2))), 1),
                "sigma_rms_um": round(float(np.sqrt(np.mean(sigma_um[own] ** 2))), 1),
                "median": round(float(np.median(ratio)), 2),
                "within_2_percent": round(100 * float(np.mean(ratio <= 2)), 1),
            }
        )
    return rows


def main() -> None:
    """Parse the command line, and print the results."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sensors", nargs="+", help="sensor files: paths or names")
    parser.add_argument("--exposure-us", type=arguments.exposure_us, default=10_000)
    parser.add_argument("--presses", type=int, default=600, help="presses of a strip (600)")
    parser.add_argument("--seed", type=arguments.seed, default=9400, help="random seed (9400)")
    options = parser.parse_args()
    for name in options.sensors:
        for row in normalised(name, options.exposure_us, options.seed, options.presses):
            print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
