"""The two builds of MicroPython have small integers of different sizes."""

import pytest

pytestmark = pytest.mark.board


def test_a_small_integer_is_one_bit_and_its_sign_short_of_a_word(machine, machine_bits):
    assert machine.run("words") == [str(machine_bits - 2)]
