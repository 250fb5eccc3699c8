"""Options that several commands have, and the types of their values."""

from __future__ import annotations

import argparse
import math
from importlib.metadata import entry_points

from ..link.ports import known

PORTS = f"serial port, {known()}"
# Functions of other packages, which take a parser.
_OPTIONS = "spots.options"
_SIMULATED = {
    "board": {"sensor": "default", "scenario": "demo", "seed": 0},
    "linkage": {
        "path": None,
        "sensor": "default",
        "seed": 0,
        "exposure_us": None,
        "picture": None,
    },
}


def add_port(parser: argparse.ArgumentParser) -> None:
    """Add the options that name a board, for `open_board`."""
    parser.add_argument("--port", help=f"{PORTS}; found if not given")
    add_zenoh_config(parser)
    add_simulation(parser)


def add_ports(parser: argparse.ArgumentParser) -> None:
    """Add the options that name boards, where a linkage may have two."""
    parser.add_argument(
        "--port",
        action="append",
        default=[],
        help=f"{PORTS}; once for each joint of a linkage",
    )
    add_zenoh_config(parser)


def add_zenoh_config(parser: argparse.ArgumentParser) -> None:
    """Add the option for Zenoh's own configuration file."""
    parser.add_argument(
        "--zenoh-config", metavar="FILE", help="configuration of Zenoh; else $ZENOH_CONFIG"
    )


def add_simulation(parser: argparse.ArgumentParser, what: str = "board") -> None:
    """Add the options of packages that simulate a ``board`` or a ``linkage``, and the defaults.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        The options are added to it.
    what : str
        ``board`` or ``linkage``.
    """
    parser.set_defaults(**_SIMULATED[what])
    for entry in entry_points(group=_OPTIONS, name=what):
        entry.load()(parser)


def add_seconds(parser: argparse.ArgumentParser, text: str = "stop after this time") -> None:
    """Add the option that limits how long a command runs.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        The option is added to it.
    text : str
        Its help.
    """
    parser.add_argument("--seconds", type=seconds, metavar="S", help=text)


def open_board(options: argparse.Namespace):
    """Open the board that the options name."""
    from ..link.connect import open_named

    return open_named(options)


def number(what: str, low: float, high: float, kind: type = float):
    """Return a converter for argparse that takes numbers in a range.

    Parameters
    ----------
    what : str
        What the number is, with its unit.
    low, high : float
        The range, both included.
    kind : type
        `float`, or `int` for whole numbers.

    Returns
    -------
    callable
        ``convert(text)``; raises ArgumentTypeError for a text that is no such number.
    """

    def convert(text: str) -> float:
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(
                f"{what} is a {'whole ' if kind is int else ''}number from {low:g} to "
                f"{high:,{'d' if kind is int else '.12g'}}, not '{text}'"
            )
        return value

    return convert


seconds = number("a time in seconds", 0.001, 1e9)
length_mm = number("the length of a strip in mm", 1, 1000)
strain_percent = number("a strain in percent", 0.01, 50)
presses = number("a number of presses", 1, 99, int)
force_N = number("a force in N", 0.1, 50)
megabytes = number("a size in MB", 0.1, 1e6)
speed = number("a speed", 0.001, math.inf)
seed = number("a seed", 0, 2**63, int)
places = number("how many places, forces or angles", 0, 1000, int)
sigma_mm = number("a standard error in mm", 1e-6, 100)
http_port = number("a port for web browsers", 0, 65535, int)
exposure_us = number("an exposure in us", 2000, 200_000, int)
