"""The calls of the loop do not nest deeper than the stack of an RP2040 allows.

MicroPython's stack there has 8 KB. In an emulated Pico, a call of a Python function takes 300 bytes
of it. Four calls come before the first one here.
"""

import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest
from support.random_layouts import random_fingers, random_layout

from spots.keyboard.keys import push
from spots.link.board import Board
from spots.link.connect import upload
from spots.link.frames import Key
from spots_sim.board.lockstep import LockstepLink
from spots_sim.person.stage import strip_lines
from spots_sim.strip.files import ScenarioFile, load
from spots_sim.strip.scenario import Scenario

pytestmark = pytest.mark.board

FIRMWARE = str(Path("spots_device"))
DEEPEST = 21
SECONDS = 15.0


class Depth:
    """The deepest nesting of the firmware's functions; a profiler of `sys.setprofile`."""

    def __init__(self):
        self.now = self.most = 0
        self.where = []

    def __call__(self, frame, event, _):
        if event not in ("call", "return") or FIRMWARE not in frame.f_code.co_filename:
            return
        self.now += 1 if event == "call" else -1
        if self.now > self.most:
            self.most, self.where = self.now, []
            while frame:
                if FIRMWARE in frame.f_code.co_filename:
                    self.where.append(frame.f_code.co_name)
                frame = frame.f_back


# With seed 13, an upload ends what is sticky.
@pytest.mark.parametrize(("seed", "strips"), [(0, 1), (1, 1), (2, 1), (0, 2), (13, 2)])
def test_no_key_needs_more_calls_than_the_stack_of_a_board_has_room_for(
    sensor, calibration, tmp_path, monkeypatch, seed, strips
):
    """Also if a command releases pressed keys; on two strips, it did so with more calls."""
    monkeypatch.setenv("SPOTS_VIRTUAL_RUNTIME", "cpython")
    rng = np.random.default_rng(seed)
    layout = random_layout(rng)
    seconds = SECONDS / strips
    fingers = random_fingers(rng, 1.0, seconds, sensor.length_mm)
    scenario = load(ScenarioFile, "demo")
    scenario = msgspec.structs.replace(scenario, touch=fingers, seconds=seconds + 1)
    second = {"second": (Scenario(scenario), seed + 1)} if strips == 2 else {}
    link = LockstepLink(sensor, Scenario(scenario), seed, tmp_path, **second)
    with Board(link) as board:
        made = [strip_lines(calibration, i) for i in board.sensors]
        for i in board.sensors:
            upload(board, made[i], i)
        push(board, layout)
        board.command("reboot")
        for _ in board.frames(0.5):
            pass
        of_strip = [f" sensor={i}" if second else "" for i in board.sensors]
        depth, down = Depth(), 0
        sys.setprofile(depth)
        try:
            for i in board.sensors:
                upload(board, made[i], i)
            board.stream("touch")
            for frame in board.frames(seconds):
                if isinstance(frame, Key) and frame.pressed:
                    down += 1
                    if down % 4 == 1:
                        board.command("set average=1" + of_strip[frame.sensor])
                    elif down % 4 == 3:
                        upload(board, made[frame.sensor], frame.sensor)
        finally:
            sys.setprofile(None)
    assert link.usb.reports
    assert down > 3
    assert depth.most <= DEEPEST, depth.where
