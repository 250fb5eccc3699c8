"""Errors that a user can correct, and helpers for their messages.

All of them are a `SpotsError`. A program catches the class; the sentence is for people::

    SpotsError
    ├── SettingError        an argument, an option or a setting is invalid
    ├── FileError           a file is missing, damaged, or cannot be written (path, place)
    │   ├── InUseError      another program uses the file
    │   └── ChangedError    another program has changed the file
    ├── RequirementError    this computer lacks a package, a device or a permission
    ├── StateError          the action is not possible now
    ├── CalibrationError    presses give no valid calibration, or the calibration does not fit
    ├── BoardError          the board refuses a command, or cannot do what was asked (why)
    └── PortError           no board can be reached
        ├── PortLostError   the port disappeared: unplugged, or restarting
        ├── RefusedError    another board or another device is on the port
        ├── AtPromptError   the board is at its Python prompt
        ├── NoReplyError    no reply to a command arrived in time
        └── ClosedError     the program has closed the board
"""

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
    SettingError
        If the value is neither a text nor a path, or the text is empty or has a zero.
    """
    text: Any = (
        os.fspath(cast("os.PathLike[str]", value)) if hasattr(value, "__fspath__") else value
    )
    if not isinstance(text, str):
        raise SettingError(f"{what} must be a text or a pathlib.Path, not {value!r}")
    if not text or "\0" in text:
        raise SettingError(f"{what} must be a name, not {text!r}")
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


class SettingError(SpotsError):
    """Raised if an argument, an option or a setting is invalid, or does not fit to the others."""


class FileError(SpotsError):
    """Raised if a file or folder is missing, is invalid, or cannot be read or written.

    Parameters
    ----------
    text : str
        The sentence.
    path : str or Path, optional
        The file or folder.
    place : str, optional
        Where in the file: a line such as "line 3", or a TOML key such as "layer.key.tap".

    Attributes
    ----------
    path : str
        The file or folder; empty if it has no path, such as a text that is not stored yet.
    place : str
        Where in the file; empty if the whole file is meant.
    """

    def __init__(self, text: str, path: "str | os.PathLike[str]" = "", place: str = ""):
        super().__init__(text)
        self.path, self.place = os.fspath(path), place


class InUseError(FileError):
    """Raised if another program, or another part of this program, uses the same file."""


class ChangedError(FileError):
    """Raised if a file is not what its writer read before: another program has changed it."""


class RequirementError(SpotsError):
    """Raised if this computer lacks a package, a device, a permission or a free network port."""


class StateError(SpotsError):
    """Raised if an action is not possible now: it runs already, has ended, or was not confirmed."""


class CalibrationError(SpotsError):
    """Raised if presses give no valid calibration, or if a calibration does not fit the strip."""


class BoardError(SpotsError):
    """Raised if the board refuses a command, or cannot do what was asked in its present state.

    Parameters
    ----------
    text : str
        The sentence.
    why : str, optional
        The code of the reason.

    Attributes
    ----------
    why : str
        Code of the reason, such as "busy": one of `link.board_errors.REASONS`. Empty if it is
        unknown.
    """

    def __init__(self, text: str, why: str = ""):
        super().__init__(text)
        self.why = why


class PortError(SpotsError):
    """Raised if no board can be reached: there is no port, or no SPOTS board answers on it."""


class PortLostError(PortError):
    """Raised if the port disappeared: the board was unplugged, or restarted and closed its port."""


class RefusedError(PortError):
    """Raised if another board or another device is on the port of the board that is meant."""


class AtPromptError(PortError):
    """Raised if a board is at its Python prompt (REPL), so that its firmware does not run."""


class NoReplyError(PortError):
    """Raised if no reply to a command arrived: the board may have executed the command, or not."""


class ClosedError(PortError):
    """Raised if the board is used after the program has closed it."""


def missing(what: str, package: str, extra: str, instead: str = "") -> RequirementError:
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
    RequirementError
        Error whose text has the command that installs the package.
    """
    return RequirementError(f"{what} {package}: {_install(extra)}{instead}")


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
    return pip_install(f'{option}"{source}[{extra}]"')


def pip_install(what: str) -> str:
    """Return the command that installs something; `what` is the argument of ``pip install``.

    An environment that uv made has no pip.
    """
    from importlib.metadata import PackageNotFoundError, distribution

    by = ""
    with suppress(PackageNotFoundError):
        by = (distribution(DISTRIBUTION).read_text("INSTALLER") or "").strip()
    return f"{'uv ' * (by == 'uv')}pip install {what}"
