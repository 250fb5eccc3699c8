"""What a calibration session needs of a terminal or a web UI."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .session import Wanted
from .spectra import Reading


class UndoError(Exception):
    """Request to drop the last press and to ask for it again. `watch` and `ask` may raise it."""


@dataclass(frozen=True)
class Progress:
    """State of a session by hand, after a fit of the n presses that it has.

    Attributes
    ----------
    place_um : numpy.ndarray, shape (n,)
        Places of the presses in um, as a person read them.
    force_mN : numpy.ndarray, shape (n,)
        Forces of the presses in mN, as a person read them; 0 if unknown.
    off_um : numpy.ndarray, shape (n,)
        Place by the fit minus `place_um`.
    off_share : numpy.ndarray, shape (n,)
        Force by the fit over `force_mN`, minus 1; 0 if the force is unknown.
    sigma_um : float
        Expected standard deviation of a position, in um; the mean over the strip.
    sigma_share : float
        Expected relative standard deviation of a force; the mean over the forces.
    thin : tuple of str
        Ranges of place and force with few presses, as text.
    done, total : int
        Presses taken, and presses of the whole session.
    """

    place_um: np.ndarray
    force_mN: np.ndarray
    off_um: np.ndarray
    off_share: np.ndarray
    sigma_um: float
    sigma_share: float
    thin: tuple[str, ...]
    done: int
    total: int


class Dialog(Protocol):
    """Shows a session and asks its questions; called from the thread of the session.

    `watch` and `ask` may raise `UndoError`. They may raise `SpotsError` to end the session; the
    presses that were taken are stored, and a new session with the same file continues.
    """

    def begin(self, title: str, total: int, plan: tuple[str, ...], length_um: float) -> None:
        """Begin a series of `total` presses of a strip, with the names of the channels."""

    def skip(self, count: int = 1) -> None:
        """Increase the number of presses taken by `count`, which may be negative."""

    def want(self, wanted: Wanted) -> None:
        """Show where to press next."""

    def watch(self, reading: Reading, trouble: str | None, steady: float) -> None:
        """Show a reading, why it is not steady, and the share of steady readings, 0 to 1."""

    def taken(self, wanted: Wanted, reading: Reading) -> None:
        """Show that a press was taken."""

    def fitted(self, progress: Progress) -> None:
        """Show the state of a session by hand; called after each of its presses."""

    def say(self, text: str) -> None:
        """Show a message."""

    def ask(self, question: str) -> str:
        """Block until a person answers a question, and return the answer."""
