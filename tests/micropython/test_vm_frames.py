"""The call frames of the functions that run for every sample are on the stack, not on the heap."""

import pytest

pytestmark = pytest.mark.board


def test_no_pass_of_the_loop_takes_a_frame_from_the_heap(viper64):
    found = viper64.run("frames")
    assert found == ["False False True"]  # True: a call that needs the heap is detected
