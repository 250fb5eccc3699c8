"""Compensates hysteresis and creep of the silicone, which change the light of a force.

Hysteresis is a weighted sum of play operators (Prandtl-Ishlinskii), of which only the difference to
a first load is subtracted: the force table is that of first loads. Creep follows the force with
several time constants; a share of it is subtracted. The operators restart when the
finger lifts or moves on, creep when another place is pressed; until then it recovers by its own
time constants. Integers of 31 bits only; `take` allocates nothing.
"""

from array import array

from .decode import LED_OFF

try:
    from micropython import const
except ImportError:
    const = int  # on the host

WEIGHTS_MAX = (1 << 14) - 1  # of the sum of absolute weights, so that 65 N fits 31 bits
# Another place, if the force is large enough for a position of little noise.
_APART_UM = const(8000)
_SURE_MN = const(400)
_TIME_MASK = const((1 << 22) - 1)  # ticks as in contact.py
# Creep is computed at intervals in which its rounded steps are still small, and at most this long.
_LEAST_T = const(16)
_STEP_T = const(256)
_LONGEST_T = const(1 << 14)


class Compensation:
    """State of the silicone under one finger.

    Parameters
    ----------
    gain : int
        Factor of the force in Q12.
    loops : sequence of (int, int)
        Half width of each play operator in mN, and its weight in Q12.
    creeps : sequence of (int, int)
        Time constant of each part of the creep in ticks, and its share of the force in Q12.
    """

    def __init__(self, gain, loops, creeps):
        self._gain = gain
        self._radii = array("i", [row[0] for row in loops])
        self._weights = array("i", [row[1] for row in loops])
        self._plays = array("i", bytes(4 * len(loops)))
        self._taus = array("i", [row[0] for row in creeps])
        self._shares = array("i", [row[1] for row in creeps])
        self._crept = array("i", bytes(4 * len(creeps)))  # mN, Q6
        self._t = self._x_um = self._force = 0

    def take(self, decode, t):
        """Correct the force of a reading.

        Parameters
        ----------
        decode : decode.Decode
            Contains the reading; its `force_mN` is changed.
        t : int
            Time in ticks.
        """
        crept = self._crept
        since = t - self._t & _TIME_MASK
        if since >= _LEAST_T:
            self._t = t
            since = min(since, _LONGEST_T)
            while since > 0:
                step = min(since, _STEP_T)
                since -= step
                for i in range(len(crept)):
                    tau = self._taus[i]
                    crept[i] += (self._force - crept[i]) * min(step, tau) // tau
        if decode.flags & LED_OFF:
            return
        force_mN = decode.force_mN
        plays = self._plays
        if force_mN:
            if force_mN > _SURE_MN and abs(decode.position_um - self._x_um) > _APART_UM:
                self._x_um = decode.position_um
                self._force = 0
                for i in range(len(crept)):
                    crept[i] = 0
            total = self._gain * force_mN + 2048
            for i in range(len(plays)):
                radius = self._radii[i]
                loading = max(force_mN - radius, 0)
                # A finger that lifted or moved on has the force 0 before this one.
                play = plays[i] if self._force else 0
                plays[i] = play = max(min(play, force_mN + radius), loading)
                total -= self._weights[i] * (play - loading)
            for i in range(len(crept)):
                total -= self._shares[i] * (crept[i] >> 6)
            decode.force_mN = force_mN = min(max(total >> 12, 1), 65_535)
        self._force = force_mN << 6
