"""The commands ``spots publish`` and ``spots subscribe``."""

from spots.cli import arguments
from spots.cli.parser import Parser, calls

PURPOSE = "share a board over the network"


def publish(parser: Parser):
    """Make a board available to other machines, over Zenoh.

    example:
      spots publish
    """
    arguments.add_port(parser, arguments.READ_ONLY)
    arguments.add_zenoh_config(parser)
    arguments.add_wait(parser)
    arguments.add_seconds(parser)
    return calls("spots_net.publish:publish_command")


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
    arguments.add_zenoh_config(parser)
    return calls("spots_net.subscribe:subscribe_command")
