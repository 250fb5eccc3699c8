"""Commands for what a strip is used as."""

from __future__ import annotations

import argparse

from ..errors import printable
from . import arguments


def add(commands) -> None:
    """Add the commands to a parser's subparsers."""
    keys = commands.add_parser("keys", help="layouts of keys: looked at, checked, onto a board")
    keys.add_argument("what", choices=["check", "show", "push"])
    keys.add_argument("layout", metavar="FILE.toml", help="or a name, such as mini")
    arguments.add_port(keys)
    keys.set_defaults(run=_keys)

    keyboard = commands.add_parser("keyboard", help="be a keyboard that a strip plays")
    arguments.add_port(keyboard)
    keyboard.add_argument("--layout", default="digits", metavar="FILE.toml", help="or a name")
    keyboard.add_argument("--dry-run", action="store_true", help="print keys, be no keyboard")
    keyboard.add_argument("--seconds", type=arguments.seconds, help="end after so long")
    keyboard.set_defaults(run=_keyboard)

    wearable = commands.add_parser("wearable", help="gestures on a worn strip to keys")
    arguments.add_port(wearable)
    wearable.add_argument("--gestures", metavar="FILE.toml", help="the default if not given")
    wearable.add_argument("--dry-run", action="store_true", help="print keys, be no keyboard")
    wearable.add_argument("--seconds", type=arguments.seconds, help="end after so long")
    wearable.set_defaults(run=_wearable)

    controller = commands.add_parser("controller", help="be a gamepad that a strip plays")
    arguments.add_port(controller)
    controller.add_argument("--settings", metavar="FILE.toml", help="the default if not given")
    controller.add_argument("--dry-run", action="store_true", help="print states, be no gamepad")
    controller.add_argument("--calibrate", action="store_true", help="measure rest and ends")
    controller.add_argument("--seconds", type=arguments.seconds, help="end after so long")
    controller.set_defaults(run=_controller)

    twin = commands.add_parser("twin", help="a five-bar linkage's twin, of boards or simulated")
    twin.add_argument("--linkage", default="default", metavar="FILE", help="file or name")
    twin.add_argument("--seconds", type=arguments.seconds, help="end after so long")
    twin.add_argument("--json", action="store_true", help="a line each; simulated: the errors")
    arguments.add_ports(twin)
    twin.add_argument(
        "--record", action="append", default=[], metavar="FILE.spots", help="once for each board"
    )
    group = twin.add_argument_group("what the linkage is")
    group.add_argument("--measure", metavar="POINTS.csv", help="ask where the terminal is")
    group.add_argument("--calibrate", metavar="POINTS.csv", help="find lengths and mounting")
    group.add_argument(
        "--place-sigma-mm", type=arguments.sigma_mm, default=0.1, help="of the points (0.1)"
    )
    group.add_argument("--out", metavar="FILE.toml", help="the linkage file that was found")
    group = twin.add_argument_group("simulated linkage")
    group.add_argument("--path", metavar="FILE", help="path file or name")
    group.add_argument("--sensor", default="default", metavar="FILE", help="sensor file or name")
    group.add_argument("--seed", type=arguments.seed, default=0, help="of the noise")
    group.add_argument("--exposure-us", type=arguments.exposure_us, help="of both strips")
    group.add_argument("--picture", metavar="FILE.png", help="draw path and truth")
    twin.set_defaults(run=_twin)


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


def _keyboard(options: argparse.Namespace) -> None:
    from ..keyboard.keyboard import keyboard_command

    keyboard_command(options)


def _wearable(options: argparse.Namespace) -> None:
    from ..wearable.wearable import wearable_command

    wearable_command(options)


def _controller(options: argparse.Namespace) -> None:
    from ..controller.controller import controller_command

    controller_command(options)


def _twin(options: argparse.Namespace) -> None:
    from ..linkage.twin import twin_command

    twin_command(options)
