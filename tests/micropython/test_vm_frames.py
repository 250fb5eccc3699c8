"""The frames of the functions that run for every sample: all on the stack of a real MicroPython."""


def test_no_pass_of_the_loop_takes_a_frame_from_the_heap(viper64):
    found = viper64.run("frames")
    assert found == ["False False True"]  # nor would a deep call escape
