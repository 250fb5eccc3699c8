"""Options of the port ``virtual``; the simulator is loaded when a board is opened."""

from __future__ import annotations

import argparse

from spots.cli import arguments


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of a virtual board, whose defaults `strip.defaults.given` has."""
    group = parser.add_argument_group("virtual board")
    group.add_argument(
        "--sensor",
        metavar="FILE",
        help="simulated strip and sensor: a .toml file, or a name such as default",
    )
    group.add_argument(
        "--scenario",
        metavar="FILE",
        help="fingers, light and faults over time: a .toml file, or a name such as demo",
    )
    group.add_argument("--seed", type=arguments.seed, help="random seed of the noise")


def add_linkage_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of a simulated linkage, whose defaults `strip.defaults.given` has."""
    group = parser.add_argument_group("simulated linkage")
    group.add_argument(
        "--path", metavar="FILE", help="path of the end point: a .toml file, or a name such as sust"
    )
    group.add_argument(
        "--sensor",
        metavar="FILE",
        help="simulated strip and sensor: a .toml file, or a name such as default",
    )
    group.add_argument("--seed", type=arguments.seed, help="random seed of the noise")
    group.add_argument(
        "--exposure-us", type=arguments.exposure_us, help="integration time of both strips in us"
    )
    group.add_argument(
        "--picture", metavar="FILE.png", help="draw the true and the estimated path into this file"
    )
