"""Base-2 logarithm of an integer in Q20, computed with a table and integers only.

The table has 512 steps of the mantissa, with linear interpolation between two entries. The chord
between two entries lies below the concave curve. So each entry is raised by half the chord's
largest error, which halves the error. The largest error is one unit of Q20 (9.5e-7), over all
arguments from 1 to 2**24.
"""

from array import array

Q = 20
ONE = 1 << Q
# Largest argument: 64 averaged samples of 16 bits, multiplied by 4.
LIMIT = 1 << 24

_STEPS_LOG2 = 9
_STEPS = 1 << _STEPS_LOG2
GUARD = 4  # additional fraction bits of the table, whose values are in Q24


def _table():
    def exact_q24(step):
        # Computes one bit at a time: squaring the mantissa doubles its logarithm. The products
        # have 62 bits, so the function allocates on a board; it runs once, at import.
        mantissa = (_STEPS + step) << (30 - _STEPS_LOG2)
        bits = 0
        for _ in range(Q + GUARD + 1):
            mantissa = (mantissa * mantissa) >> 30
            bits <<= 1
            if mantissa >> 31:
                mantissa >>= 1
                bits |= 1
        return (bits + 1) >> 1

    table = array("i", bytes(4 * (_STEPS + 1)))
    for step in range(_STEPS):
        # Half of h**2 / (8 ln 2 m**2) in Q24, with h = 1/512, m = 1 + step/512.
        half_chord_error = 1512537 // (_STEPS + step) ** 2
        table[step] = exact_q24(step) + half_chord_error
    table[_STEPS] = (ONE << GUARD) + 1512537 // (2 * _STEPS) ** 2
    return table


TABLE = _table()
del _table  # frees memory on a board


def log2_q20(n):
    """Return log2(n) in Q20, with an error of at most one unit; 24.0 for n above 2**24.

    The least n is 1. Allocates nothing; every intermediate result fits 31 bits.
    """
    if n >= LIMIT:
        return 24 << Q
    exponent = 23
    if n < 1 << 8:
        n <<= 16
        exponent -= 16
    if n < 1 << 16:
        n <<= 8
        exponent -= 8
    if n < 1 << 20:
        n <<= 4
        exponent -= 4
    if n < 1 << 22:
        n <<= 2
        exponent -= 2
    if n < 1 << 23:
        n <<= 1
        exponent -= 1
    step = (n >> 14) & 511
    table = TABLE
    low = table[step]
    fraction = low + (((n & 16383) * (table[step + 1] - low)) >> 14)
    return (exponent << Q) + ((fraction + 8) >> GUARD)
