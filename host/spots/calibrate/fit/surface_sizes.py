"""Expected sizes of errors and coefficients of `surface.Surface`."""

from __future__ import annotations

from dataclasses import dataclass

from spots_device.sensor.smux import CHANNELS


@dataclass(frozen=True)
class Sizes:
    """Expected sizes of the errors and coefficients of the model, see `surface`.

    - `place_um`: standard deviation of the positions that a person reads off a ruler.
    - `force_share`: relative standard deviation of the forces that a person reads off a scale.
    - `force_mN`: standard deviation of a further error that is the same for all forces: rounding of
      the scale, and creep of earlier presses. It matters for weak forces.
    - `bends`: for each channel c, the coefficient of degree 2 of `s_c`, in log2 units.
    - `rise`: the coefficient of degree 2 of `g`, in log2 units.
    - `dark_share`: force at which the strip begins to give light, as a share of the least force.
    - `misfit`: standard deviation of a channel's log2(counts) from the model.
    - `warp_um`: standard deviation of the displacement w.
    - `warp_smooth`: share of the length over which w is smooth.
    - `shift_um`: shift of the position of a very weak press.
    - `cross`: the other part of t_c for a very weak press, in log2 units.
    """

    place_um: float = 300.0
    force_share: float = 0.03
    force_mN: float = 20.0
    bends: tuple[float, ...] = (0.03,) * CHANNELS
    rise: float = 0.3
    dark_share: float = 0.8
    misfit: float = 3e-4
    warp_um: float = 0.0
    warp_smooth: float = 0.12
    shift_um: float = 0.0
    cross: float = 0.0


USUAL = Sizes()
# Sizes of t_c from which the search for them starts.
CROSSED = {"shift_um": 1000.0, "cross": 0.003}
