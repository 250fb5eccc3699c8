"""Port schemes: names for `open` and ``--port`` that are not names of serial ports.

A scheme is the word before the colon: ``zenoh`` in ``zenoh:ID``. Each scheme has a module, which is
registered as an entry point of the group ``spots.ports``. The name of the entry point is the
scheme, and after it, separated by dots, what is needed before the module is loaded:

- the text after the colon as the help shows it, in capitals;
- ``read-only`` if a command cannot change the board;
- ``comes-and-goes`` if the board may be absent for a time, so that ``--wait`` has an effect.

Examples are ``virtual`` and ``zenoh.ID.read-only.comes-and-goes``.

The module must have

``open_port(target, options)``
    Returns a `Board`, or raises SpotsError. `target` is the text after the colon. `options` are
    those of the command line; None in a program. They have what ``add_options`` has
    added, or nothing.

and may have

``add_options(parser)``
    Adds options for the commands that open a port of this kind. It must load no more than it needs.
``add_linkage_options(parser)``
    The same for ``spots twin``.
``check(target, options)``
    Raises SpotsError if the arguments are invalid, so that every call of ``open_port`` would fail.
``calibration_setup(options, made, path, guide)``
    Returns a `calibrate.session.bench.Bench`: a board whose strip is pressed by a machine.
    `options` are those of the command line. `made` is the `Session` of ``spots calibrate``, or the
    `CalibrationFile` that ``spots rezero`` corrects. `path` is the calibration file to write.
    `guide` prints the progress.
``practice(options, path, guide)``
    Returns a context manager that yields a `calibrate.session.practice.Practice`: a simulated strip
    whose simulated finger follows the requests of a session. `path` is the calibration file to
    write, and `guide` is a `calibrate.session.dialog.Dialog`.
``linkage(options)``
    Returns a driven linkage: a five-bar linkage whose method ``open`` opens the boards of its
    joints. ``options.linkage`` is the name of its file.
``run_linkage(options)``
    Runs ``spots twin`` with a simulated linkage, and compares the twin with the true positions.
``flash_place(device)``
    Returns a context manager that yields a `deploy.place.Place`: a board to flash.
"""

from collections.abc import Collection, Iterator
from contextlib import suppress
from importlib.metadata import EntryPoint
from types import ModuleType
from typing import Any

from ..common.plugins import entry_points
from ..errors import did_you_mean, missing

GROUP = "spots.ports"
SIMULATED = "virtual"  # offers practice; the error without its package names the extra


def _entries() -> dict[str, EntryPoint]:
    """Return the entry points of the kinds of ports, sorted, by scheme."""
    found = sorted(entry_points(group=GROUP))
    return {entry.name.partition(".")[0]: entry for entry in found}


def schemes(fact: str) -> list[str]:
    """Return the schemes with a fact in the name of their entry point, such as ``read-only``."""
    return [scheme for scheme, entry in _entries().items() if fact in entry.name.split(".")[1:]]


def form(scheme: str) -> str:
    """Return how a port with an installed scheme is written, such as ``zenoh:ID``."""
    return ":".join([scheme, *filter(str.isupper, _entries()[scheme].name.split(".")[1:])])


def modules(without: Collection[str] = ()) -> Iterator[tuple[str, ModuleType]]:
    """Yield (scheme, module) of each kind of port whose package is installed."""
    for scheme, entry in _entries().items():
        if scheme not in without:
            with suppress(ImportError):
                yield scheme, entry.load()


def known(without: Collection[str] = ()) -> str:
    """Return a text that lists the forms of non-serial ports, such as ``zenoh:ID``."""
    written = [form(scheme) for scheme in _entries() if scheme not in without]
    forms = [one if ":" in one else f"'{one}'" for one in written]
    return " or ".join(filter(None, [", ".join(forms[:-1]), *forms[-1:]]))


def no_port(port: str) -> str:
    """Return the error message for a port that does not exist; suggest a similar name."""
    forms = {scheme: form(scheme) for scheme in _entries()}
    hint = did_you_mean(port.partition(":")[0], forms, "'spots ports' lists the ports", forms)
    return f"there is no port {port}: {hint}"


def scheme_name(port: str | None) -> str:
    """Return the scheme of a port: ``zenoh`` for ``zenoh:ID``, empty for a serial port or None."""
    name = (port or "").partition(":")[0]
    return name if name in _entries() else ""


def comes_and_goes(port: str | None) -> bool:
    """Return whether the board of a port may be absent for a time, as that of a serial port."""
    return scheme_name(port) in ("", *schemes("comes-and-goes"))


def scheme(port: str | None) -> tuple[ModuleType | None, str]:
    """Return the module that opens a port such as ``zenoh:ID``, and the text after the colon.

    The module of a serial port is None, and its text the whole port. RequirementError if a package
    that the scheme needs is not installed.
    """
    name, _, target = (port or "").partition(":")
    try:
        if entry := _entries().get(name):
            return entry.load(), target
    except ImportError:
        if name != SIMULATED:
            raise
    if name == SIMULATED:
        raise missing(f"port '{name}' needs", "the simulator", "virtual")
    return None, port or ""


def offered(port: str | None, what: str) -> Any:
    """Return an optional function of the module that opens a port, or None.

    The docstring of this file lists these functions.
    """
    return getattr(scheme(port)[0], what, None)
