"""Random layouts while everything fails: no key stays down, hardly any is without a finger.

The board and the host decide the keys; the host gets only the frames that arrive undamaged.
``SPOTS_FIRE_MINUTES=1440`` runs a day of simulated time.
"""

import os

import msgspec
import numpy as np
import pytest
from support.random_layouts import random_fingers, random_layout

from spots.keyboard.key_engine import KeyEngine
from spots.keyboard.keys import push
from spots.keyboard.reach import causes
from spots.link.board import Board
from spots.link.connect import prepare
from spots.link.frames import Touch
from spots.link.timeouts import RELEASE_S
from spots.outputs.devices import Keyboard
from spots.outputs.usages import MODIFIERS_FROM
from spots_device.keys.layout import BEHAVIOUR, CAPS_WORD, KEY_REPEAT, STICKY
from spots_sim.board.faults import FaultyLink, of_scenario
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.files import ScenarioFile, load
from spots_sim.strip.scenario import Scenario

pytestmark = pytest.mark.board

MINUTES = int(os.environ.get("SPOTS_FIRE_MINUTES", "2"))
START_S, REST_S = 4.0, 3.0  # the last seconds of a minute are without fingers
MINUTE_S = 60.0
LATE_S = 0.06
# Largest share of presses without a finger: two fingers that come and go at once look like a third
# one.
NO_FINGER = 0.005
OFF_MM = 1.5  # a position may be wrong by this, and its key is then another one


class Log:
    """Presses and releases of single usages on one keyboard, with their times."""

    def __init__(self, now_s):
        self._now_s = now_s
        self.down = {}
        self.presses = []

    def take(self, now):
        """Take the set of usages (page, usage) that are down now."""
        for key in now - self.down.keys():
            self.down[key] = self._now_s()
            self.presses.append((self.down[key], key))
        for key in self.down.keys() - now:
            del self.down[key]


class Computer(Keyboard):
    """A keyboard of this computer that records what is down."""

    def __init__(self, log):
        super().__init__()
        self._log = log

    def _set(self, one, pressed):
        now = {(each.page, each.usage) for each in self._down}
        self._log.take(now if pressed else now - {(one.page, one.usage)})


def usages(action):
    """Return the usages that an action presses, with its modifiers."""
    kind, bits = action >> 20, action >> 12 & 0xFF
    if kind not in (7, 12):
        return set()
    return {(kind, action & 0xFFF)} | {(7, MODIFIERS_FROM + i) for i in range(8) if bits >> i & 1}


class Reach:
    """What fingers can press on any layer of a layout."""

    def __init__(self, layout, length_mm):
        self._layout = layout
        self._keys = [
            (key.low * length_mm, key.high * length_mm, self._caused(key.actions.values()))
            for keys in layout.layers.values()
            for key in keys
        ]
        self._swipes = self._caused(
            slot for name in layout.layers for slot in layout.swipes[name].values()
        )

    def usages(self, low_mm, high_mm):
        """Return the usages that a finger in a range of the strip can press."""
        near = (
            found
            for begin_mm, end_mm, found in self._keys
            if begin_mm - OFF_MM <= high_mm and low_mm < end_mm + OFF_MM
        )
        return self._swipes.union(*near)

    def _caused(self, slots):
        found = set()
        for slot in slots:
            for action in causes(slot, self._layout.behaviours):
                found |= usages(action)
                if action >> 20 == BEHAVIOUR:
                    found.add(self._layout.behaviours[action & 0xFFF].numbers[0])
        return found


def waits_for_ever(layout):
    """Return the usages of sticky keys that end only when another key is pressed."""
    sticky = [one.numbers for one in layout.behaviours if one.numbers[:2] == (STICKY, 0)]
    return set().union(*(usages(numbers[2]) for numbers in sticky))


