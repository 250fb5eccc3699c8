"""Uploads with keys on: a board imports the parsers for each upload, and then drops them."""

import json

import pytest
from bench.firmware import for_canned_board

from spots.keyboard.layout import load

pytestmark = pytest.mark.board

NOTES = [{"note": "this board has no USB keyboard; keys are sent as frames only"}] * 2
PARSERS = {"spots_device.reading.calibration_lines", "spots_device.keys.layout"}


@pytest.fixture
def rounds(viper64, calibration):
    """What the script prints; `viper64` has no module-level names of constants, as a board."""
    given = {"calibration": for_canned_board(calibration), "layout": list(load("mini").lines)}
    return [json.loads(line) for line in viper64.run("uploads", given)]


def test_uploads_succeed_with_keys_on_also_after_one_without_memory(rounds):
    *uploads, (errors, same), (notes, modules) = rounds
    assert [notes for _, notes in uploads] == [NOTES] * len(uploads)
    assert errors == [True, True]
    assert same
    assert notes == NOTES
    assert "spots_device.keys.engine" in modules
    assert not PARSERS & set(modules)


def test_uploads_leave_nothing_on_the_heap(rounds):
    _, *later, _, _ = rounds
    assert len({used for used, _ in later}) == 1
