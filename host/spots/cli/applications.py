"""Commands for the applications of a strip."""

import argparse

from ..errors import printable
from . import arguments
from .parser import Parser, calls

PURPOSE = "use a strip"


def keys(parser: Parser):
    """Show or check a key layout, or push it to a board.

    examples:
      spots keys show mini
      spots keys push mylayout.toml
    """
    parser.option("what", "ACTION", "check, show or push", choices=["check", "show", "push"])
    parser.option("layout", "LAYOUT", "key layout: a .toml file, or a name such as mini")
    arguments.add_port(parser, arguments.READ_ONLY)
    parser.needs(["--port"], lambda options: options.what == "push", "only 'push' uses a board")
    return _keys


def keyboard(parser: Parser):
    """Type on this computer with a strip.

    examples:
      spots keyboard
      spots keyboard --layout mini --dry-run
    """
    arguments.add_layout(parser)
    _add_output(parser, "print the keys instead of pressing them")
    return calls("spots.keyboard.keyboard:keyboard_command")


def wearable(parser: Parser):
    """Press keys of this computer by gestures on a strip worn on the body.

    example:
      spots wearable --dry-run
    """
    parser.option(
        "--gestures", "FILE.toml", "file of keys for gestures; the package's own if not given"
    )
    _add_output(parser, "print the keys instead of pressing them")
    return calls("spots.wearable.wearable:wearable_command")


def controller(parser: Parser):
    """Use a strip as a gamepad of this computer.

    examples:
      spots controller --calibrate
      spots controller --dry-run
    """
    parser.option("--settings", "FILE.toml", "settings file; the package's own if not given")
    parser.flag("--calibrate", "measure middle and ends of the axes, and write a settings file")
    _add_output(parser, "print the gamepad's states, but emulate no gamepad")
    uses = "--dry-run", "--seconds"
    parser.needs(uses, lambda options: not options.calibrate, "leave out --calibrate")
    parser.needs(
        ["--calibrate"],
        lambda options: not arguments.has_port(options, "recording"),
        "give the port of a board",
    )
    return calls("spots.controller.controller:controller_command")


def twin(parser: Parser):
    """Show the end point of a five-bar linkage, computed from the strips in its joints.

    examples:
      spots twin --linkage mine.toml --port /dev/ttyACM0 --port /dev/ttyACM1
    """
    parser.option("--linkage", "FILE", "linkage file, or a name such as default", default="default")
    arguments.add_seconds(parser)
    parser.flag("--json", "print one JSON object per line")
    arguments.add_ports(parser)
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
    arguments.add_simulation(parser, "linkage")
    simulates = {*arguments.option_names("linkage")} - {"--picture"}  # it has its own message
    parser.needs(simulates, _is_simulated, "name a simulated linkage with --linkage")
    shows = "--seconds", "--json"
    parser.needs(shows, lambda options: not options.measure, "leave out --measure")
    parser.needs(
        ["--place-sigma-mm"], lambda options: options.calibrate, "add --calibrate POINTS.csv"
    )
    return calls("spots.linkage.twin:twin_command")


def _is_simulated(options: argparse.Namespace) -> bool:
    from ..linkage.twin_source import has_boards

    return not options.calibrate and not has_boards(options.linkage, options.port)


COMMANDS = keys, keyboard, wearable, controller, twin


def _add_output(parser: Parser, instead: str) -> None:
    parser.flag("--dry-run", instead)
    arguments.add_port(parser)
    arguments.add_wait(parser)
    arguments.add_seconds(parser)


def _keys(options: argparse.Namespace) -> None:
    from ..keyboard import keys

    if options.what == "check":
        keys.check(options.layout)
    elif options.what == "show":
        keys.show(options.layout)
    else:
        layout = keys.load(options.layout)
        with arguments.open_board(options) as board:
            note = keys.push(board, layout)
        print(printable(f"{layout.name} is on the board" + (f": {note}" if note else "")))
