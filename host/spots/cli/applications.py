"""Commands for the applications of a strip."""

import argparse

from ..errors import SettingError, printable
from . import arguments
from .parser import Parser, calls

PURPOSE = "use a strip"


def keys(parser: Parser):
    """Show or check a key layout, push it to a board, or list the names of keys.

    examples:
      spots keys show mini
      spots keys push mylayout.toml
      spots keys names volume
    """
    actions = ["check", "show", "push", "names"]
    parser.option("what", "ACTION", "check, show, push or names", choices=actions)
    parser.option(
        "layout",
        "LAYOUT",
        "key layout: a .toml file, or a name such as mini; for 'names': a part of a name, or a "
        "character; all names if not given",
        nargs="?",
    )
    parser.flag("--yes", "do not ask before texts are stored on the board")
    arguments.add_port(parser, arguments.READ_ONLY)
    pushes = lambda options: options.what == "push"  # noqa: E731
    parser.needs(["--port", "--yes"], pushes, "only 'push' uses a board")
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


COMMANDS = keys, keyboard, wearable, controller


def _add_output(parser: Parser, instead: str) -> None:
    parser.flag("--dry-run", instead)
    arguments.add_port(parser)
    arguments.add_wait(parser)
    arguments.add_seconds(parser)


def _keys(options: argparse.Namespace) -> None:
    from ..keyboard import keys

    if options.what == "names":
        print("\n".join(keys.names(options.layout or "")))
    elif options.layout is None:
        raise SettingError(f"keys {options.what} needs a layout: add a file or a name such as mini")
    elif options.what == "check":
        keys.check(options.layout)
    elif options.what == "show":
        keys.show(options.layout)
    else:
        layout = keys.load(options.layout)
        with arguments.open_board(options) as board:
            texts = keys.new_texts(board, layout)
            if texts and not options.yes:
                from ..deploy.confirm import confirm

                print("\n".join(map(printable, texts)))
                confirm("keys push", "store these texts, to be typed?", "the board is unchanged")
            note, exposure = keys.push(board, layout, expose=True)
        print(printable(f"{layout.name} is on the board" + (f": {note}" if note else "")))
        if exposure:
            print(exposure)
