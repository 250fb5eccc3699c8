"""Commands that show the readings and the state of a board."""

import argparse
import inspect
import json
import sys
from contextlib import ExitStack

from spots_device.board.command import Commands

from ..errors import printable
from ..recording.recorder import Recorder
from . import arguments
from .parser import Parser

PURPOSE = "look at a board"


def monitor(parser: Parser):
    """Show the position, force and counts that a board reports.

    examples:
      spots monitor
      spots monitor --seconds 10
      spots monitor --record run.spots
    """
    arguments.add_port(parser)
    arguments.add_wait(parser)
    arguments.add_seconds(parser)
    parser.option(
        "--record", "FILE.spots", "record meanwhile into a new file; the key m marks the moment"
    )
    return _monitor


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


COMMANDS = monitor, command


def _monitor(options: argparse.Namespace) -> None:
    from ..advice.calibrated import next_step, sensor_fault, start_fault
    from ..terminal.hotkey import hotkey, marker
    from ..terminal.monitor import watch
    from ..terminal.opening import open_announced

    with open_announced(options) as board:
        if step := next_step(board.command("hello")):
            step = sensor_fault(board) or step
        if fault := start_fault(board.info):
            print(f"spots: {printable(fault)}", file=sys.stderr)
        with ExitStack() as stack:
            if options.record:
                stack.enter_context(Recorder(board, options.record))
                stack.enter_context(hotkey("m", marker(board)))
            watch(board, options.seconds, quiet=False)
    if step:
        print(printable(step), file=sys.stderr)


def _command(options: argparse.Namespace) -> None:
    with arguments.open_board(options) as board:
        print(json.dumps(board.command(" ".join(options.line))))
