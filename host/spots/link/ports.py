"""Port schemes: what `open` and ``--port`` take besides the names of serial ports.

A scheme is a module. It enters itself as an entry point of the group ``spots.ports``, whose name is
the word before the colon, ``zenoh`` in ``zenoh:ID``. It has

``open_port(rest, *, sensor, scenario, seed)``
    Returns a `Board`; `rest` is what follows the colon, and the others describe a simulated
    board. Raises SpotsError.

and may have

``check(rest, *, sensor, scenario, seed)``
    Raises SpotsError for what waiting for the board does not mend.
``calibration_setup(options, made, out, guide)``
    Of a port that presses its strip by itself: a `calibrate.steps.Setup`. ``made`` is a session,
    or the calibration of a strip that may have drifted.
``linkage(sensor, linkage, path=…, seed=…, exposure_us=…)``
    Of a port that is a whole linkage: a `linkage.twin_source.DrivenLinkage`. Three have defaults.
``run_linkage(options)``
    Follows a linkage whose truth is known, for ``spots twin`` without boards.
``flash_place(device)``
    Of a port that can be flashed: a context manager with a `deploy.place.Place`.
"""

from __future__ import annotations

import difflib
from importlib.metadata import entry_points
from types import ModuleType
from typing import Any

from ..errors import missing

GROUP = "spots.ports"
_SIMULATED = "virtual"
_FORMS = {"recording": "recording:FILE", "zenoh": "zenoh:ID"}  # of our own


def known() -> str:
    """Return how the ports of all installed schemes are written, for help and errors."""
    names = sorted(entry.name for entry in entry_points(group=GROUP))
    forms = [_FORMS.get(name, f"'{name}'") for name in names]
    return " or ".join(filter(None, [", ".join(forms[:-1]), *forms[-1:]]))


def no_port(port: str) -> str:
    """Return the error of a port that does not exist; it suggests a similar scheme."""
    names = [entry.name for entry in entry_points(group=GROUP)]
    similar = difflib.get_close_matches(port.partition(":")[0].lower(), names, n=1, cutoff=0.7)
    if similar:
        return f"there is no port {port}: did you mean {_FORMS.get(similar[0], similar[0])}?"
    return f"there is no port {port}: 'spots ports' lists the ports"


def scheme_name(port: str | None) -> str:
    """Return the name of a port's scheme; empty for a serial port, and for None."""
    name = (port or "").partition(":")[0]
    return name if entry_points(group=GROUP, name=name) else ""


def scheme(port: str | None) -> tuple[ModuleType | None, str]:
    """Return the module of a port's scheme and what follows the colon.

    Parameters
    ----------
    port : str or None

    Returns
    -------
    module : module or None
        None for a serial port, and for None.
    rest : str

    Raises
    ------
    SpotsError
        If what the scheme needs is not installed.
    """
    name, _, rest = (port or "").partition(":")
    try:
        for entry in entry_points(group=GROUP, name=name):
            return entry.load(), rest
    except ImportError:
        if name != _SIMULATED:
            raise
    if name == _SIMULATED:
        raise missing(f"port '{name}' needs", "the simulator", "virtual")
    return None, port or ""


def offered(port: str | None, what: str) -> Any:
    """Return a function that a port's scheme may have, or None.

    Parameters
    ----------
    port : str or None
        A port as `spots.open` takes it.
    what : str
        Name of the function in the module of the port's scheme.

    Returns
    -------
    callable or None
        None if the scheme does not have it.
    """
    return getattr(scheme(port)[0], what, None)
