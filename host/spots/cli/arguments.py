"""Options that several commands share, and the types of option values."""

from __future__ import annotations

import argparse
import math
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial

from ..errors import RequirementError
from ..link.ports import (
    SIMULATED,
    comes_and_goes,
    form,
    installed,
    known,
    offered,
    scheme_name,
    schemes,
)
from .parser import Fits, Parser

PORTS = f"serial port, {known()}"
# By the name of a scheme: whether its options have an effect, and what to do if they have none.
Effects = Mapping[str, tuple[Fits, str]]


def add_port(parser: Parser, without: Collection[str] = (), effects: Effects | None = None) -> None:
    """Add the options that name a board; `open_board` reads them.

    Parameters
    ----------
    parser : Parser
        Parser of the command.
    without : collection of str
        Kinds of ports that the command cannot use, such as ``recording``, see `link.ports`.
    effects : mapping, optional
        For some schemes, whether the options of their ports have an effect, and the advice if they
        have none. Otherwise they have an effect with a port of this scheme.
    """
    forms = known(without)

    def port(text: str) -> str:
        if scheme_name(text) in without:
            raise argparse.ArgumentTypeError(
                f"this command cannot use '{text}': give a serial port or {forms}"
            )
        return text

    text = f"serial port, {forms}; the only board on USB if not given"
    parser.add_argument("--port", type=port, help=text)
    parser.set_defaults(without=without)
    parser.later(partial(_add_options_of_ports, parser, without, "add_options", effects or {}))


def add_ports(parser: Parser, effects: Effects | None = None, ability: str = "add_options") -> None:
    """Add the options that name one board, or the two boards of a linkage.

    Parameters
    ----------
    parser : Parser
        Parser of the command.
    effects : mapping, optional
        As for `add_port`.
    ability : str
        Ability of a kind of port (see `link.ports`): a function that adds the port's options to a
        parser; ``add_options`` if a kind of port does not have it.
    """
    text = f"{PORTS}; found on USB if not given; if a linkage has two boards, give --port for each"
    parser.add_argument("--port", action="append", default=[], help=text)
    parser.later(partial(_add_options_of_ports, parser, (), ability, effects or {}))


def _add_options_of_ports(
    parser: Parser, without: Collection[str], ability: str, effects: Effects
) -> None:
    for scheme in installed(without):
        add = None
        with suppress(RequirementError, ImportError):  # other kinds of ports work all the same
            add = offered(scheme, ability) or offered(scheme, "add_options")
        if add is not None:
            fits = partial(has_port, scheme=scheme)
            effect = effects.get(scheme, (fits, f"add --port {form(scheme)}"))
            parser.added(add, *effect)


def has_port(options: argparse.Namespace, scheme: str) -> bool:
    """Return whether the options name a port with a scheme.

    Parameters
    ----------
    options : argparse.Namespace
        Options of the command, with ``port``.
    scheme : str
        The scheme, such as ``virtual``.

    Returns
    -------
    bool
    """
    ports = options.port if isinstance(options.port, list) else [options.port]
    return scheme in map(scheme_name, ports)


def _is_simulated(options: argparse.Namespace) -> bool:
    return options.practice or has_port(options, SIMULATED)


# When the simulator's options have an effect, for a command that also has --practice.
PRACTICE: Effects = {SIMULATED: (_is_simulated, f"add --port {SIMULATED}")}


def add_wait(parser: Parser) -> None:
    """Add the option for a board that may be unplugged; `open_board` reads it."""
    text = "wait for the board without limit: at the start, and while it is unplugged"
    parser.flag("--wait", text)
    kinds = ["a serial port", *map(form, schemes("comes-and-goes"))]
    parser.needs(
        ["--wait"], lambda options: comes_and_goes(options.port), f"give {' or '.join(kinds)}"
    )


# Kinds of ports of a command that changes its board.
READ_ONLY = schemes("read-only")


def add_layout(parser: argparse.ArgumentParser) -> None:
    """Add the option for the key layout."""
    text = "key layout: a .toml file, or a name such as mini; digits if not given"
    parser.add_argument("--layout", metavar="LAYOUT", help=text, default="digits")


def add_seconds(
    parser: argparse.ArgumentParser, text: str = "stop after this time in seconds"
) -> None:
    """Add the option for the duration of a command.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of the command.
    text : str
        Help text of the option.
    """
    parser.add_argument("--seconds", type=seconds, metavar="S", help=text)


def open_board(options: argparse.Namespace):
    """Open the board that the options name."""
    from ..link.connect import open_named

    return open_named(options)


def whole(text: str) -> int:
    """Convert the text of an option to a whole number."""
    with _explained(text, "whole number"):
        return int(text)


def finite(text: str) -> float:
    """Convert the text of an option to a finite number."""
    with _explained(text, "number"):
        value = float(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is not a finite number")
    return value


def number(what: str, low: float, high: float, kind: type = float):
    """Return a converter for the ``type`` of argparse that accepts numbers in a range.

    Parameters
    ----------
    what : str
        Name of the value in error messages, with its unit.
    low, high : float
        Smallest and largest accepted value.
    kind : type
        `float`, or `int` for whole numbers.

    Returns
    -------
    callable
        ``convert(text)`` returns the number, or raises ArgumentTypeError.
    """

    def convert(text: str) -> float:
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(
                f"{what} must be a {'whole ' if kind is int else ''}number from {low:g} to "
                f"{high:,{'d' if kind is int else '.12g'}}, not '{text}'"
            )
        return value

    return convert


seconds = number("a time in seconds", 0.001, 1e9)
length_mm = number("the length of a strip in mm", 1, 1000)
strain_percent = number("a strain in percent", 0.01, 50)
presses = number("a number of presses", 1, 99, int)
force_N = number("a force in N", 0.1, 50)
megabytes = number("a size in MB", 0.1, 1e6)
speed = number("a speed", 0.001, math.inf)
seed = number("a seed", 0, 2**63, int)
sigma_mm = number("a standard error in mm", 1e-6, 100)
http_port = number("a port for web browsers", 0, 65535, int)
exposure_us = number("an exposure in us", 2000, 200_000, int)


@contextmanager
def _explained(text: str, what: str) -> Iterator[None]:
    try:
        yield
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not a {what}") from None
