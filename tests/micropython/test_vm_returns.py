"""A lost sensor that answers again: the loop then continues without garbage on the heap.

Each allocation searches the heap for a free block. So garbage slows the loop down until the next
command, which collects garbage.
"""

import pytest
from bench.firmware import for_canned_board

pytestmark = pytest.mark.board

GARBAGE_MAX_BYTES = 2_000


def test_the_loop_goes_on_without_garbage_of_the_return(machine, calibration):
    lines = machine.run("returns", {"calibration": for_canned_board(calibration)})
    garbage_bytes = [int(line) for line in lines]
    assert len(garbage_bytes) == 3
    assert max(garbage_bytes) < GARBAGE_MAX_BYTES, garbage_bytes
