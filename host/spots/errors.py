"""Errors that a user can correct, and their sentences."""

import difflib
from collections.abc import Iterable

# As `pip` knows the project: `spots` alone is somebody else's.
DISTRIBUTION = "spots-tactile"

# Characters of a sentence; it may quote a file.
_LONGEST = 2000


def printable(text: str) -> str:
    """Return a text as one line that does nothing to a terminal: the rest of it is escaped."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return the end of a sentence about a name that does not exist.

    Parameters
    ----------
    word : str
        The name that was given, in any case.
    known : iterable of str
        The names that exist.

    Returns
    -------
    str
        "did you mean ...?" with the similar names, or all names if no name is similar.
    """
    by_case = {name.lower(): name for name in known}
    found = difflib.get_close_matches(word.lower(), by_case, n=3, cutoff=0.7)
    if found:
        return f"did you mean {' or '.join(by_case[name] for name in found)}?"
    return f"there are {', '.join(by_case.values())}"


def _shortened(text: str) -> str:
    if len(text) <= _LONGEST:
        return text
    half = _LONGEST // 2
    return f"{text[:half]} ... {text[-half:]}"  # its end says what to do


class SpotsError(Exception):
    """A mistake or a fault outside the program; the text says what is wrong and what to do.

    The command line prints it as one line and ends with exit code 2. What it quotes of a file or
    a board is made printable, and short.

    Examples
    --------
    >>> print(SpotsError("no file run.spots: 'spots record' makes one"))
    no file run.spots: 'spots record' makes one
    """

    def __init__(self, text: str):
        super().__init__(_shortened(printable(text)))


def missing(what: str, package: str, extra: str, instead: str = "") -> SpotsError:
    """Return the error of an optional package that is not installed.

    Parameters
    ----------
    what : str
        What needs it, with its verb.
    package : str
    extra : str
        Of the distribution, which brings it.
    instead : str, optional
        What else one can do.

    Returns
    -------
    SpotsError
        It names the command that installs the package.
    """
    return SpotsError(f"{what} {package}: pip install '{DISTRIBUTION}[{extra}]'{instead}")


class PortLostError(SpotsError):
    """The port was unplugged, or its board restarted and drives USB by itself."""


class ClosedError(SpotsError):
    """The board was closed by this program."""


class RefusedError(SpotsError):
    """Another board is in the place of the one that is waited for."""
