"""The frames of the functions that run for every sample: all on the stack of a real MicroPython."""

from conftest import Viper64


def test_no_pass_of_the_loop_takes_a_frame_from_the_heap(tmp_path):
    found = Viper64(tmp_path / "micropython").run("frames")
    assert found == ["False True"]  # nor would a deep call escape
