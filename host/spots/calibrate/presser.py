"""Who presses: a person who is told where, or the stage of a simulated strip.

Nothing else in a session differs between the two.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from spots_sim.stage import FIRM_MN, Stage

from .guide import Guide
from .session import Wanted
from .spectra import Reader

_JOINT_SHARE = (0.1, 0.9)  # of the strip, that the indenter travels
_LEAST_MARGIN = 1.05


class Presser(Protocol):
    """What a session asks of whoever presses.

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
        """Stretch the strip to this length, and touch nothing."""

    def press(self, wanted: Wanted) -> None:
        """Begin a press."""

    def release(self) -> None:
        """End it."""

    def least_mN(self, wanted: Wanted, reader: Reader) -> float:
        """Find a force, as small as may be, under which every channel sees light there."""

    def turn(self, direction: int, share: float) -> Wanted:
        """Turn the joint on; `share` of the way up from its lowest angle."""


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
            self._guide.ask(f"stretch {length}, let it go untouched, then Enter: ")

    def press(self, wanted: Wanted) -> None:
        if wanted.kind != "joint":
            self._guide.say(f"press at {wanted} and hold")

    def release(self) -> None:
        self._guide.say("let go")

    def least_mN(self, wanted: Wanted, reader: Reader) -> float:
        place = f"{wanted.place_um / 1000:.1f} mm"
        force_N = self._guide.ask_number(
            f"press at {place} as lightly as still lights every channel; what does the scale say, "
            "in N? ",
            lowest=0.01,
            # What is dark under a firm press has no positions, and grams are no newtons.
            highest=FIRM_MN / 1000,
        )
        return 1000 * force_N * _LEAST_MARGIN

    def turn(self, direction: int, share: float) -> Wanted:
        way = "up" if direction > 0 else "down"
        angle = self._guide.ask_number(
            f"turn the joint {way} to its next angle and hold; which is it, in degrees? "
        )
        return Wanted(kind="joint", place_um=0, force_mN=0, angle_deg=angle, direction=direction)


class StagePresser:
    """The stage of a simulated strip.

    Parameters
    ----------
    stage : Stage
    """

    patience_s = 2.0
    steady = 1

    def __init__(self, stage: Stage):
        self._stage = stage

    def stretch(self, strain_ppm: int, length_um: float) -> None:
        self._stage.held.strain = strain_ppm * 1e-6

    def press(self, wanted: Wanted) -> None:
        self._stage.press(wanted.place_um, wanted.force_mN)

    def release(self) -> None:
        self._stage.release()

    def least_mN(self, wanted: Wanted, reader: Reader) -> float:
        low_mN, high_mN = 1.0, wanted.force_mN
        while high_mN > _LEAST_MARGIN * low_mN:
            middle_mN = (low_mN * high_mN) ** 0.5
            self._stage.press(wanted.place_um, middle_mN)
            if reader.read(8).dark:
                low_mN = middle_mN
            else:
                high_mN = middle_mN
        self._stage.release()
        return _LEAST_MARGIN * high_mN

    def turn(self, direction: int, share: float) -> Wanted:
        joint = self._stage.sensor.joint
        first_um, last_um = np.array(_JOINT_SHARE) * self._stage.length_um
        um_per_deg = np.radians(1) * joint.radius_mm * 1000
        angle_deg = round(float(share * (last_um - first_um) / um_per_deg), 3)
        # The indenter lags behind the joint by half its play in either direction.
        place_um = first_um + (angle_deg - direction * joint.play_deg / 2) * um_per_deg
        return Wanted(
            kind="joint",
            place_um=float(place_um),
            force_mN=joint.force_mN,
            angle_deg=angle_deg,
            direction=direction,
        )
