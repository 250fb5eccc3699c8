"""Keys do what those of the keyboard firmware ZMK do in its own tests."""

from pathlib import Path

import pytest
from support.zmk import DIFFERS, cases, outcome_of, played, tables


@pytest.mark.parametrize("case", cases(), ids=lambda case: case.name)
def test_keys_do_what_those_of_zmk_do(case):
    bench = played(case)
    assert case.as_here(outcome_of(bench.events)) == case.as_here(case.outcome)
    bench.keyboard.text()  # board and host agree, and no key is down


def test_no_case_is_both_the_same_and_different():
    names = [case.name for case in cases()] + [name for one in DIFFERS for name in one["cases"]]
    assert len(names) == len(set(names)) > 100


def test_the_documented_tables_are_those_of_the_cases():
    page = (Path(__file__).parents[2] / "docs" / "evidence" / "zmk.md").read_text()
    for lines in tables():
        assert "\n".join(lines) in page
