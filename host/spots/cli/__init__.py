"""The command line; ``spots --help`` lists the commands."""

import errno
import os
import sys
from itertools import takewhile

from spots_device import __version__

from ..errors import SpotsError
from ..plugins import entry_points
from ..signals import ended_cleanly
from . import applications, boards, look, recordings, remote
from .glyphs import never_fail
from .parser import Parser, add_commands

# In the order in which `spots --help` lists their commands.
_GROUPS = boards, look, applications, recordings, remote
# Group of the entry points by which other packages add modules with commands, see `add_commands`.
_MORE = "spots.commands"

_NO_ROOM = errno.ENOSPC, errno.EDQUOT


def main(arguments: list[str] | None = None) -> int:
    """Run a command and return its exit code; print a SpotsError as one line and return 2."""
    code = 0
    never_fail(sys.stdout)
    try:
        try:
            code = _run(arguments)
        finally:
            # Flush here: an exception of the interpreter's own flush cannot be caught.
            print(end="", flush=True)
        return code
    except BrokenPipeError:
        pass  # the program that reads the output has ended
    except SystemExit as end:
        # Rich raises it after a broken pipe.
        if not isinstance(end.__context__, BrokenPipeError):
            raise
    except OSError as error:
        if error.errno not in _NO_ROOM:
            raise
        text = f"spots: cannot write the output: {error.strerror}; free space or write elsewhere"
        print(text, file=sys.stderr)
        code = 2
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return code


def _run(arguments: list[str] | None) -> int:
    given = sys.argv[1:] if arguments is None else arguments
    # A comment in a copied line: cmd.exe of Windows and zsh pass it to the program.
    given = list(takewhile(lambda word: word != "#", given))
    options = _parser().parse_args(given or ["--help"])
    if getattr(options, "zenoh_config", None):
        os.environ["ZENOH_CONFIG"] = options.zenoh_config  # Zenoh's own name
    try:
        with ended_cleanly():
            options.run(options)
    except SpotsError as error:
        print(f"spots: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0


def _parser() -> Parser:
    parser = Parser(
        prog="spots",
        description="Commands for SPOTS, an optical strip that senses touch.",
    )
    parser.add_argument("--version", action="version", version=__version__)
    more = (entry.load() for entry in entry_points(group=_MORE))
    add_commands(parser, (*_GROUPS, *more))
    return parser
