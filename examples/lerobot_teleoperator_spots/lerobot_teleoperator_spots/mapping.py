"""From a reading of the strip to an action; needs no LeRobot."""

from __future__ import annotations

from typing import NamedTuple

import spots


class Mapping(NamedTuple):
    """How a reading becomes an action.

    Attributes
    ----------
    length_um : float
        Length of the strip.
    light_N, closed_N : float
        Forces at which the gripper starts to close, and is closed.
    """

    length_um: float
    light_N: float = 0.5
    closed_N: float = 5.0

    def action(self, touch: spots.Touch | None, before: dict[str, float]) -> dict[str, float]:
        """Return the action for the newest reading.

        Parameters
        ----------
        touch : spots.Touch or None
            The reading; None if there is no valid one, for example while the board is unplugged.
        before : dict
            The previous action. An untrusted reading, such as that of two fingers, repeats it.

        Returns
        -------
        dict
            ``position`` (0 to 1), ``force`` in N, ``gripper`` (0 open, 1 closed).
        """
        if touch is None or not touch.touching:
            return {"position": before["position"], "force": 0.0, "gripper": 0.0}
        if not touch.trusted:
            return before
        force_n = touch.force_mN / 1000
        share = (force_n - self.light_N) / (self.closed_N - self.light_N)
        return {
            "position": min(max(touch.position_um / self.length_um, 0.0), 1.0),
            "force": force_n,
            "gripper": min(max(share, 0.0), 1.0),
        }


REST = {"position": 0.0, "force": 0.0, "gripper": 0.0}
