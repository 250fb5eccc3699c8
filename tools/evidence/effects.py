"""Measures position errors of a simulated strip at several forces, with effects of real strips.

A stage with an indenter calibrates the strip. Then a finger presses it at 19 other places, in
random order. The program prints a line for each force. Its command line changes keys of the sensor
file:

    PYTHONPATH=tools python -m evidence.effects --set contact.gap_percent=10 --exposure-us 10000
    PYTHONPATH=tools python -m evidence.effects --later phosphor_nm=0.5 --rezero 3
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import asdict, dataclass

import msgspec
import numpy as np

from spots.calibrate.calibration_file import FINGER, INDENTER
from spots.calibrate.pressers import used_by
from spots.cli import arguments
from spots.common import schema, toml
from spots.errors import SettingError, SpotsError
from spots_sim.measure.measurements import PLACES, bound_of
from spots_sim.measure.rezeroed import Hand, age
from spots_sim.measure.rig import Rig
from spots_sim.person.by_hand import calibrate_by_hand
from spots_sim.strip.files import SensorFile, load

FORCES_N = (0.6, 1.0, 3.0)
_READINGS = 20  # at each place
_LIFTED_S = 0.3  # between two places, as of a typist
_JITTER_UM = 50.0  # largest offset of a press, so that the rounding of counts averages out


@dataclass(frozen=True)
class Errors:
    """Position errors of presses with one force; None where fewer than two readings have a touch.

    Attributes
    ----------
    force_N : float
        Force in N.
    error_mm, worst_error_mm : float or None
        Mean absolute error of a reading, over all places and at the worst place, in mm.
    bias_mm, worst_bias_mm : float or None
        Absolute value of the mean error at a place: mean over all places, and at the worst place.
    scatter_to_bound : float or None
        Standard deviation of the error divided by its Cramer-Rao bound; mean over all places.
    untrusted_percent : float
        Share of the readings that the board marks as untrusted, in per cent.
    missing_percent : float
        Share of the readings without a position, or without a touch, in per cent.
    """

    force_N: float
    error_mm: float | None
    worst_error_mm: float | None
    bias_mm: float | None
    worst_bias_mm: float | None
    scatter_to_bound: float | None
    untrusted_percent: float
    missing_percent: float


def with_keys(sensor: SensorFile, keys: dict[str, object]) -> SensorFile:
    """Return a copy of a sensor with other values of some keys, such as ``dye.edge_nm``.

    Parameters
    ----------
    sensor : SensorFile
        Sensor to copy.
    keys : dict
        Values by key. A dot separates the names of a table and of a key in it.

    Returns
    -------
    SensorFile

    Raises
    ------
    SettingError
        If a key is unknown, or a value is invalid.
    """
    content = msgspec.to_builtins(sensor)
    for name, value in keys.items():
        *tables, key = name.split(".")
        table = content
        for one in tables:
            table = table.setdefault(one, {})
        table[key] = value
    try:
        return schema.convert(content, SensorFile)
    except schema.WrongKeyError as error:
        raise SettingError(str(error)) from None


def errors(
    rig: Rig, forces_N=FORCES_N, seed: int = 0, readings: int = _READINGS, places=PLACES
) -> list[Errors]:
    """Press a calibrated strip with several forces, and compare the readings with the truth.

    Parameters
    ----------
    rig : Rig
        Calibrated strip.
    forces_N : sequence of float
        Forces in N.
    seed : int
        Random seed of the presses.
    readings : int
        Number of presses at each place; each gives one reading.
    places : sequence of float
        Places to press, as shares of the strip's length.

    Returns
    -------
    list of Errors
        One element for each force.
    """
    rng = np.random.default_rng((seed, 7))
    return [_at(rig, force_N, rng, readings, places) for force_N in forces_N]


def _at(rig: Rig, force_N: float, rng, readings: int, places) -> Errors:
    bound = bound_of(rig)
    columns = []
    for share in rng.permutation(places).tolist():
        place_um = share * rig.stage.length_um
        rig.lift(_LIFTED_S)
        rows = []
        for _ in range(readings):
            at_um = place_um + rng.uniform(-_JITTER_UM, _JITTER_UM)
            (reading,), _ = rig.readings(at_um, 1000 * force_N, 1)
            is_missing = math.isnan(reading.position_um) or not reading.touching
            rows.append((reading.position_um - at_um, reading.trusted, is_missing))
        off_um, trusted, missing = np.array(rows, float).T
        off_um = off_um[missing == 0]
        if len(off_um) > 1:
            least_um, _ = bound.sigma(place_um, 1000 * force_N, bend_deg=rig.stage.held.bend_deg)
            off = np.abs(off_um).mean() / 1000, abs(off_um.mean()) / 1000
            columns.append((*off, off_um.std(ddof=1) / least_um, trusted.mean(), missing.mean()))
        else:
            columns.append((np.nan, np.nan, np.nan, trusted.mean(), missing.mean()))
    error_mm, bias_mm, scatter, trusted, missing = np.array(columns).T
    found = [
        *_mean_and_worst(error_mm),
        *_mean_and_worst(bias_mm),
        _mean_and_worst(scatter)[0],
        100 * (1 - trusted.mean()),
        100 * missing.mean(),
    ]
    return Errors(force_N, *(None if np.isnan(one) else round(float(one), 4) for one in found))


def _mean_and_worst(values: np.ndarray) -> tuple[float, float]:
    known = values[np.isfinite(values)]
    return (known.mean(), known.max()) if known.size else (np.nan, np.nan)


def show(rows: list[Errors]) -> None:
    """Print position errors as a table of plain text."""
    head = "force N", "error mm", "worst", "bias mm", "worst", "scatter/bound", "untrusted %"
    print("".join(f"{word:>14}" for word in (*head, "missing %")))
    for row in rows:
        values = ("-" if value is None else f"{value:g}" for value in asdict(row).values())
        print("".join(f"{value:>14}" for value in values))


def _keys(texts: list[str]) -> dict[str, object]:
    keys = {}
    for text in texts:
        name, equals, value = text.partition("=")
        try:
            keys[name] = toml.loads(f"value = {value}")["value"]
        except msgspec.ValidationError:
            raise SettingError(
                f"--set and --later need KEY=VALUE with a value as in a TOML file, not {text!r}"
            ) from None
        if not equals:
            raise SettingError(f"--set and --later need KEY=VALUE, not {text!r}")
    return keys


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sensor", default="default", help="sensor file: path or name (default)")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="TABLE.KEY=VALUE",
        help="key of the sensor file, such as contact.gap_percent=10",
    )
    parser.add_argument(
        "--later",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="key of a change after the calibration, such as phosphor_nm=0.5",
    )
    parser.add_argument("--exposure-us", type=arguments.exposure_us, default=10_000)
    parser.add_argument("--average", type=int, default=1, help="samples in a reading (1)")
    parser.add_argument("--forces", type=float, nargs="+", default=FORCES_N, help="forces in N")
    parser.add_argument("--readings", type=int, default=_READINGS, help="readings a place (20)")
    parser.add_argument(
        "--person",
        type=int,
        metavar="SEED",
        help="a simulated person calibrates with 45 presses, instead of the stage",
    )
    parser.add_argument(
        "--rough", action="store_true", help="this person has no scale, and presses with a finger"
    )
    parser.add_argument(
        "--leak",
        type=float,
        nargs=2,
        metavar=("PERCENT", "MM"),
        default=(0.0, 0.0),
        help="dust that comes after the calibration: per cent of a full contact, and its place",
    )
    parser.add_argument(
        "--by-hand", action="store_true", help="a hand presses after the calibration, no stage"
    )
    parser.add_argument("--bend", type=float, default=0.0, help="bend after the calibration, deg")
    parser.add_argument("--rezero", type=int, default=0, help="marks of a re-zero (0)")
    parser.add_argument("--seed", type=int, default=0, help="random seed (0)")
    parser.add_argument("--json", action="store_true", help="print one JSON object a force")
    return parser


def main() -> None:
    """Parse the command line, and print the results."""
    options = parser().parse_args()
    try:
        rows = measured(options)
    except SpotsError as error:
        sys.exit(f"error: {error}")
    if options.json:
        for row in rows:
            print(json.dumps(asdict(row)))
    else:
        show(rows)


def measured(options: argparse.Namespace) -> list[Errors]:
    """Calibrate a strip, change it, and measure its errors, as the options of `parser` say."""
    sensor = with_keys(load(SensorFile, options.sensor), _keys(options.set))
    later = with_keys(
        sensor.unchanged(), {f"change.{key}": v for key, v in _keys(options.later).items()}
    ).change
    hand = Hand(options.rezero, by_hand=options.by_hand)
    hand.check()
    with Rig(sensor, options.seed, options.exposure_us, options.average) as rig:
        if options.person is not None:
            kind = "rough" if options.rough else "fine"
            made = calibrate_by_hand(rig.stage, options.person, kind=kind)
            # The re-zero takes the place of the marks by a finger at the end of a fine session.
            finger = options.by_hand and (options.rough or not options.rezero)
            rig.use(used_by(made, FINGER if finger else INDENTER).lines)
        held = rig.stage.held

        def wear() -> None:
            held.bend_deg, held.leak_share = options.bend, options.leak[0] / 100
            held.leak_mm = options.leak[1]

        age(rig, sensor.change + later, hand, options.seed, wear)
        return errors(rig, options.forces, options.seed, options.readings)


if __name__ == "__main__":
    main()
