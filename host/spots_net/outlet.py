"""The outlets of ``spots publish --to``: their interface, and where each of them is."""

from argparse import ArgumentTypeError
from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any, Protocol

from spots.errors import missing
from spots.link.board import Board
from spots.link.frames import Reading

# Class of each outlet, the package it needs, and the extra that installs it.
_OUTLETS = {
    "ros2": ("spots_net.publish:Publisher", "Zenoh", "zenoh"),
    "foxglove": ("spots_net.to_foxglove:Foxglove", "aiohttp", "foxglove"),
    "lsl": ("spots_net.to_lsl:Lsl", "pylsl", "lsl"),
    "osc": ("spots_net.to_osc:Osc", "python-osc", "osc"),
    "rerun": ("spots_net.to_rerun:Rerun", "rerun-sdk", "rerun"),
}
NAMES = tuple(_OUTLETS)
DEFAULT = NAMES[0]
_WITHOUT = ("lsl",)  # outlets without an address of their own


class Outlet(Protocol):
    """A way in which a board's readings leave the program.

    An outlet never waits: what it cannot send at once is dropped.
    """

    place: str
    """Where the readings can be received, to be printed."""

    def put(self, frame: Reading, utc_s: float) -> None:
        """Send a frame, measured at `utc_s` (seconds since 1970)."""
        ...

    def turn(self) -> None:
        """Do what is due; called after every frame, and at least every 0.05 s."""
        ...

    def close(self) -> None:
        """Stop sending."""
        ...


def checked(name: str) -> str:
    """Return the argument of ``--to`` unchanged; ArgumentTypeError if it names no outlet."""
    kind, equals, _ = name.partition("=")
    if kind not in _OUTLETS:
        known = ", ".join(NAMES)
        raise ArgumentTypeError(f"there is no outlet {kind!r}: give one of {known}")
    if equals and kind in _WITHOUT:
        raise ArgumentTypeError(f"the outlet {kind} takes no address: give --to {kind}")
    return name


def maker(name: str, /, **settings: Any) -> Callable[[Board], Outlet]:
    """Return the function that opens an outlet for a board; it raises SpotsError.

    `name` is one of `NAMES`; the outlet's own address may follow after "=", such as
    ``osc=192.168.1.7:9000``. The settings go to the outlet's class. RequirementError if the package
    that the outlet needs is missing.
    """
    kind, _, address = name.partition("=")
    place, package, extra = _OUTLETS[kind]
    module, _, attribute = place.partition(":")
    try:
        made = getattr(import_module(module), attribute)
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("spots"):
            raise
        raise missing(f"publishing to {kind} needs", package, extra) from None
    if address:
        settings["address"] = address
    return partial(made, **settings)
