"""Commands that show the readings and the state of a board."""

import argparse
import inspect
import json
import sys

from spots_device.board.command import Commands

from ..errors import printable
from . import arguments
from .parser import Parser, calls

PURPOSE = "look at a board"


def monitor(parser: Parser):
    """Show the position, force and counts that a board reports.

    examples:
      spots monitor
      spots monitor --seconds 10
    """
    arguments.add_port(parser)
    arguments.add_wait(parser)
    arguments.add_seconds(parser)
    return _monitor


def serve(parser: Parser):
    """Show boards live in a web browser.

    examples:
      spots serve
      spots serve --http-port 8080
    """
    arguments.add_ports(parser)
    parser.option("--linkage", "FILE.toml", "show the five-bar linkage of this file")
    arguments.add_simulation(parser)
    parser.needs(
        arguments.option_names("board"),
        lambda options: options.practice or arguments.has_port(options, "virtual"),
        "add --port virtual",
    )
    arguments.add_layout(parser)
    parser.add_argument(
        "--address",
        default="127.0.0.1",
        help="address to listen on; 127.0.0.1 (only this machine) if not given; other machines "
        "need the token, which 'spots serve' prints",
    )
    parser.option(
        "--host",
        "NAME",
        "another name under which browsers reach this server, such as the name of a proxy; may be "
        "given several times",
        action="append",
    )
    parser.option(
        "--http-port",
        "N",
        "TCP port of the server; 8765 if not given, 0 for any free port",
        type=arguments.http_port,
        default=8765,
    )
    parser.option("--edit", "FILE.toml", "let browsers with the token change this key layout")
    parser.option(
        "--edit-controller",
        "FILE.toml",
        "let browsers with the token change these controller settings",
    )
    parser.option(
        "--edit-gestures", "FILE.toml", "let browsers with the token change the keys of gestures"
    )
    parser.option("--record-to", "FOLDER", "let browsers with the token record to this folder")
    parser.option(
        "--session",
        "FILE.jsonl",
        "let browsers with the token calibrate; this file stores the presses",
    )
    parser.flag(
        "--practice", "let browsers with the token practise a calibration; no file is written"
    )
    return calls("spots.web.serve:serve_command")


def command(parser: Parser):
    """Send a command to a board and print its reply.

    examples:
      spots command get
      spots command set exposure_us=10000 gain=9
    """
    _, *texts = (inspect.getdoc(Commands) or "").split("\n\n")
    parser.description += "\n\n".join(["", *texts[:1]])
    arguments.add_port(parser)
    parser.option("line", "LINE", "a command of the board, see the list above", nargs="+")
    return _command


COMMANDS = monitor, serve, command


def _monitor(options: argparse.Namespace) -> None:
    from ..link.calibrated import next_step, start_fault
    from ..terminal.monitor import watch
    from ..terminal.opening import open_announced

    with open_announced(options) as board:
        step = next_step(board.command("hello"))
        if fault := start_fault(board.info):
            print(f"spots: {printable(fault)}", file=sys.stderr)
        watch(board, options.seconds, quiet=False)
    if step:
        print(step, file=sys.stderr)


def _command(options: argparse.Namespace) -> None:
    with arguments.open_board(options) as board:
        print(json.dumps(board.command(" ".join(options.line))))
