"""Port schemes: names for `open` and ``--port`` that are not names of serial ports.

A scheme is the word before the colon: ``zenoh`` in ``zenoh:ID``. Each scheme has a module, which is
registered as an entry point of the group ``spots.ports`` with the scheme's name. The module must
have

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
from types import ModuleType
from typing import Any

from ..common.plugins import entry_points
from ..errors import did_you_mean, missing

GROUP = "spots.ports"
_SIMULATED = "virtual"
_FORMS = {"recording": "recording:FILE", "zenoh": "zenoh:ID"}  # other schemes are a bare name


def form(scheme: str) -> str:
    """Return how a port with a scheme is written, such as ``zenoh:ID``."""
    return _FORMS.get(scheme, scheme)


def modules(without: Collection[str] = ()) -> Iterator[tuple[str, ModuleType]]:
    """Yield (scheme, module) of each kind of port whose package is installed."""
    for entry in sorted(entry_points(group=GROUP)):
        if entry.name not in without:
            with suppress(ImportError):
                yield entry.name, entry.load()


def known(without: Collection[str] = ()) -> str:
    """Return a text that lists the forms of non-serial ports, such as ``zenoh:ID``."""
    names = sorted({entry.name for entry in entry_points(group=GROUP)} - set(without))
    forms = [_FORMS.get(name, f"'{name}'") for name in names]
    return " or ".join(filter(None, [", ".join(forms[:-1]), *forms[-1:]]))


def no_port(port: str) -> str:
    """Return the error message for a port that does not exist; suggest a similar name."""
    names = (entry.name for entry in entry_points(group=GROUP))
    hint = did_you_mean(port.partition(":")[0], names, "'spots ports' lists the ports", _FORMS)
    return f"there is no port {port}: {hint}"


def scheme_name(port: str | None) -> str:
    """Return the scheme of a port: ``zenoh`` for ``zenoh:ID``, empty for a serial port or None."""
    name = (port or "").partition(":")[0]
    return name if entry_points(group=GROUP, name=name) else ""


def scheme(port: str | None) -> tuple[ModuleType | None, str]:
    """Return the module that opens a port such as ``zenoh:ID``, and the text after the colon.

    The module of a serial port is None, and its text the whole port. RequirementError if a package
    that the scheme needs is not installed.
    """
    name, _, target = (port or "").partition(":")
    try:
        for entry in entry_points(group=GROUP, name=name):
            return entry.load(), target
    except ImportError:
        if name != _SIMULATED:
            raise
    if name == _SIMULATED:
        raise missing(f"port '{name}' needs", "the simulator", "virtual")
    return None, port or ""


def offered(port: str | None, what: str) -> Any:
    """Return an optional function of the module that opens a port, or None.

    The docstring of this file lists these functions.
    """
    return getattr(scheme(port)[0], what, None)
