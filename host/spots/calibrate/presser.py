"""What presses the strip in a session: a person, or anything with these methods."""

from __future__ import annotations

from typing import Protocol

from ..link.board import Board
from .dark import take_dark
from .guide import Guide
from .presses import FIRM_MN
from .session import Wanted
from .spectra import SpectrumReader

LEAST_MARGIN = 1.05


class Presser(Protocol):
    """Presses the strip when a session asks for it.

    Attributes
    ----------
    patience_s : float
        How long to wait for a press to be held.
    steady : int
        How many readings in a row must be steady.
    """

    patience_s: float
    steady: int

    def stretch(self, strain_ppm: int, length_um: float) -> None:
        """Stretch the strip to this length, and touch nothing.

        Parameters
        ----------
        strain_ppm : int
            Elongation over length at rest, in millionths.
        length_um : float
            Length of the strip at that strain, in um.
        """

    def press(self, wanted: Wanted) -> None:
        """Begin a press."""

    def release(self) -> None:
        """End it."""

    def dark(self, board: Board) -> None:
        """Take the dark frame of an LED that is always on, and touch nothing meanwhile."""

    def least_mN(self, wanted: Wanted, reader: SpectrumReader) -> float:
        """Find a force, as small as may be, under which every channel sees light there.

        Parameters
        ----------
        wanted : Wanted
            A press at the place, with the largest force allowed.
        reader : SpectrumReader
            Reads the light meanwhile.

        Returns
        -------
        float
            The force in mN, with a margin.
        """

    def turn(self, direction: int, share: float) -> Wanted:
        """Turn the joint on; `share` of the way up from its lowest angle.

        Parameters
        ----------
        direction : int
            1 up, -1 down.
        share : float
            From 0 to 1.

        Returns
        -------
        Wanted
            A press of the joint's indenter, with the angle in degrees.
        """


class PersonPresser:
    """A person with a ruler and a scale.

    Parameters
    ----------
    guide : Guide
    """

    patience_s = 120.0
    steady = 3

    def __init__(self, guide: Guide):
        self._guide = guide

    def stretch(self, strain_ppm: int, length_um: float) -> None:
        if strain_ppm:
            length = f"the strip to {length_um / 1000:.1f} mm ({strain_ppm / 10_000:g} %)"
            self._guide.ask(f"stretch {length}, do not touch it, then press Enter: ")

    def press(self, wanted: Wanted) -> None:
        if wanted.kind == "mark" and wanted.angle_deg is not None:
            self._guide.say(f"turn the joint up to {wanted.angle_deg:g} degrees and hold")
        elif wanted.kind != "joint":
            self._guide.say(f"press at {wanted} and hold")

    def release(self) -> None:
        self._guide.say("release")

    def dark(self, board: Board) -> None:
        take_dark(board, self._guide.ask)

    def least_mN(self, wanted: Wanted, reader: SpectrumReader) -> float:
        place = f"{wanted.place_um / 1000:.1f} mm"
        force_N = self._guide.ask_number(
            f"press at {place} as lightly as still lights every channel; what does the scale show, "
            "in N? ",
            lowest=0.01,
            # A strip that is dark under a firm press has no positions; and a scale may show grams.
            highest=FIRM_MN / 1000,
        )
        return 1000 * force_N * LEAST_MARGIN

    def turn(self, direction: int, share: float) -> Wanted:
        way = "up" if direction > 0 else "down"
        angle = self._guide.ask_number(
            f"turn the joint {way} to its next angle and hold; which is it, in degrees? "
        )
        return Wanted(kind="joint", place_um=0, force_mN=0, angle_deg=angle, direction=direction)
