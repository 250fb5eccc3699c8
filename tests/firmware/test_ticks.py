"""The clock of CircuitPython: small integers only on a board of 32 bits, and little garbage."""

import ast
from pathlib import Path
from types import SimpleNamespace

import pytest
from smallint import SmallInt

import spots_device.runtime

SOURCE = Path(spots_device.runtime.__file__).parent / "circuitpython.py"
PERIOD_US = 1 << 29


class LongInt(int):
    """A long integer. Each operation with it would allocate memory on a board."""

    def _allocate(self, *others):
        raise AssertionError("an operation with a long integer allocates memory")

    __floordiv__ = __mod__ = __sub__ = __add__ = __rshift__ = __and__ = __divmod__ = _allocate


def pack_into(form, digits, at, number):
    assert (form, at) == ("<Q", 0)
    digits[:] = [SmallInt(int(number) >> 16 * i & 0xFFFF) for i in range(4)]


def clock_at(us, ns=0):
    """Return CircuitPython's clock at a time in us plus ns; its module runs on a board only."""
    wanted = "PERIOD_US", "_HIGH =", "_ns ="
    body = [
        node
        for node in ast.parse(SOURCE.read_text()).body
        if (isinstance(node, ast.Assign) and any(name in ast.unparse(node) for name in wanted))
        or (isinstance(node, ast.ClassDef) and node.name == "MonotonicClock")
    ]
    time = SimpleNamespace(monotonic_ns=lambda: LongInt(1000 * us + ns))
    names = {"const": int, "time": time, "pack_into": pack_into, "array": lambda kind, data: []}
    exec(compile(ast.Module(body, []), str(SOURCE), "exec"), names)
    return names["MonotonicClock"]


@pytest.mark.parametrize("us", [0, 1, (1 << 28) - 1, (1 << 29) - 1, (1 << 30) - 1, 1 << 40])
@pytest.mark.parametrize("later_us", [-(1 << 28), -1, 0, 1, (1 << 28) - 1])
def test_ticks_and_their_differences_are_small_integers(us, later_us):
    clock = clock_at(us)
    ticks = SmallInt(clock.ticks_us())
    later = clock.ticks_add(ticks, SmallInt(later_us))
    assert clock.ticks_diff(later, ticks) == later_us
    assert clock.ticks_diff(ticks, ticks) == 0


@pytest.mark.parametrize("us", [0, 65_535, 65_536, 4_294_967, 4_294_968, 1 << 29, 10**12, 10**15])
@pytest.mark.parametrize("ns", [0, 1, 999])
def test_ticks_are_the_time_in_us(us, ns):
    assert clock_at(us, ns).ticks_us() == us % PERIOD_US
