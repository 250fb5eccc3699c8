"""The command ``spots twin``."""

import argparse

from spots.cli import arguments
from spots.cli.parser import Parser, calls

PURPOSE = "use a strip"


def twin(parser: Parser):
    """Show the end point of a five-bar linkage, computed from the strips in its joints.

    examples:
      spots twin --linkage mine.toml --port /dev/ttyACM0 --port /dev/ttyACM1
    """
    parser.option("--linkage", "FILE", "linkage file, or a name such as default", default="default")
    arguments.add_seconds(parser)
    parser.flag("--json", "print one JSON object per line")
    parser.flag("--publish", "publish joint angles and end point as the node spots_twin of ROS 2")
    effect = _is_simulated, "name a simulated linkage with --linkage"
    arguments.add_ports(parser, {"virtual": effect}, "add_linkage_options")
    parser.needs(["--picture"], lambda options: True, "")  # it has its own message
    parser.set_defaults(picture=None)
    parser.option(
        "--record",
        "FILE.spots",
        "file for a new recording; give this option once for each board",
        action="append",
        default=[],
    )
    group = parser.add_argument_group("calibrate a linkage")
    group.add_argument(
        "--measure",
        metavar="POINTS.csv",
        help="add measured positions of the end point to this table",
    )
    group.add_argument(
        "--calibrate", metavar="POINTS.csv", help="fit the linkage to the positions in this table"
    )
    group.add_argument(
        "--place-sigma-mm",
        type=arguments.sigma_mm,
        default=0.1,
        help="standard error of a measured coordinate in mm; 0.1 if not given",
    )
    group.add_argument(
        "--out", metavar="FILE.toml", help="the linkage file to write, for --calibrate"
    )
    parser.add_argument(
        "--mjcf", metavar="FILE.xml", help="write the linkage as a model for MuJoCo, and end"
    )
    shows = "--seconds", "--json"
    parser.needs(shows, lambda options: not options.measure, "leave out --measure")
    parser.needs(["--publish"], _is_live, "name the linkage file of real boards with --linkage")
    parser.needs(
        ["--place-sigma-mm"], lambda options: options.calibrate, "add --calibrate POINTS.csv"
    )
    return calls("spots_linkage.twin:twin_command")


def _is_simulated(options: argparse.Namespace) -> bool:
    from .twin_source import has_boards

    return not options.calibrate and not has_boards(options.linkage, options.port)


def _is_live(options: argparse.Namespace) -> bool:
    others = options.calibrate, options.measure, options.mjcf
    return not any(others) and not _is_simulated(options)
