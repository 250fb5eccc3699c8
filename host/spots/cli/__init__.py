"""The command line; ``spots --help`` lists the commands."""

import errno
import os
import sys
from itertools import takewhile
from sys import modules

from spots_device import __version__

from ..common.plugins import entry_points
from ..common.signals import ended_cleanly
from ..errors import SpotsError
from . import applications, boards, look, recordings
from .glyphs import never_fail
from .parser import Parser, add_commands

# In the order in which `spots --help` lists their commands.
_GROUPS = boards, look, applications, recordings
# Group of the entry points by which other packages add commands. Each entry point has the name of
# a command, and refers to a function as `parser.add_commands` describes it. An entry point that is
# named COMMAND.NAME adds a format to a command, see `recording.export.formats`.
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
    given = given or ["--help"]
    options = _parser(given[0]).parse_args(given)
    try:
        with ended_cleanly():
            options.run(options)
    except SpotsError as error:
        print(f"spots: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0


def _parser(first: str = "--help") -> Parser:
    """Return the parser of a command line with a first word, which is mostly a command.

    A command of this package loads no other package; nor does the command of one package load
    the other packages. The help lists the commands of all packages.
    """
    parser = Parser(
        prog="spots",
        description="Commands for SPOTS, an optical strip that senses touch.",
    )
    parser.add_argument("--version", action="version", version=__version__)
    ours = [(group.PURPOSE, command) for group in _GROUPS for command in group.COMMANDS]
    more = []
    if first not in {command.__name__ for _, command in ours}:
        more = [*(entry_points(group=_MORE, name=first) or entry_points(group=_MORE))]
        more = [entry for entry in more if "." not in entry.name]  # a format of a command
    others = [entry.load() for entry in sorted(more)]
    add_commands(parser, [*ours, *((modules[one.__module__].PURPOSE, one) for one in others)])
    return parser
