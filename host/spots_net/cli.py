"""The commands ``spots publish`` and ``spots subscribe``."""

import argparse
from collections.abc import Callable

from spots.cli import arguments
from spots.cli.parser import Parser, calls

from . import outlet
from .options import add_options

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
        help="ros2 (if not given; over Zenoh, --port zenoh:ID reads it), foxglove, lsl, osc or "
        "rerun; an address may follow, as in osc=HOST:PORT or ros2=DOMAIN; give this option once "
        "for each outlet",
    )
    arguments.add_port(parser, arguments.READ_ONLY)
    add_options(parser)
    arguments.add_wait(parser)
    arguments.add_seconds(parser)
    group = parser.add_argument_group("OSC and Foxglove")
    group.add_argument(
        "--osc-time-tags",
        action="store_true",
        help="give each OSC bundle the time of its measurement, for receivers whose clock is "
        "synchronised; without it, they play at once",
    )
    group.add_argument(
        "--origin",
        action="append",
        metavar="URL",
        help="website that may read the Foxglove outlet, such as http://192.168.1.7:8080; "
        "Foxglove's own may always; may be given several times",
    )
    group = parser.add_argument_group("ROS 2")
    group.add_argument("--name", default="", help="name of the node; spots_ID if not given")
    group.add_argument(
        "--qos",
        choices=("best_effort", "reliable"),
        default="best_effort",
        help="quality of service of the topics; best_effort if not given; a publisher never waits",
    )
    group.add_argument(
        "--depth",
        type=arguments.number("a number of messages", 1, 10_000, int),
        default=10,
        metavar="N",
        help="messages that a subscriber stores; 10 if not given",
    )
    over_zenoh = "--zenoh-config", "--name", "--qos", "--depth"
    parser.needs(over_zenoh, _goes_to(outlet.DEFAULT), "add --to ros2")
    parser.needs(("--osc-time-tags",), _goes_to("osc"), "add --to osc")
    parser.needs(("--origin",), _goes_to("foxglove"), "add --to foxglove")
    return calls("spots_net.publishing:publish_command")


def _goes_to(kind: str) -> Callable[[argparse.Namespace], bool]:
    return lambda options: any(
        name.partition("=")[0] == kind for name in options.to or [outlet.DEFAULT]
    )


def subscribe(parser: Parser):
    """Print the readings of published boards.

    examples:
      spots subscribe
      spots subscribe "/spots_*/**" --json
    """
    parser.add_argument(
        "topics",
        nargs="?",
        default="/*/*/reading",
        metavar="TOPIC",
        help="topic of ROS 2; * stands for any text without a slash, ** for any topics; the "
        "readings of all boards if not given",
    )
    parser.flag("--json", "print each sample as a JSON object on its own line")
    arguments.add_seconds(parser)
    add_options(parser)
    return calls("spots_net.subscribe:subscribe_command")
