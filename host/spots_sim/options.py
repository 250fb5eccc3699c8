"""Options of the simulation for commands that take a board or a linkage."""

from __future__ import annotations

import argparse

from spots.cli import arguments


def add_board(parser: argparse.ArgumentParser) -> None:
    """Add what a virtual board has and feels; the parser has the defaults."""
    group = parser.add_argument_group("virtual board")
    group.add_argument("--sensor", metavar="FILE", help="sensor file or name")
    group.add_argument("--scenario", metavar="FILE", help="scenario file or name")
    group.add_argument("--seed", type=arguments.seed, help="of the noise")


def add_linkage(parser: argparse.ArgumentParser) -> None:
    """Add what a simulated linkage is and does; the parser has the defaults."""
    group = parser.add_argument_group("simulated linkage")
    group.add_argument("--path", metavar="FILE", help="path file or name")
    group.add_argument("--sensor", metavar="FILE", help="sensor file or name")
    group.add_argument("--seed", type=arguments.seed, help="of the noise")
    group.add_argument("--exposure-us", type=arguments.exposure_us, help="of both strips")
    group.add_argument("--picture", metavar="FILE.png", help="draw the path and the true path")
