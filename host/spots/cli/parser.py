"""Parsers of the command line. Help lists commands by purpose; errors suggest similar names."""

import argparse
import inspect
import shutil
import textwrap
from collections.abc import Callable, Iterable
from pkgutil import resolve_name
from types import ModuleType
from typing import NoReturn

from ..errors import did_you_mean, printable


def calls(target: str, *names: str) -> Callable[[argparse.Namespace], None]:
    """Return a function that, when called, imports a target function and calls the target.

    Parameters
    ----------
    target : str
        The target function, as "module:function".
    *names : str
        Names of the options to pass to the target, in order. If not given, all options are passed
        as one namespace.

    Returns
    -------
    callable
        Function that takes the parsed options.
    """

    def run(options: argparse.Namespace) -> None:
        values = [getattr(options, name) for name in names] or [options]
        resolve_name(target)(*values)

    return run


class Parser(argparse.ArgumentParser):
    """A parser of `spots` or of one of its commands.

    Attributes
    ----------
    command : callable or None
        Function that adds the options when they are first needed, see `add_commands`.
    """

    command: Callable[["Parser"], Callable] | None = None

    def __init__(self, **options):
        super().__init__(formatter_class=argparse.RawDescriptionHelpFormatter, **options)

    def flag(self, name: str, text: str) -> None:
        """Add an option without a value.

        Parameters
        ----------
        name : str
            Name of the option, with its dashes.
        text : str
            Help text.
        """
        self.add_argument(name, action="store_true", help=text)

    def option(self, name: str, metavar: str, text: str, **more) -> None:
        """Add an option or a positional argument with a value.

        Parameters
        ----------
        name : str
            Name of the option, with its dashes, or of the positional argument.
        metavar : str
            Placeholder of the value in the help.
        text : str
            Help text.
        **more
            Further arguments of `argparse.ArgumentParser.add_argument`.
        """
        self.add_argument(name, metavar=metavar, help=text, **more)

    def error(self, message: str) -> NoReturn:
        hint = "" if message.endswith("?") else f"; see '{self.prog} --help'"
        self.exit(2, f"{self.prog}: {printable(message)}{hint}\n")

    def parse_known_args(self, args=None, namespace=None):
        """Parse the command line; exit with an error and a suggestion if an option is unknown.

        Parameters
        ----------
        args : sequence of str, optional
            Arguments of the command line; those of the process if not given.
        namespace : argparse.Namespace, optional
            Namespace for the options; a new one if not given.

        Returns
        -------
        namespace : argparse.Namespace
            The options.
        unknown : list of str
            Always empty.
        """
        if self.command:
            add_options, self.command = self.command, None
            self.set_defaults(run=add_options(self))
        namespace, unknown = super().parse_known_args(args, namespace)
        if unknown:
            if not unknown[0].startswith("-"):
                self.error(f"unexpected argument '{unknown[0]}'")
            options = [name for name in self._option_string_actions if name.startswith("--")]
            hint = did_you_mean(unknown[0].partition("=")[0], options)
            self.error(f"there is no option {unknown[0]}: {hint}")
        return namespace, unknown

    def _check_value(self, action, value):
        if action.choices is not None and value not in action.choices:
            hint = did_you_mean(value, action.choices)
            raise argparse.ArgumentError(action, f"there is no '{value}': {hint}")


def add_commands(parser: Parser, groups: Iterable[ModuleType]) -> None:
    """Add commands to the main parser, whose help lists them by purpose.

    Parameters
    ----------
    parser : Parser
        The main parser.
    groups : iterable of module
        Modules with ``PURPOSE`` (title of its commands in the help) and ``COMMANDS`` (tuple of
        functions). Each function has the name of a command, and the command's help as docstring.
        The function takes the command's parser, adds the options, and returns another function,
        which takes the parsed options and runs the command.
    """
    subparsers = parser.add_subparsers(
        metavar="COMMAND", required=True, prog=parser.prog, help="see below"
    )
    columns = shutil.get_terminal_size().columns - 2
    parser.epilog = f"'{parser.prog} COMMAND --help' shows examples and options."
    for group in groups:
        parser.epilog += f"\n\n{group.PURPOSE}:"
        for command in group.COMMANDS:
            summary, _, more = (inspect.getdoc(command) or "").partition("\n")
            parser.epilog += "\n" + textwrap.fill(
                summary.rstrip("."),
                columns,
                initial_indent=f"    {command.__name__:<14}",
                subsequent_indent=" " * 18,
            )
            description = textwrap.fill(summary, columns) + "\n" + more
            added = subparsers.add_parser(command.__name__, description=description)
            added.command = command