@pytest.mark.parametrize("minute", range(MINUTES))
def test_no_key_stays_and_hardly_any_is_without_a_finger(
    minute, sensor, calibration, tmp_path, monkeypatch
):
    monkeypatch.setenv("SPOTS_VIRTUAL_RUNTIME", ("cpython", "micropython")[minute % 2])
    rng = np.random.default_rng(minute)
    layout = random_layout(rng)
    length_mm = sensor.length_mm
    fire = load(ScenarioFile, "fire")
    fingers = random_fingers(rng, START_S, MINUTE_S - REST_S, length_mm)
    file = msgspec.structs.replace(fire, touch=fingers, seconds=MINUTE_S + 1)
    faults = of_scenario(file, minute)
    link = LockstepLink(sensor, Scenario(file), minute, tmp_path, faults=faults)
    there = Log(link.now_s)
    reports = {0: set(), 1: set()}
    offer = link.usb.offer

    def watched(interface, report):
        offer(interface, report)
        if report and interface == 0:
            bits = {(7, MODIFIERS_FROM + i) for i in range(8) if report[0] >> i & 1}
            reports[0] = bits | {(7, usage) for usage in report[2:8] if usage}
        elif report:
            usage = report[0] | report[1] << 8
            reports[1] = {(12, usage)} if usage else set()
        there.take(reports[0] | reports[1])

    link.usb.offer = watched
    with Board(FaultyLink(link, faults)) as board:
        prepare(board, calibration)
        push(board, layout)
        board.command("stream off")
        board.command("reboot")  # the board becomes a USB keyboard at its start
        for _ in board.frames(1.0):
            pass
        prepare(board, calibration)
        here = Log(board.now_s)
        engine = KeyEngine(layout, round(1000 * length_mm), Computer(here))
        board.command("stream touch")
        while board.now_s() < MINUTE_S:
            for frame in board.frames(0.01):
                if isinstance(frame, Touch):
                    engine.take(frame, board.now_s())
            engine.tick(board.now_s())
    waiting = waits_for_ever(layout)
    assert not there.down.keys() - waiting
    assert not here.down.keys() - waiting
    for presses in (there.presses, here.presses):
        none = without_finger(presses, layout, fingers, length_mm)
        print(minute, len(presses), none)
        assert len(none) <= max(1, NO_FINGER * len(presses))
    assert len(there.presses) > 20


def places(fingers, time_s, late_s):
    """Yield the ranges in mm where fingers were, up to `late_s` before a time.

    While two fingers touch, a reading lies between them, and the tracker may be wrong.
    """
    near = [
        finger
        for finger in fingers
        if finger.points[0][0] - 0.005 <= time_s <= finger.points[-1][0] + late_s
    ]
    for one in near:
        for other in near:
            together = (
                one.points[0][0] <= other.points[-1][0] + LATE_S
                and other.points[0][0] <= one.points[-1][0] + LATE_S
            )
            if together:
                at_mm = [x_mm for finger in (one, other) for _, x_mm, _ in finger.points]
                yield min(at_mm), max(at_mm)


def without_finger(presses, layout, fingers, length_mm):
    """Return the presses that no finger can have caused, at most the longest time limit ago."""
    limits = dict(line.split()[:2] for line in layout.lines if len(line.split()) == 2)
    names = ("tapping_term_ms", "double_ms", "firm_ms", "swipe_ms")
    waits_s = max(int(limits[name]) for name in names) / 1000
    found, reach = [], Reach(layout, length_mm)
    has_caps_word = any(one.numbers[0] == CAPS_WORD for one in layout.behaviours)
    for time_s, key in presses:
        allowed = set()
        for low_mm, high_mm in places(fingers, time_s, RELEASE_S + LATE_S + waits_s):
            allowed |= reach.usages(low_mm, high_mm)
        if KEY_REPEAT in allowed:
            allowed |= {before for earlier_s, before in presses if earlier_s < time_s}
        if has_caps_word:
            allowed.add((7, MODIFIERS_FROM + 1))
        if key not in allowed:
            found.append((time_s, key))
    return found
