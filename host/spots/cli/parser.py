"""Parsers of the command line. Help lists commands by purpose; errors suggest similar names."""

import argparse
import inspect
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterable
from itertools import takewhile
from pkgutil import resolve_name
from typing import NoReturn

from ..errors import did_you_mean, printable

# Whether the other options give an option an effect, see `Parser.needs`.
Fits = Callable[[argparse.Namespace], object]


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


class _Once(argparse.Action):
    """Stores the value of an option; refuses a second value, which would replace the first one."""

    def __call__(self, parser, namespace, values, option_string=None):
        if option_string and option_string in parser.given:
            first = getattr(namespace, self.dest)
            raise argparse.ArgumentError(
                self, f"it is given twice, as '{first}' and '{values}': leave out one of them"
            )
        if option_string:  # not a positional argument
            parser.given[option_string] = None
        setattr(namespace, self.dest, values)


class _Flag(argparse.Action):
    """Stores True for an option without a value; refuses the option if it is given twice."""

    def __init__(self, option_strings, dest, default=False, **more):
        super().__init__(option_strings, dest, nargs=0, default=default, **more)

    def __call__(self, parser, namespace, values, option_string=None):
        if option_string in parser.given:
            raise argparse.ArgumentError(self, "it is given twice: leave out one of them")
        parser.given[option_string] = None
        setattr(namespace, self.dest, True)


class _Several(argparse._AppendAction):
    """Adds a value to a list, and records that the option is given."""

    def __call__(self, parser, namespace, values, option_string=None):
        super().__call__(parser, namespace, values, option_string)
        parser.given[option_string] = None


class Parser(argparse.ArgumentParser):
    """A parser of `spots` or of one of its commands.

    Attributes
    ----------
    command : callable or None
        Function that adds the options when they are first needed, see `add_commands`.
    given : dict
        The options of the command line, such as ``--port``, as keys in their order.
    """

    command: Callable[["Parser"], Callable] | None = None

    def __init__(self, **options):
        # Without abbreviations: a new option would change their meaning.
        super().__init__(
            formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False, **options
        )
        self.given: dict[str, None] = {}
        self._needs: dict[str, tuple[Fits, str]] = {}
        self._later: list[Callable[[], None]] = []
        self.register("action", None, _Once)
        self.register("action", "store", _Once)
        self.register("action", "store_true", _Flag)
        self.register("action", "append", _Several)

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

    def needs(self, names: Iterable[str], fits: Fits, advice: str) -> None:
        """Refuse options that would have no effect beside the other options.

        Parameters
        ----------
        names : iterable of str
            Names of the options, with their dashes.
        fits : callable
            ``fits(options)`` returns whether the options have an effect. It is called only if one
            of them is given.
        advice : str
            What to do, for the error message, such as "add --out DIR".
        """
        self._needs |= dict.fromkeys(names, (fits, advice))

    def later(self, add: Callable[[], None]) -> None:
        """Register a function that adds options when they are used, or when the help lists them.

        So a command loads the package that has these options only if it needs the package.
        """
        self._later.append(add)

    def added(self, add: Callable[["Parser"], None], fits: Fits, advice: str) -> None:
        """Let a function add options, which have an effect as `needs` describes it.

        Parameters
        ----------
        add : callable
            ``add(parser)`` adds the options.
        fits, advice
            As for `needs`. If the effect of an option is already known, it stays.
        """
        before = {*self._option_string_actions}
        add(self)
        new = {*self._option_string_actions} - before
        self.needs(new - {*self._needs}, fits, advice)

    def complete(self) -> None:
        """Add the options of functions that `later` registered."""
        while self._later:
            self._later.pop(0)()

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
        self.given.clear()
        args = sys.argv[1:] if args is None else list(args)
        if any(arg in ("-h", "--help") or self._is_unknown(arg) for arg in args):
            self.complete()
        if "" in args:  # such as an empty variable of a shell
            self.error("an argument is empty: give it a value, or leave it out")
        self._refuse_unknown(args)  # before argparse reports a missing option that is misspelt
        namespace, unknown = super().parse_known_args(args, namespace)
        if unknown:
            if not unknown[0].startswith("-"):
                self.error(f"unexpected argument '{unknown[0]}'")
            self._refuse(unknown[0])
        for name in self.given:
            fits, advice = self._needs.get(name, (None, ""))
            if fits and not fits(namespace):
                self.error(f"{name} has no effect here: {advice}, or leave out {name}")
        return namespace, unknown

    def _is_unknown(self, arg: str) -> bool:
        return arg.startswith("--") and arg.partition("=")[0] not in self._option_string_actions

    def _refuse_unknown(self, args: list[str]) -> None:
        """Exit with an error at the first argument that is an unknown long option."""
        for arg in takewhile(lambda arg: arg != "--", args):
            if self._subparsers and not arg.startswith("-"):
                return  # the rest belongs to a command
            if self._is_unknown(arg) and " " not in arg:  # with a space, it is a value
                self._refuse(arg)

    def _refuse(self, arg: str) -> NoReturn:
        options = [name for name in self._option_string_actions if name.startswith("--")]
        hint = did_you_mean(arg.partition("=")[0], options)
        self.error(f"there is no option {arg}: {hint}")

    def _check_value(self, action, value):
        if action.choices is not None and value not in action.choices:
            hint = did_you_mean(value, action.choices)
            raise argparse.ArgumentError(action, f"there is no '{value}': {hint}")


def add_commands(parser: Parser, commands: Iterable[tuple[str, Callable]]) -> None:
    """Add commands to the main parser, whose help lists them by purpose.

    Parameters
    ----------
    parser : Parser
        The main parser.
    commands : iterable of (str, callable)
        The purpose of each command (a title of the help, which is ``PURPOSE`` of the command's
        module), and a function. The function has the name of the command, and the command's help as
        docstring. It takes the command's parser, adds the options, and returns another function,
        which takes the parsed options and runs the command.
    """
    subparsers = parser.add_subparsers(
        metavar="COMMAND", required=True, prog=parser.prog, help="see below"
    )
    columns = shutil.get_terminal_size().columns - 2
    parser.epilog = f"'{parser.prog} COMMAND --help' shows examples and options."
    purposes: dict[str, list[Callable]] = {}
    for purpose, command in commands:
        purposes.setdefault(purpose, []).append(command)
    for purpose, group in purposes.items():
        parser.epilog += f"\n\n{purpose}:"
        for command in group:
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
