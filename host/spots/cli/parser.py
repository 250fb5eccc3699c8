"""Parsers of the command line: help by purpose, with examples, and errors that suggest a name."""

from __future__ import annotations

import argparse
import inspect
import shutil
import textwrap
from collections.abc import Callable
from pkgutil import resolve_name
from types import ModuleType
from typing import NoReturn

from ..errors import did_you_mean, printable


def calls(target: str, *names: str) -> Callable[[argparse.Namespace], None]:
    """Return what runs a command: a function that is imported only to be called.

    Parameters
    ----------
    target : str
        As "module:function".
    *names : str
        The options that it takes, in its order. Without names it takes all of them as one.

    Returns
    -------
    callable
        Takes the parsed options.
    """

    def run(options: argparse.Namespace) -> None:
        values = [getattr(options, name) for name in names] or [options]
        resolve_name(target)(*values)

    return run


class Parser(argparse.ArgumentParser):
    """A parser of `spots` or of one of its commands."""

    def __init__(self, **options):
        super().__init__(formatter_class=argparse.RawDescriptionHelpFormatter, **options)

    def error(self, message: str) -> NoReturn:
        hint = "" if message.endswith("?") else f"; see '{self.prog} --help'"
        self.exit(2, f"{self.prog}: {printable(message)}{hint}\n")

    def parse_known_args(self, args=None, namespace=None):
        """Refuse what is left over here: the parser of a command knows its options.

        Parameters
        ----------
        args : sequence of str, optional
            The command line; that of the process, if not given.
        namespace : argparse.Namespace, optional
            Filled and returned; a new one, if not given.

        Returns
        -------
        namespace : argparse.Namespace
            The options.
        unknown : list of str
            Always empty; the process exits with code 2 otherwise.
        """
        namespace, unknown = super().parse_known_args(args, namespace)
        if unknown:
            options = [name for name in self._option_string_actions if name.startswith("--")]
            hint = did_you_mean(unknown[0].partition("=")[0], options)
            self.error(
                f"there is no option {unknown[0]}: {hint}"
                if unknown[0].startswith("-")
                else f"nothing takes the argument '{unknown[0]}'"
            )
        return namespace, unknown

    def _get_value(self, action, arg_string):
        try:
            return super()._get_value(action, arg_string)
        except argparse.ArgumentError:
            if action.type not in (int, float):
                raise
            whole = "whole " if action.type is int else ""
            text = f"'{arg_string}' is not a {whole}number"
            raise argparse.ArgumentError(action, text) from None

    def _check_value(self, action, value):
        if action.choices is not None and value not in action.choices:
            hint = did_you_mean(value, action.choices)
            raise argparse.ArgumentError(action, f"there is no '{value}': {hint}")


class CommandList:
    """The commands of a parser, listed in its help by purpose.

    Parameters
    ----------
    parser : Parser
    """

    def __init__(self, parser: Parser):
        self._parser = parser
        self._subparsers = parser.add_subparsers(
            metavar="COMMAND", required=True, prog=parser.prog, help="see below"
        )
        self._columns = shutil.get_terminal_size().columns - 2
        parser.epilog = f"'{parser.prog} COMMAND --help' shows examples and options."

    def add(self, group: ModuleType) -> None:
        """Add the commands of a module.

        Parameters
        ----------
        group : module
            With ``PURPOSE``, the title of its list, and ``COMMANDS``: functions that take the
            parser of the command that has their name, add its options, and return what runs it
            with the parsed options. Their docstrings are its help.
        """
        self._parser.epilog += f"\n\n{group.PURPOSE}:"
        for command in group.COMMANDS:
            summary, _, more = (inspect.getdoc(command) or "").partition("\n")
            self._parser.epilog += "\n" + textwrap.fill(
                summary.rstrip("."),
                self._columns,
                initial_indent=f"    {command.__name__:<14}",
                subsequent_indent=" " * 18,
            )
            parser = self._subparsers.add_parser(
                command.__name__, description=textwrap.fill(summary, self._columns) + "\n" + more
            )
            parser.set_defaults(run=command(parser))
