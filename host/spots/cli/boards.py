"""Commands that make a board ready: find, flash, check and calibrate it."""

from __future__ import annotations

import argparse
import json

from ..errors import printable
from ..link.ports import known
from . import arguments
from .parser import Parser, calls

PURPOSE = "set up a board"


def ports(parser: Parser):
    """List the USB serial ports and what answers there.

    example:
      spots ports --json
    """
    parser.add_argument("--json", action="store_true", help="one JSON list")
    return _ports


def boards(parser: Parser):
    """List the boards that SPOTS has files for.

    example:
      spots boards --json
    """
    parser.add_argument("--json", action="store_true", help="one JSON list")
    return _boards


def build(parser: Parser):
    """Write a board's files to build/BOARD.

    example:
      spots build pico
    """
    parser.add_argument("board", metavar="BOARD", help="a name that 'spots boards' lists")
    return _build


def flash(parser: Parser):
    """Copy the firmware to a board and start it.

    examples:
      spots flash pico
      spots flash pico --dry-run
    """
    _add_board(parser)
    parser.add_argument("--dry-run", action="store_true", help="only print what would be done")
    return calls("spots.deploy.flash:flash", "board", "port", "dry_run")


def doctor(parser: Parser):
    """Check a board from its cable to its light, and print what to do.

    examples:
      spots doctor
      spots doctor --port /dev/ttyACM0
    """
    parser.add_argument("--port", help=f"{arguments.PORTS}; found if not given")
    return calls("spots.deploy.doctor:doctor", "port")


def calibrate(parser: Parser):
    """Calibrate a strip: a guided session asks for presses and fits them.

    examples:
      spots calibrate position
      spots calibrate force
      spots calibrate strain --strain-percent 10
    """
    parser.add_argument(
        "kind",
        metavar="KIND",
        choices=["position", "force", "strain", "joint"],
        help="position, force, strain or joint; position and force come first",
    )
    arguments.add_port(parser)
    parser.add_argument(
        "--session",
        default="calibration.jsonl",
        metavar="FILE.jsonl",
        help="where each press is stored; the same file continues a session",
    )
    parser.add_argument(
        "--out", metavar="FILE.toml", help="the calibration; beside the session if not given"
    )
    parser.add_argument("--places", type=arguments.places, help="how many places, forces or angles")
    parser.add_argument(
        "--length-mm", type=arguments.length_mm, help="of the strip at rest; 85 if not given"
    )
    parser.add_argument("--strain-percent", type=arguments.strain_percent, help="for 'strain'")
    parser.add_argument("--plan", metavar="F3,F4,...", help="six channels; else the best are found")
    parser.add_argument("--keep-settings", action="store_true", help="keep gain and LED current")
    return calls("spots.calibrate.calibrate:calibrate_command")


def rezero(parser: Parser):
    """Correct the drift of a calibrated strip: press its three marks again.

    examples:
      spots rezero
      spots rezero mine.toml --presses 3
    """
    parser.add_argument(
        "calibration",
        nargs="?",
        default="calibration.toml",
        metavar="FILE.toml",
        help="the calibration to correct; calibration.toml if not given",
    )
    arguments.add_port(parser)
    parser.add_argument(
        "--quick", action="store_true", help="press the middle mark only; not for a bleached dye"
    )
    parser.add_argument(
        "--joint", action="store_true", help="turn the joint to its two end stops and a middle stop"
    )
    parser.add_argument(
        "--presses", type=arguments.presses, default=1, help="how often to press each mark"
    )
    parser.add_argument(
        "--force-N",
        type=arguments.force_N,
        help="force of each press, read from a scale; corrects the force, too",
    )
    parser.set_defaults(length_mm=None)
    return calls("spots.calibrate.rezero:rezero_command")


def erase(parser: Parser):
    """Remove the firmware, its settings and its calibration from a board.

    example:
      spots erase pico
    """
    _add_board(parser)
    parser.add_argument("--yes", action="store_true", help="do not ask")
    return calls("spots.deploy.erase:erase", "board", "port", "yes")


COMMANDS = ports, boards, build, flash, doctor, calibrate, rezero, erase


def _add_board(parser: Parser) -> None:
    parser.add_argument("board", metavar="BOARD", help="a name that 'spots boards' lists")
    parser.add_argument("--port", help="serial port or CIRCUITPY drive; found if not given")


def _ports(options: argparse.Namespace) -> None:
    from ..link.connect import survey

    rows = survey()
    if options.json:
        print(json.dumps(rows))
    elif not rows:
        print(f"no USB serial port: plug a board in, or name {known()} with --port")
    for row in [] if options.json else rows:
        print("  ".join(map(printable, row.values())))


def _boards(options: argparse.Namespace) -> None:
    from ..deploy.staging import board_names, device_of

    rows = [
        {
            "name": device.name,
            "title": device.title,
            "runtime": device.runtime,
            "arch": device.march,
            "sda": device.wiring.get("sda"),
            "scl": device.wiring.get("scl"),
        }
        for device in map(device_of, board_names())
    ]
    if options.json:
        print(json.dumps(rows))
        return
    table = [list(rows[0])] + [[printable(value or "-") for value in row.values()] for row in rows]
    widths = [max(map(len, column)) for column in zip(*table)]
    for line in table:
        print("  ".join(cell.ljust(width) for cell, width in zip(line, widths)).rstrip())


def _build(options: argparse.Namespace) -> None:
    from ..deploy.build import build

    print(printable(str(build(options.board))))
