"""Errors that a user can correct, and helpers for their messages."""

import difflib
import json
import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import Any, cast

# Name for `pip`: another project has the name `spots`.
DISTRIBUTION = "spots-tactile"

# Longest message in characters: a message may quote a long text, for example from a file.
_LONGEST = 2000


def printable(text: str) -> str:
    """Return a text as one line that is safe to print: control characters are escaped."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def did_you_mean(
    word: str, known: Iterable[str], otherwise: str = "", meant: Mapping[str, str] | None = None
) -> str:
    """Return the advice for an error message about an unknown name.

    Parameters
    ----------
    word : str
        The unknown name. Its case is ignored.
    known : iterable of str
        The names that exist.
    otherwise : str, optional
        Advice if no name is similar.
    meant : mapping, optional
        For some names in `known`, the text to suggest instead of the name.

    Returns
    -------
    str
        "did you mean ...?" with the similar names; else `otherwise`, or a list of all names.
    """
    by_case = {name.lower(): (meant or {}).get(name, name) for name in known}
    found = difflib.get_close_matches(word.lower(), by_case, n=3, cutoff=0.7)
    if found:
        return f"did you mean {' or '.join(dict.fromkeys(by_case[one] for one in found))}?"
    return otherwise or f"valid names are {', '.join(by_case.values())}"


def path_text(value: object, what: str) -> str:
    """Return an argument that is a path, as text.

    Parameters
    ----------
    value : object
        The argument.
    what : str
        Name of the argument for the message, such as "the path of a recording".

    Returns
    -------
    str

    Raises
    ------
    SpotsError
        If the value is neither a text nor a path, or the text is empty or has a zero.
    """
    text: Any = (
        os.fspath(cast("os.PathLike[str]", value)) if hasattr(value, "__fspath__") else value
    )
    if not isinstance(text, str):
        raise SpotsError(f"{what} must be a text or a pathlib.Path, not {value!r}")
    if not text or "\0" in text:
        raise SpotsError(f"{what} must be a name, not {text!r}")
    return text


class SpotsError(Exception):
    """An error that the user can correct: its text names the problem and the remedy.

    The command line prints the text as one line and exits with code 2. Control characters in the
    text are escaped, and a very long text is cut in its middle.

    Examples
    --------
    >>> print(SpotsError("no file run.spots: 'spots record' makes one"))
    no file run.spots: 'spots record' makes one
    """

    def __init__(self, text: str):
        text, half = printable(text), _LONGEST // 2
        super().__init__(text if len(text) <= _LONGEST else f"{text[:half]} ... {text[-half:]}")


def missing(what: str, package: str, extra: str, instead: str = "") -> SpotsError:
    """Return the error for an optional package that is not installed.

    Parameters
    ----------
    what : str
        Subject and verb of the message, such as "flashing needs".
    package : str
        Name of the package.
    extra : str
        Name of the extra of this distribution that installs the package.
    instead : str, optional
        Another remedy, such as ", or name the drive's folder with --port".

    Returns
    -------
    SpotsError
        Error whose text has the command that installs the package.
    """
    return SpotsError(f"{what} {package}: {_install(extra)}{instead}")


def _install(extra: str) -> str:
    """Return the command that installs an extra from where this package was installed from.

    That is a checkout, a wheel or a package index. Double quotes work in every shell.
    """
    # These modules would delay the start of every command.
    from importlib.metadata import PackageNotFoundError, distribution
    from urllib.parse import urlsplit
    from urllib.request import url2pathname

    source, option = DISTRIBUTION, ""
    with suppress(PackageNotFoundError, ValueError):
        # Only a package that is not from an index has this file (PEP 610).
        origin = json.loads(distribution(DISTRIBUTION).read_text("direct_url.json") or "{}")
        url: str = origin.get("url", "")
        path = url2pathname(urlsplit(url).path)
        if path and os.path.exists(path):
            source, option = path, "-e " * origin.get("dir_info", {}).get("editable", False)
    return f'pip install {option}"{source}[{extra}]"'


class PortLostError(SpotsError):
    """Raised if the port disappeared: the board was unplugged, or restarted and closed its port."""


class ClosedError(SpotsError):
    """Raised if the board is used after the program has closed it."""


class CommandError(SpotsError):
    """Raised if the board refuses a command."""


class NoReplyError(SpotsError):
    """Raised if no reply to a command arrived: the board may have executed the command, or not."""


class RefusedError(SpotsError):
    """Raised if another board or another device is now on the port of a lost board."""


class AtPromptError(SpotsError):
    """Raised if a board is at its Python prompt (REPL), so that its firmware does not run."""
