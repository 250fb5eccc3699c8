"""Integers of at most 31 bits, as on a 32-bit board, and a clock with such ticks.

A result of more than 31 bits raises an error; a board would allocate it on the heap.
"""

from __future__ import annotations

LOW, HIGH = -(1 << 30), (1 << 30) - 1
WRAP = 1 << 29  # period of the ticks in us, as on CircuitPython


class LeftSmallIntError(ArithmeticError):
    """Raised for a result that needs more than 31 bits."""


class SmallInt(int):
    """An int within 31 bits: each arithmetic result is a SmallInt, or raises an error."""

    def __new__(cls, value):
        value = int(value)
        if not LOW <= value <= HIGH:
            raise LeftSmallIntError(f"{value} needs more than 31 bits")
        return super().__new__(cls, value)


def _wrap(name):
    plain = getattr(int, name)

    def operate(self, *others):
        result = plain(self, *others)
        return result if result is NotImplemented else SmallInt(result)

    return operate


for _name in ("add", "sub", "mul", "floordiv", "mod", "lshift", "rshift", "and", "or", "xor"):
    setattr(SmallInt, f"__{_name}__", _wrap(f"__{_name}__"))
    setattr(SmallInt, f"__r{_name}__", _wrap(f"__r{_name}__"))
for _name in ("neg", "abs", "invert", "pos"):
    setattr(SmallInt, f"__{_name}__", _wrap(f"__{_name}__"))


def small(values):
    """Return integers as a list of `SmallInt`."""
    return [SmallInt(value) for value in values]


class SmallClock:
    """Clock with the functions of MicroPython's ``time``, whose ticks are `SmallInt`."""

    @staticmethod
    def ticks_add(ticks, delta):
        return SmallInt((int(ticks) + int(delta)) % WRAP)

    @staticmethod
    def ticks_diff(end, start):
        return SmallInt((int(end) - int(start) + WRAP // 2) % WRAP - WRAP // 2)
