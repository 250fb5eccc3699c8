"""Commands that calibrate, characterize and design a sensor."""

from __future__ import annotations

import argparse

from . import arguments


def add(commands) -> None:
    """Add the commands to a parser's subparsers."""
    calibrate = commands.add_parser("calibrate", help="a guided session: where to press, then fit")
    calibrate.add_argument("kind", choices=["position", "force", "strain", "joint"])
    arguments.add_port(calibrate)
    calibrate.add_argument("--session", default="calibration.jsonl", metavar="FILE.jsonl")
    calibrate.add_argument("--out", metavar="FILE.toml", help="if not beside the session")
    calibrate.add_argument("--places", type=int, help="how many places, forces or angles")
    calibrate.add_argument("--length-mm", type=arguments.length_mm, help="of the strip at rest")
    calibrate.add_argument("--strain-percent", type=arguments.strain_percent, help="for 'strain'")
    calibrate.add_argument("--plan", help="six channels, as F3,F4,...; chosen if not given")
    calibrate.add_argument("--keep-settings", action="store_true", help="do not search the gain")
    calibrate.set_defaults(run=_calibrate)

    characterize = commands.add_parser(
        "characterize", help="measure a simulated sensor, on a stage"
    )
    characterize.add_argument(
        "--sensor", default="default", metavar="FILE", help="sensor file or name"
    )
    characterize.add_argument("--seed", type=arguments.seed, default=0, help="of the noise")
    characterize.add_argument("--exposure-us", type=int, default=100_000, help="1000 to 1000000")
    characterize.add_argument("--average", type=int, default=1, help="exposures a reading, 1 to 64")
    characterize.add_argument("--json", action="store_true", help="one JSON object")
    characterize.add_argument("--out", metavar="DIR", help="draw figures there")
    characterize.set_defaults(run=_characterize)

    design = commands.add_parser("design", help="dye and exposure for a length and a resolution")
    design.add_argument("--length-mm", type=float, required=True)
    design.add_argument("--resolution-um", type=float, required=True)
    design.add_argument("--rate-hz", type=float, required=True, help="readings a second")
    design.add_argument("--json", action="store_true", help="one JSON object")
    design.add_argument("--out", metavar="DIR", help="write sensor file and figure there")
    design.set_defaults(run=_design)


def _calibrate(options: argparse.Namespace) -> None:
    from ..calibrate.calibrate import run

    run(options)


def _characterize(options: argparse.Namespace) -> None:
    from spots_sim.characterize import measure

    measure(
        options.sensor,
        options.seed,
        options.exposure_us,
        options.average,
        options.json,
        options.out,
    )


def _design(options: argparse.Namespace) -> None:
    from spots_sim.design import run

    run(options.length_mm, options.resolution_um, options.rate_hz, options.json, options.out)
