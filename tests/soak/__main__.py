"""``make soak``: hours of faults in simulated time; checks every frame and every key."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from soak import false_advice, file_fight
from soak.soak import soak_command
from spots.cli.arguments import number, seed
from spots.errors import SpotsError

hours = number("a time in hours", 0.001, 10_000)
count = number("a number of schedules", 1, 100_000, int)
speed = number("a speed in words a minute", 1, 200)


def main(arguments: list[str] | None = None) -> int:
    """Run one soak test; return the exit code."""
    parser = argparse.ArgumentParser(prog="make soak", description=__doc__)
    parser.add_argument("--hours", type=hours, default=1.0, help="simulated time in hours (1)")
    parser.add_argument(
        *("--faults", "--scenario"), default="fire", metavar="FILE", help="scenario file or name"
    )
    parser.add_argument(
        "--sensor",
        default="default",
        metavar="FILE",
        help="sensor: a .toml file, or a name such as default",
    )
    parser.add_argument("--strips", type=int, choices=(1, 2), default=1, help="strips (1)")
    parser.add_argument("--seed", type=seed, default=0, help="random seed of noise and faults (0)")
    parser.add_argument(
        "--words-per-min", type=speed, metavar="SPEED",
        help="replace the scenario's touches by fast typing, with overlapping touches",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument(
        "--files", type=count, metavar="N",
        help="instead, let programs, a person and a failing disk fight over each kind of file, in "
        "N random schedules",
    )  # fmt: skip
    parser.add_argument(
        "--advice",
        action="store_true",
        help="instead, type on strips without an error, and count the advice to re-zero them",
    )
    options = parser.parse_args(arguments)
    if options.advice:
        return int(false_advice.count(options.hours, options.seed) > 0)
    if options.files:
        file_fight.fight(options.files)
        return 0
    try:
        what = options.hours, options.faults, options.seed, options.sensor
        soak_command(*what, options.words_per_min, options.json, options.strips)
    except SpotsError as error:
        print(f"soak: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
