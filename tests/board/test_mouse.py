"""Mouse and system keys of a board, from the light to the USB reports."""

import struct
import sys
from pathlib import Path

import msgspec
import pytest

from spots.keyboard.keys import names, push
from spots.keyboard.layout import compiled
from spots.link.board import Board
from spots.link.connect import prepare
from spots.outputs import usages
from spots_device.keys import layout as kinds
from spots_device.usb.descriptors import MOUSE_SIZE
from spots_device.usb.usages import NOTCH
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.files import Finger, ScenarioFile, load
from spots_sim.strip.scenario import Scenario

SECONDS = 6.0
TURNS = """
name = "wheel"
[[layer]]
name = "base"
keys = [{tap = "A", slide_minus = "WHEEL_UP", slide_plus = "WHEEL_DOWN"}]
"""
NOTCH_UM = kinds.LIMITS["slide_um"][2]
SLIDE_MM = 20


def play(sensor, calibration, folder, layout, fingers, exposure_us=10_000, multipliers=0):
    """Return the reports that a board sends while fingers touch its strip."""
    file = load(ScenarioFile, "demo")
    file = msgspec.structs.replace(file, touch=fingers, seconds=SECONDS + 1)
    link = LockstepLink(sensor, Scenario(file), 1, folder)
    with Board(link) as board:
        prepare(board, calibration)
        board.command(f"set exposure_us={exposure_us}")
        push(board, compiled(Path("wheel"), layout))
        board.command("reboot")
        for _ in board.frames(0.5):
            pass
        for name, module in list(sys.modules.items()):
            if name.endswith(".usb.mouse"):  # of the board in this process
                module.set_multipliers(multipliers)
        while board.now_s() < SECONDS:
            for _ in board.frames(0.1):
                pass
    return [report for _, report in link.usb.reports]


@pytest.fixture(autouse=True)
def cpython(monkeypatch):
    monkeypatch.setenv("SPOTS_VIRTUAL_RUNTIME", "cpython")


def wheel(reports):
    """Return how far the vertical wheel has turned."""
    return sum(struct.unpack("<Bbbhh", one)[3] for one in reports if len(one) == MOUSE_SIZE)


def test_the_kinds_are_those_of_the_firmware():
    assert (usages.SYSTEM, usages.MOUSE, usages.WHEEL) == (kinds.SYSTEM, kinds.MOUSE, kinds.WHEEL)


END_MM = 20 + SLIDE_MM
SLIDE = Finger(points=[(2.0, 20, 2e3), (2.3, 20, 2e3), (3.3, END_MM, 2e3), (3.6, END_MM, 2e3)])
NOTCHES = SLIDE_MM * 1000 // NOTCH_UM


@pytest.mark.board
@pytest.mark.parametrize("exposure_us", [5_000, 10_000])
def test_a_slide_turns_the_wheel_smoothly_by_its_length(sensor, calibration, tmp_path, exposure_us):
    reports = play(sensor, calibration, tmp_path, TURNS, [SLIDE], exposure_us, multipliers=0b0101)
    # The slide is measured from the first reading, which may have only a part of the light.
    assert wheel(reports) == pytest.approx(-NOTCHES * NOTCH, rel=0.06)
    assert len(reports) > 50


@pytest.mark.board
def test_a_slide_turns_whole_notches_for_a_host_that_knows_no_others(sensor, calibration, tmp_path):
    reports = play(sensor, calibration, tmp_path, TURNS, [SLIDE])
    assert wheel(reports) in (-NOTCHES, 1 - NOTCHES)
    assert len(reports) <= 2 * NOTCHES


def test_names_of_what_only_a_board_presses_are_found():
    assert names("wheel") == ["WHEEL_UP", "WHEEL_DOWN", "WHEEL_LEFT", "WHEEL_RIGHT"]
    assert "SYSTEM_SLEEP" in names("sleep")
