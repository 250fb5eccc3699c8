"""Port schemes: names for `open` and ``--port`` that are not names of serial ports.

A scheme is the word before the colon: ``zenoh`` in ``zenoh:ID``. Each scheme has an entry
point of the group ``spots.ports``: a function ``open_port(target, options)``, which returns a
`Board`, or raises SpotsError. `target` is the text after the colon; `options` are those of the
command line, or None in a program. The name of the entry point is the scheme, and after it,
separated by dots, what is needed before the function is loaded:

- the text after the colon as the help shows it, in capitals;
- ``read-only`` if a command cannot change the board;
- ``comes-and-goes`` if the board may be absent for a time, so that ``--wait`` has an effect.

Examples are ``virtual`` and ``zenoh.ID.read-only.comes-and-goes``.

What else a kind of port can do, its package registers in the group ``spots.abilities`` under the
name ``SCHEME.ABILITY``, as in ``virtual.practice``. The function or class that asks for an ability
by `offered` describes it: ``add_options`` and ``add_linkage_options`` (`cli.arguments`), ``check``
(`link.finder`), ``calibration_setup`` (`calibrate.session.calibrate.opened`), ``practice``
(`calibrate.session.practice.Practice`), ``flash_place`` (`deploy.place`), ``linkage`` and
``run_linkage`` (the package of the linkage).
"""

from collections.abc import Callable, Collection
from contextlib import nullcontext, suppress
from importlib.metadata import EntryPoint
from typing import Any

from ..common.plugins import entry_points
from ..errors import did_you_mean, missing

GROUP, ABILITIES = "spots.ports", "spots.abilities"
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


def installed(without: Collection[str] = ()) -> list[str]:
    """Return the schemes of all installed kinds of ports, except those in `without`."""
    return [scheme for scheme in _entries() if scheme not in without]


def known(without: Collection[str] = ()) -> str:
    """Return a text that lists the forms of non-serial ports, such as ``zenoh:ID``."""
    written = [form(scheme) for scheme in installed(without)]
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


def opener(port: str | None) -> tuple[Callable[..., Any] | None, str]:
    """Return the function that opens a port such as ``zenoh:ID``, and the text after the colon.

    The function of a serial port is None, and its text the whole port. RequirementError if a
    package that the scheme needs is not installed.
    """
    name, _, target = (port or "").partition(":")
    found = _loaded(_entries().get(name), name)
    return (found, target) if found is not None else (None, port or "")


def offered(port: str | None, ability: str) -> Any:
    """Return the object of an ability of a kind of port, or None; see the top of this file."""
    name = (port or "").partition(":")[0]
    entry = next(iter(entry_points(group=ABILITIES, name=f"{name}.{ability}")), None)
    return None if entry is None and name in _entries() else _loaded(entry, name)


def _loaded(entry: EntryPoint | None, scheme: str) -> Any:
    with suppress(ModuleNotFoundError) if scheme == SIMULATED else nullcontext():
        if entry is not None:
            return entry.load()
    if scheme == SIMULATED:
        raise missing(f"port '{scheme}' needs", "the simulator", "virtual")
    return None
