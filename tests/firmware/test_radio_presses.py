"""Which presses let a host bond: three, firm, long, and close together."""

from types import SimpleNamespace

import pytest

from spots_device.radio.presses import Presses

FIRM, LIGHT, NONE = 3_000, 1_000, 0
HELD = [(FIRM, 2.1), (NONE, 0.5)]


def made(parts):
    """Return how often presses are complete; `parts` has force in mN and duration in s."""
    now = [0]
    clock = SimpleNamespace(ticks_us=lambda: now[0], ticks_diff=int.__sub__)
    presses, count = Presses(clock), 0
    for force_mN, seconds in parts:
        for _ in range(round(seconds * 100)):
            count += presses.are_made(force_mN)
            now[0] += 10_000
    return count


@pytest.mark.parametrize(("parts", "count"), [
    (3 * HELD, 1),
    (6 * HELD, 2),
    (2 * HELD, 0),
    (3 * [(LIGHT, 2.1), (NONE, 0.5)], 0),
    (3 * [(FIRM, 1.9), (NONE, 0.5)], 0),
    (2 * HELD + [(FIRM, 1.0), (NONE, 0.5)] + HELD, 0),  # a short press in between
    (2 * HELD + [(NONE, 3.0)] + HELD, 0),  # too late
    (3 * [(FIRM, 1.0), (LIGHT, 0.2), (FIRM, 1.0), (NONE, 0.5)], 1),  # a finger trembles
    ([(FIRM, 20.0), (NONE, 0.5)], 0),  # a strip that lies under something
])  # fmt: skip
def test_presses(parts, count):
    assert made(parts) == count
