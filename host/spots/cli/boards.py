"""Commands that find boards, flash them and talk to them."""

from __future__ import annotations

import argparse
import json

from ..errors import printable
from ..link.ports import known
from . import arguments


def add(commands) -> None:
    """Add the commands to a parser's subparsers."""
    ports = commands.add_parser("ports", help="list boards and what answers on each port")
    ports.add_argument("--json", action="store_true", help="one JSON list")
    ports.set_defaults(run=_ports)

    boards = commands.add_parser("boards", help="list the boards that there are files for")
    boards.add_argument("--json", action="store_true", help="one JSON list")
    boards.set_defaults(run=_boards)

    build = commands.add_parser("build", help="make a board's files, in build/BOARD")
    build.add_argument("board", metavar="BOARD")
    build.set_defaults(run=_build)

    flash = commands.add_parser("flash", help="put the firmware on a board and start it")
    flash.add_argument("board", metavar="BOARD")
    flash.add_argument("--port", help="serial port or CIRCUITPY drive; found if not given")
    flash.add_argument("--dry-run", action="store_true", help="only print what would be done")
    flash.set_defaults(run=_flash)

    erase = commands.add_parser("erase", help="remove firmware, settings and calibration")
    erase.add_argument("board", metavar="BOARD")
    erase.add_argument("--port", help="serial port or CIRCUITPY drive; found if not given")
    erase.add_argument("--yes", action="store_true", help="do not ask")
    erase.set_defaults(run=_erase)

    doctor = commands.add_parser("doctor", help="what is wrong with a board, and what to do")
    doctor.add_argument("--port", help=f"{arguments.PORTS}; found if not given")
    doctor.set_defaults(run=_doctor)

    command = commands.add_parser("command", help="send a command line, print the reply")
    arguments.add_port(command)
    command.add_argument("line", nargs="+", help="such as: set exposure_us=10000")
    command.set_defaults(run=_command)


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


def _flash(options: argparse.Namespace) -> None:
    from ..deploy.flash import flash

    flash(options.board, options.port, options.dry_run)


def _erase(options: argparse.Namespace) -> None:
    from ..deploy.erase import erase

    erase(options.board, options.port, options.yes)


def _doctor(options: argparse.Namespace) -> None:
    from ..deploy.doctor import doctor

    doctor(options.port)


def _command(options: argparse.Namespace) -> None:
    with arguments.open_board(options) as board:
        print(json.dumps(board.command(" ".join(options.line))))
