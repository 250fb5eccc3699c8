"""The commands ``spots publish`` and ``spots subscribe``."""

import argparse

from spots.cli import arguments
from spots.cli.parser import Parser, calls

from . import outlet
from .port import add_options

PURPOSE = "share a board over the network"


def publish(parser: Parser):
    """Send the readings of a board to other machines and programs.

    examples:
      spots publish
      spots publish --to foxglove --to osc=192.168.1.7:9000
    """
    parser.add_argument(
        "--to",
        action="append",
        type=outlet.checked,
        metavar="OUTLET",
        help="zenoh (if not given), ros2, foxglove, lsl, osc or rerun; an address may follow, as "
        "in osc=HOST:PORT; give this option once for each outlet",
    )
    arguments.add_port(parser, arguments.READ_ONLY)
    add_options(parser)
    arguments.add_wait(parser)
    arguments.add_seconds(parser)
    parser.needs(["--zenoh-config"], _is_over_zenoh, "add --to zenoh or --to ros2")
    return calls("spots_net.publishing:publish_command")


def _is_over_zenoh(options: argparse.Namespace) -> bool:
    return any(name.partition("=")[0] in ("zenoh", "ros2") for name in options.to or ["zenoh"])


def subscribe(parser: Parser):
    """Print the readings of published boards.

    examples:
      spots subscribe
      spots subscribe "spots/**" --json
    """
    parser.add_argument(
        "expression",
        nargs="?",
        default="spots/*/*/touch",
        metavar="EXPR",
        help="key expression of Zenoh that selects messages, such as spots/**; the touches of all "
        "boards if not given",
    )
    parser.flag("--json", "print each sample as a JSON object on its own line")
    arguments.add_seconds(parser)
    add_options(parser)
    return calls("spots_net.subscribe:subscribe_command")
