"""Interface of a calibration session to a person, who uses a terminal or a browser.

In a session *by hand*, the person reads positions off a ruler, and forces off a scale.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..fit.points import Wanted
from .spectra import Reading

PRESS, RELEASE = "press", "release"  # what a session requests, see `Dialog.request`


class UndoError(Exception):
    """Raised by methods of `Dialog` if the person wants to drop the last press and repeat it."""


@dataclass(frozen=True)
class Progress:
    """State of a session by hand, after a fit to the n presses that were taken.

    `place_um` and `force_mN` are what the person read; a force is 0 if unknown. `off_um` and
    `off_share` are leave-one-out errors: the position from a fit to all other presses minus
    `place_um`; the force from it divided by `force_mN`, minus 1, 0 if the force is unknown.
    `sigma_um` and `sigma_share` are expected standard deviations, averaged over the strip and over
    the forces; the latter is relative, and NaN if no force is known. `thin` are positions and
    forces near which there are too few presses, for example ``near 40 mm``. `done` and `total` are
    the numbers of taken and of planned presses.
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
    """Methods that a session calls, in its own thread, to show messages and to ask questions.

    `watch` and `ask` may raise `UndoError`. They may raise `SpotsError` to end the session. All
    presses taken before are stored; a later session with the same file continues after them.
    """

    def begin(self, title: str, total: int, plan: tuple[str, ...], length_um: float) -> None:
        """Begin a series of presses on a strip of the length `length_um`.

        `title` is the name of the series, `total` the number of its presses, `plan` the names of
        the channels.
        """

    def skip(self, count: int = 1) -> None:
        """Add `count` to the displayed number of presses taken; a negative number subtracts."""

    def want(self, wanted: Wanted) -> None:
        """Show where to press next."""

    def watch(self, reading: Reading, trouble: str | None, steady: float) -> None:
        """Show a reading of the present press.

        `trouble` is the reason why the press is not steady, or the request ``release``; None for a
        steady press. `steady` is the progress of the press, 0 to 1: the number of steady readings
        or the duration of the hold, as a share of what the press needs.
        """

    def taken(self, wanted: Wanted, reading: Reading) -> None:
        """Show that the press `wanted` was taken; `reading` has its counts."""

    def fitted(self, progress: Progress) -> None:
        """Show the progress of a session by hand after a press."""

    def request(self, phase: str, text: str) -> None:
        """Show a request to press or to release the strip; the phase is `PRESS` or `RELEASE`."""

    def say(self, text: str) -> None:
        """Show a message to the person."""

    def ask(
        self, question: str, place_um: float | None = None, force_mN: float | None = None
    ) -> str:
        """Block until a person answers a question, and return the answer.

        In practice, a simulated ruler shows the position of the finger, and a simulated scale the
        force; None for one that the question does not need.
        """
