"""Chooses the six of the sensor's nine diodes that give the least noise of the position.

A plan is a choice of six diodes, one for each channel of the board. Presses along the strip are
read with two plans, which together contain all nine diodes. A pass is all readings with one plan.
Three diodes are in both plans; they show how much the force differs between the passes.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from spots_device.board.settings import DEFAULT_CHANNELS

from ...errors import CalibrationError
from .curves import Curves
from .presses import Noise, Presses

DIODES = ("F1", "F2", "F3", "F4", "F5", "F6", "F7", "F8", "CLEAR")
_FULLEST = 0.95  # largest usable count as a share of full scale
_WORTH = 0.03  # least relative improvement that is worth a new plan
_PLACES = 41  # number of positions over which the noise is averaged


@dataclass(frozen=True)
class Choice:
    """The best plan (choice of six diodes), and the expected noise of the position.

    The sigmas are least possible standard deviations of the position from one sample, averaged over
    the strip. `present_sigma_um` is that of the plan of the first pass; infinite if one of its
    channels is unusable.
    """

    plan: tuple[str, ...]
    sigma_um: float
    present_sigma_um: float


def passes(present: tuple[str, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return two plans of six diodes; they share three diodes and together contain all nine.

    The first plan is the board's plan `present` if all its diodes are in `DIODES`; else it is
    `DEFAULT_CHANNELS`.
    """
    first = present if set(present) <= set(DIODES) else DEFAULT_CHANNELS
    others = [diode for diode in DIODES if diode not in first]
    return first, tuple(others) + first[::2]


def choose(
    plans: tuple[tuple[str, ...], tuple[str, ...]],
    measured: tuple[Presses, Presses],
    full_scale: float,
) -> Choice:
    """Return the plan with the least expected noise of the position.

    The result is the plan of the first pass if its noise is at most 3 % larger. The plans are those
    of the two `passes`. Each pass has presses with the force `presses.FIRM_MN`, at the same
    positions as the other pass, and one press with `presses.FULL_MN`, which shows which channels
    saturate. `full_scale` is the largest count that a channel can have. CalibrationError if fewer
    than six diodes are usable.
    """
    usable, places_um, logs = _merge(plans, measured, full_scale)
    if len(usable) < len(plans[0]):
        raise CalibrationError(
            f"only {len(usable)} channels are usable, but six are needed; the other channels are "
            "too dark or too bright: begin another session without --keep-settings, or set gain "
            "and LED current and begin one with --keep-settings"
        )
    used = [np.isin(plan, usable) for plan in plans]
    noise = Noise.of(*(p.channels(columns) for p, columns in zip(measured, used)))
    curves = Curves(places_um, logs, noise.log_variance(2.0**logs))
    x_um = np.linspace(*curves.ends_um, _PLACES)
    slopes, weights = curves.slopes(x_um), 1 / noise.log_variance(2.0 ** curves.logs(x_um))

    def sigma_um(plan) -> float:
        """Return the least possible standard deviation of positions, averaged over the strip."""
        columns = [usable.index(diode) for diode in plan]
        slope, weight = slopes[:, columns], weights[:, columns]
        a, b, c = weight.sum(1), (weight * slope).sum(1), (weight * slope**2).sum(1)
        return float(np.sqrt(a / (a * c - b**2)).mean())

    best = min(itertools.combinations(usable, len(plans[0])), key=sigma_um)
    present = sigma_um(plans[0]) if set(plans[0]) <= set(usable) else np.inf
    if present <= (1 + _WORTH) * sigma_um(best):
        best = plans[0]
    return Choice(best, sigma_um(best), present)


def _merge(plans, measured, full_scale):
    """Merge the readings of both passes.

    The arguments are those of `choose`. Returns the names of the c usable diodes, the n positions
    in um, and log2 of the counts of these diodes, shape (n, c). The counts of the second pass are
    scaled to the force of the first pass.
    """
    firm = [p.keep(p.force_mN == p.force_mN.min()) for p in measured]
    bad = {
        diode
        for plan, presses in zip(plans, measured)
        for diode, column in zip(plan, presses.counts.T)
        if column.max() > _FULLEST * full_scale or column.min() < 1
    }
    first, second = (
        {d: np.log2(column) for d, column in zip(plan, presses.counts.T) if d not in bad}
        for plan, presses in zip(plans, firm)
    )
    shared = [diode for diode in first if diode in second]
    if not shared:
        return [], firm[0].position_um, np.empty((0, 0))
    harder = np.mean([second[diode] - first[diode] for diode in shared], axis=0)
    logs = {diode: column - harder for diode, column in second.items()} | first
    usable = [diode for diode in DIODES if diode in logs]
    return usable, firm[0].position_um, np.stack([logs[diode] for diode in usable], axis=1)
