"""Any two actions at the same time type what each of them means: engine, board and host."""

import numpy as np
import pytest
from support.engine_bench import Bench, Keyboard
from support.pairs import ACTIONS, some

from spots.outputs.usages import chord_of
from spots_device.keys.layout import FULL, action

pytestmark = pytest.mark.board

PAIRS = 10_000  # half of them on one strip, half on two
_AT = {name: (i + 0.5) / len(ACTIONS) for i, name in enumerate(ACTIONS)}


def lines():
    bounds = [round(FULL * i / len(ACTIONS)) for i in range(len(ACTIONS) + 1)]
    numbers = [action(*chord_of(name)) for name in ACTIONS]
    return ["layer 0 0"] + [
        f"key {low} {high} {number} 0 0 0 0 0"
        for low, high, number in zip(bounds, bounds[1:], numbers)
    ]


@pytest.mark.parametrize("strips", [1, 2])
def test_any_two_actions_type_what_each_of_them_means(strips):
    rng = np.random.default_rng(strips)
    layout, wrong = lines(), []
    for pair in some(rng, PAIRS // 2):
        keyboard = Keyboard()
        benches = [Bench(layout, keyboard) for _ in range(strips)]
        now_ms = 0
        for is_press, name in pair.events:
            now_ms += int(rng.integers(5, 60))
            for bench in benches:
                bench.at(now_ms)
            bench = benches[(name == "b") % strips]
            if is_press:
                bench.press(name, _AT[getattr(pair, name)])
            else:
                bench.release(name)
        for bench in benches:
            bench.at(now_ms + 50)
        if keyboard.text() != pair.text():
            wrong.append((pair, keyboard.computer.text, pair.text()))
        for bench in benches:
            presses = [event[-1] for event in bench.events]
            assert presses.count(True) == presses.count(False)
    assert not wrong
