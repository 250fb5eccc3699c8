"""Options that several commands have, and the kinds of their values."""

from __future__ import annotations

import argparse
import math


def add_port(parser: argparse.ArgumentParser) -> None:
    """Which board, for `open_board`."""
    parser.add_argument(
        "--port", help="serial port, 'virtual', recording:FILE or zenoh:ID; found if not given"
    )
    add_zenoh_config(parser)
    add_simulation(parser)


def add_ports(parser: argparse.ArgumentParser) -> None:
    """Which boards, where a linkage may have two."""
    parser.add_argument(
        "--port",
        action="append",
        default=[],
        help="serial port, 'virtual', recording:FILE or zenoh:ID; of a linkage, one a joint",
    )
    add_zenoh_config(parser)


def add_zenoh_config(parser: argparse.ArgumentParser) -> None:
    """Zenoh's own configuration; `main` hands it on."""
    parser.add_argument("--zenoh-config", metavar="FILE", help="of Zenoh; else $ZENOH_CONFIG")


def add_simulation(parser: argparse.ArgumentParser) -> None:
    """What a virtual board has and feels."""
    group = parser.add_argument_group("virtual board")
    group.add_argument("--sensor", default="default", metavar="FILE", help="sensor file or name")
    group.add_argument("--scenario", default="demo", metavar="FILE", help="scenario file or name")
    group.add_argument("--seed", type=seed, default=0, help="of the noise")


def open_board(options: argparse.Namespace):
    """Open the board that was named."""
    from ..link.connect import open_named

    return open_named(options)


def _number(what: str, low: float, high: float, kind: type = float):
    """Return a converter for argparse that takes numbers in a range."""

    def convert(text: str) -> float:
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{what} is a number from {low:g} to {high:g}")
        return value

    return convert


seconds = _number("a time in seconds", 0.001, 1e9)
hours = _number("a time in hours", 0.001, 10_000)
length_mm = _number("the length of a strip in mm", 1, 1000)
strain_percent = _number("a strain in percent", 0.01, 50)
presses = _number("a number of presses", 1, 99, int)
force_N = _number("a force in N", 0.1, 50)
megabytes = _number("a size in MB", 0.1, 1e6)
speed = _number("a speed", 0.001, math.inf)
seed = _number("a seed", 0, 2**63, int)
sigma_mm = _number("a standard error in mm", 1e-6, 100)
http_port = _number("a port for web browsers", 0, 65535, int)
exposure_us = _number("an exposure in us", 2000, 200_000, int)
