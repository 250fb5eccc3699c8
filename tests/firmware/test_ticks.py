"""The ticks of the clock on CircuitPython are small integers, also on a 32-bit board."""

import ast
from pathlib import Path
from types import SimpleNamespace

import pytest
from smallint import SmallInt

import spots_device.runtime

SOURCE = Path(spots_device.runtime.__file__).parent / "circuitpython.py"


def clock_at(us):
    """Return the class `MonotonicClock` of the firmware for CircuitPython, at a time in us.

    The class is executed from the source, because its module can be imported only on a board.
    """
    body = [
        node
        for node in ast.parse(SOURCE.read_text()).body
        if (isinstance(node, ast.Assign) and "PERIOD_US" in ast.unparse(node))
        or (isinstance(node, ast.ClassDef) and node.name == "MonotonicClock")
    ]
    time = SimpleNamespace(monotonic_ns=lambda: 1000 * us)
    names = {"const": int, "time": time}
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
