"""Solves for the position of the second of two fingers, see second.py.

Boards with ``viper = true`` in board.toml get locate_viper.py instead of this file: the same
functions with identical results, in machine code. All integers fit 31 bits; allocates nothing.
"""

FAR_LOG2 = 18  # distances are below 2**18 um


def power(exponent):
    """Return 2**exponent in Q10, within 0.4 %; `exponent` is in Q20 and less than 19.0."""
    part = exponent >> 10 & 1023
    value = 1024 + (part * (672 + (352 * part >> 10)) >> 10)
    whole = exponent >> 20
    return value << whole if whole >= 0 else value >> -whole


def solve(found, decay, off_um, alone, brightness):
    """Solve the equations of second.py; return whether they have a solution.

    Parameters
    ----------
    found : array.array
        Output, ``array("i")`` of four elements: distance d of the second finger from the first one
        in um, loss of brightness (Q20 of log2), (1 - f) / f (Q10), and light l2 in sixteenths of a
        count.
    decay : int
        Decay of the light by the dye (k in second.py) in log2 units per um, Q24; at most 1000.
    off_um : int
        Distance of the reading's position from the first finger, in um.
    alone : int
        Light l1 of the first finger, in sixteenths of a count.
    brightness : int
        Brightness of the reading, in Q20 of log2.
    """
    away_um = off_um
    shift = alone >> 19 and 4
    share = 0
    for _ in range(4):
        if away_um + (1 << FAR_LOG2) >> FAR_LOG2 + 1:
            return False
        exponent = decay * away_um >> 4
        bend = exponent >> 10
        lost = min(((bend * bend >> 8) * (share * (256 - share) >> 8) >> 8) * 69, 1 << 20)
        light = power(brightness + lost) >> 6
        other = light - alone
        if other <= alone >> 3 or exponent >= 3 << 20:
            return False
        ratio = power(exponent) * ((alone >> shift << 10) // (other >> shift)) >> 10
        if ratio >> 13:
            return False
        share = 262144 // (1024 + ratio)  # Q8
        # Newton's step for away = off * (1 + ratio(away)).
        change = (off_um >> 2) * ratio >> 8
        slope = max(1024 - ((change >> 8) * (decay * 45) >> 12), 256)
        step_um = (off_um + change - away_um >> 2 << 10) // slope << 2
        away_um += step_um
        if not step_um + 64 >> 7:
            break
    found[0] = away_um
    found[1] = lost
    found[2] = ratio
    found[3] = other
    return True
