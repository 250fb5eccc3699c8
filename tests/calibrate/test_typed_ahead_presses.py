"""Answers that a session refuses: the question is asked again, with the reason."""

import pytest

from spots.calibrate.fit.points import Wanted
from spots.calibrate.session.presser import Presser


class Script:
    """A dialog that gives the answers of a list, and records what is said."""

    def __init__(self, *answers):
        self.answers, self.said = list(answers), []

    def ask(self, question):
        return self.answers.pop(0)

    def say(self, text):
        self.said.append(text)


def test_the_second_force_of_a_press_is_no_position():
    script = Script("42mm 2N", "43mm", "43mm 800g", "800g")
    wanted = Wanted(kind="hand", place_um=40_000.0, force_mN=2000.0, then_mN=9000.0)
    read = Presser(script).read_off(wanted, 85_000.0)
    assert (read.place_um, read.force_mN) == (42_000.0, 2000.0)
    assert read.then_mN == pytest.approx(7845.3, abs=0.1)
    assert script.said == [
        "'43mm' has a position: type only the force",
        "'43mm 800g' has a position: type only the force",
    ]


def test_a_force_in_newtons_has_no_separator_of_thousands():
    wanted = Wanted(kind="force", place_um=76_000.0, force_mN=10_000.0)
    script = Script("1,200", "1_0", "nan", "1e1", "700", "0,35")
    assert Presser(script).least_mN(wanted, None) == 350.0
    assert script.said[0] == "'1,200' can be 1200 or 1.2: type a number from 0.01 to 6"
    assert len(script.said) == 5


def test_an_angle_may_be_negative_and_have_a_decimal_comma():
    turned = Presser(Script("x", "-12,5")).turn(1, 0.5)
    assert turned.angle_deg == -12.5
