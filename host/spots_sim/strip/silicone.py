"""Simulates creep, hysteresis and softening of a strip's silicone, which change the contact area.

At each position, the contact area depends on all earlier forces at this position. The model
computes an *effective force*: the force under which an ideal material has this contact area. Each
effect has two models of different structure, so that a compensation can be tested on a material for
which it was not made:

==========  =========================================  =======================================
effect      ``model = "spectrum"``                     ``model = "power"``
==========  =========================================  =======================================
creep       a Prony series: four time constants        a power law of time, as in fractional
                                                       elements (Scott Blair, 1947)
hysteresis  play operators (Prandtl-Ishlinskii)        Bouc-Wen (Wen, J. Eng. Mech. 102, 1976)
softening   only at forces below the largest force so  at every force, by an amount that
            far (Ogden and Roxburgh, Proc. R. Soc. A   depends on the largest force so far
            455, 1999)
==========  =========================================  =======================================
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Annotated, Literal

import msgspec
import numpy as np

from spots.common import toml

_Percent = Annotated[float, msgspec.Meta(ge=0, le=50)]
_Force = Annotated[float, msgspec.Meta(ge=0, le=1e6)]
FULL_MN = 10_000.0  # the percentages of hysteresis and softening are shares of this force
_HELD_S = 60.0  # duration to which `creep_percent` refers
_CELL_MM = 2.0  # length of a cell; the effective force is interpolated between two cells
# Constants of the models, all assumed. Creep of rubber is nearly linear in the logarithm of time
# (Gent, Engineering with Rubber), so each decade has the same share.
_TAUS_S = np.array([0.5, 5.0, 50.0, 500.0])  # time constants of the creep
_PLAYS_MN = (100.0, 300.0, 900.0, 2700.0)  # half-widths of the play operators
_POWER, _SOONEST_S = 0.15, 0.05  # the creep after t s is proportional to (1 + t / 0.05)^0.15 - 1
_STEP_S = 0.02  # changes of the force within this time count as one
_WIDTH_MN = 1500.0  # change of the force that gives 63 % of the Bouc-Wen hysteresis
_KEPT = 256  # number of cached durations; a simulation has few different ones
_SOFTENED_MN = 4000.0  # scale of the force for the softening


class Silicone(toml.Strict):
    """Table ``[silicone]`` of a sensor file: size of the effects; all are 0 in an ideal material.

    Attributes
    ----------
    model : str
        ``spectrum`` or ``power``, see the table in the module docstring.
    creep_percent : float
        Growth of the effective force in the first 60 s of a constant force, in per cent.
    hysteresis_percent : float
        Largest difference of the effective force between unloading and loading, for a load of
        10 N; in per cent of 10 N.
    softening_percent : float
        Largest growth of the effective force by a first load of 10 N (Mullins effect), in per
        cent.
    preload_mN : float
        Largest force with which the whole strip was pressed before the simulation, in mN.
    """

    model: Literal["spectrum", "power"] = "spectrum"
    creep_percent: _Percent = 0.0
    hysteresis_percent: _Percent = 0.0
    softening_percent: _Percent = 0.0
    preload_mN: _Force = 0.0

    @property
    def ideal(self) -> bool:
        """Whether the silicone has no creep, no hysteresis and no softening."""
        return not (self.creep_percent or self.hysteresis_percent or self.softening_percent)


@lru_cache(_KEPT)
def _crept_shares(elapsed_s: float) -> list[float]:
    return (-np.expm1(-elapsed_s / _TAUS_S)).tolist()


class _Spectrum:
    """Model ``spectrum`` of one cell (a short piece of the strip), see the module docstring."""

    def __init__(self, silicone: Silicone):
        self._creep = silicone.creep_percent / 100 / (1 - np.exp(-_HELD_S / _TAUS_S)).sum()
        self._lag = silicone.hysteresis_percent / 100 * FULL_MN / 2 / sum(_PLAYS_MN)
        self._soft = silicone.softening_percent / 100
        # For four numbers, plain Python without function calls is fastest.
        self._crept = [0.0] * len(_TAUS_S)
        self._plays = [0.0] * len(_PLAYS_MN)
        self._force_mN = 0.0
        self._most_mN = silicone.preload_mN

    def wait(self, elapsed_s: float) -> None:
        if elapsed_s == 0.0:
            return
        force_mN = self._force_mN
        (a, b, c, d), (p, q, r, s) = self._crept, _crept_shares(elapsed_s)
        self._crept = [
            a + (force_mN - a) * p,
            b + (force_mN - b) * q,
            c + (force_mN - c) * r,
            d + (force_mN - d) * s,
        ]

    def load(self, force_mN: float) -> None:
        self._force_mN = force_mN
        if force_mN > self._most_mN:
            self._most_mN = force_mN
        if force_mN > 0:
            plays = self._plays
            for i, play in enumerate(_PLAYS_MN):
                low_mN, high_mN = force_mN - play, force_mN + play
                if plays[i] < low_mN:
                    plays[i] = low_mN
                elif plays[i] > high_mN:
                    plays[i] = high_mN
        else:
            self._plays = [0.0] * len(_PLAYS_MN)  # the light guides separate

    def effective_mN(self) -> float:
        force_mN = self._force_mN
        behind = 0.0
        for at, play in zip(self._plays, _PLAYS_MN):
            behind += at - (force_mN - play if force_mN > play else 0.0)
        soft = self._soft * math.tanh((self._most_mN - force_mN) / _SOFTENED_MN)
        return force_mN * (1 + soft) + self._lag * behind + self._creep * sum(self._crept)


class _Power:
    """Model ``power`` of one cell (a short piece of the strip), see the module docstring.

    The computing time grows with the number of changes of the force.
    """

    def __init__(self, silicone: Silicone):
        whole = (1 + _HELD_S / _SOONEST_S) ** _POWER - 1
        self._creep = silicone.creep_percent / 100 / whole
        self._lag_mN = silicone.hysteresis_percent / 100 * FULL_MN / 2
        self._soft = silicone.softening_percent / 100 / -math.expm1(-FULL_MN / _SOFTENED_MN)
        self._now_s = self._force_mN = self._bent = 0.0
        self._steps = np.zeros((2, 64))  # time in s and size in mN of each change of the force
        self._count = 0
        self._most_mN = silicone.preload_mN

    def wait(self, elapsed_s: float) -> None:
        self._now_s += elapsed_s

    def load(self, force_mN: float) -> None:
        step_mN = force_mN - self._force_mN
        if not step_mN:
            return
        way = math.copysign(1, step_mN)
        self._bent = way * (1 - (1 - way * self._bent) * math.exp(-abs(step_mN) / _WIDTH_MN))
        if force_mN <= 0:
            self._bent = 0.0  # the light guides separate
        last = self._count - 1
        if last >= 0 and self._now_s - self._steps[0, last] < _STEP_S:
            self._steps[1, last] += step_mN
        else:
            if self._count == self._steps.shape[1]:
                self._steps = np.pad(self._steps, ((0, 0), (0, self._count)))
            self._steps[:, self._count] = self._now_s, step_mN
            self._count += 1
        self._force_mN = force_mN
        self._most_mN = max(self._most_mN, force_mN)

    def effective_mN(self) -> float:
        times_s, steps_mN = self._steps[:, : self._count]
        crept_mN = steps_mN @ ((1 + (self._now_s - times_s) / _SOONEST_S) ** _POWER - 1)
        loading = -math.expm1(-self._force_mN / _WIDTH_MN)
        lag_mN = self._lag_mN * (loading - self._bent)
        soft = self._soft * -math.expm1(-self._most_mN / _SOFTENED_MN)
        return self._force_mN * (1 + soft) + lag_mN + self._creep * crept_mN


_MODELS = {"spectrum": _Spectrum, "power": _Power}


class Memory:
    """Creep, hysteresis and softening at all positions of one strip."""

    def __init__(self, silicone: Silicone):
        self._silicone = silicone
        self._cells: dict[int, object] = {}
        self._seen_s: dict[int, float] = {}
        self._pressed: set[int] = set()

    @property
    def unloaded(self) -> bool:
        """Whether no press was on the strip at the last call of `effective_mN`."""
        return not self._pressed

    def effective_mN(self, presses, time_s: float) -> list[float]:
        """Return the effective force of each press, 0 or more; the time must never decrease."""
        if not presses and not self._pressed:
            return []
        forces: dict[int, float] = {}
        ends = []
        for press in presses:
            cell, share = divmod(press.position_mm / _CELL_MM, 1.0)
            ends.append((int(cell), share))
            for i in (int(cell), int(cell) + 1):
                forces[i] = max(forces.get(i, 0.0), press.force_mN)
        for i in self._pressed | forces.keys():
            cell = self._cells.get(i)
            if cell is None:
                cell = self._cells[i] = _MODELS[self._silicone.model](self._silicone)
            cell.wait(max(time_s - self._seen_s.get(i, time_s), 0.0))
            cell.load(forces.get(i, 0.0))
            self._seen_s[i] = time_s
        self._pressed = {i for i, force_mN in forces.items() if force_mN > 0}
        found = []
        for cell, share in ends:
            low, high = (self._cells[i].effective_mN() for i in (cell, cell + 1))
            found.append(max(low + share * (high - low), 0.0))
        return found
