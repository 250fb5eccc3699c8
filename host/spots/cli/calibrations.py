"""The commands that calibrate a sensor and correct its drift."""

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

    rezero = commands.add_parser("rezero", help="press three marks of a strip that has drifted")
    rezero.add_argument("calibration", nargs="?", default="calibration.toml", metavar="FILE.toml")
    arguments.add_port(rezero)
    rezero.add_argument("--quick", action="store_true", help="one mark; not for a bleached dye")
    rezero.add_argument("--presses", type=arguments.presses, default=1, help="of each mark")
    rezero.add_argument("--force-N", type=arguments.force_N, help="on a scale; corrects the force")
    rezero.set_defaults(run=_rezero, length_mm=None)


def _calibrate(options: argparse.Namespace) -> None:
    from ..calibrate.calibrate import calibrate_command

    calibrate_command(options)


def _rezero(options: argparse.Namespace) -> None:
    from ..calibrate.rezero import rezero_command

    rezero_command(options)
