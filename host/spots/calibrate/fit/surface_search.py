"""Searches for the sizes of errors and coefficients with the largest evidence."""

from __future__ import annotations

from dataclasses import replace

from spots_device.sensor.smux import CHANNELS

from .presses import Noise, Presses
from .surface import Surface
from .surface_sizes import CROSSED, USUAL, Sizes

# Values of each size that `fitted` tries, see `Sizes`.
_GRIDS = {
    "place_um": (1.0, 10.0, 30.0, 60.0, 100.0, 200.0, 300.0, 500.0),
    "force_share": (0.0003, 0.003, 0.01, 0.02, 0.03, 0.05, 0.08),
    "force_mN": (0.3, 3.0, 20.0),
    "bends": (3e-4, 1e-3, 0.003, 0.01, 0.03, 0.1, 0.3),
    "rise": (0.03, 0.1, 0.3, 1.0),
    "dark_share": (0.0, 0.3, 0.5, 0.7, 0.8, 0.85, 0.9, 0.93, 0.96, 0.98),
    "misfit": (3e-4, 1e-3, 3e-3, 1e-2),
    "warp_um": (0.0, 50.0, 100.0, 200.0, 400.0),
    "warp_smooth": (0.08, 0.12, 0.18, 0.27),
    "shift_um": (0.0, 100.0, 300.0, 1000.0, 3000.0),
    "cross": (0.0, 0.003, 0.01, 0.03, 0.1),
}
# Each channel has its own expected bend. The curves `s_c` of most channels are nearly straight,
# because these channels receive a narrow band of the spectrum. Errors of the ruler bend all curves
# in proportion to their slopes. So curves that are known to be nearly straight reveal these errors.
_SEARCHED = [
    (name, channel)
    for name in _GRIDS
    for channel in (range(CHANNELS) if name == "bends" else (None,))
]
_CROSS_EVIDENCE = 5.0  # least increase of the evidence by t_c
_CROSS_FROM = 20  # least number of presses with a known force for t_c
_PLAIN = [one for one in _SEARCHED if one[0] not in CROSSED]
_SWEEPS = 4  # largest number of searches through all sizes in `fitted`


def fitted(
    presses: Presses,
    noise: Noise,
    samples: int,
    length_um: float,
    sizes: Sizes = USUAL,
) -> Surface:
    """Fit surfaces with different `Sizes`; return that of largest evidence (marginal likelihood).

    The search starts from `sizes`. The other arguments are those of `Surface`.
    """
    plain = replace(sizes, shift_um=0.0, cross=0.0)
    best = _best(Surface(presses, noise, samples, length_um, plain), _PLAIN)
    if (presses.force_mN > 0).sum() < _CROSS_FROM:
        return best
    crossed = sizes if sizes.shift_um or sizes.cross else replace(best.sizes, **CROSSED)
    crossed = _best(Surface(presses, noise, samples, length_um, crossed), _SEARCHED)
    return crossed if crossed.evidence > best.evidence + _CROSS_EVIDENCE else best


def _best(best: Surface, searched: list[tuple[str, int | None]]) -> Surface:
    """Change the sizes `searched` in turn, until none of them increases the evidence."""
    unchanged = 0
    for name, channel in searched * _SWEEPS:
        before, grid, value = best, _GRIDS[name], getattr(best.sizes, name)
        at = grid.index(value if channel is None else value[channel])
        for step in (-1, 1):
            for size in grid[at + step :: step] if at + step >= 0 else ():
                changed = size
                if channel is not None:
                    changed = (*value[:channel], size, *value[channel + 1 :])
                sizes = replace(best.sizes, **{name: changed})
                surface = replace(best, sizes=sizes, start=best)
                if surface.evidence <= best.evidence:
                    break
                best = surface
        unchanged = unchanged + 1 if best is before else 0
        if unchanged == len(searched):
            break
    return best
