"""The command that calibrates a sensor."""

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


def _calibrate(options: argparse.Namespace) -> None:
    from ..calibrate.calibrate import calibrate_command

    calibrate_command(options)
