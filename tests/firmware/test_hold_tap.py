"""Hold-tap keys of the engine decide as those of keyboard firmware do."""

from pathlib import Path

import pytest
from support.engine_bench import Bench
from support.hold_tap import SWITCHES, cases

from spots.keyboard.layout import compiled


@pytest.mark.parametrize("case", cases(), ids=lambda case: case.name)
def test_a_hold_tap_decides_as_keyboard_firmware_does(case):
    bench = Bench(compiled(Path("case"), case.layout(1)).lines)
    for ms, is_press, switch in case.events:
        bench.at(ms)
        if is_press:
            bench.press(switch, (switch + 0.5) / SWITCHES)
        else:
            bench.release(switch)
    bench.at(case.events[-1][0] + 1000)
    assert bench.keyboard.computer.log == case.outcome
