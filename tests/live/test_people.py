"""Ten people type on the page `live`: it types what the same fingers type on a virtual board."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest
from msgspec.structs import replace

from spots.keyboard.layout import load as load_layout
from spots_sim.demo.demo import open_fast
from spots_sim.demo.demo_applications import type_on_board
from spots_sim.person.typist import TypedText, fast_typing
from spots_sim.strip.files import Finger, ScenarioFile
from spots_sim.strip.scenario import Scenario

pytestmark = pytest.mark.board
# More than a run of all tests can pay for: SPOTS_LIVE_PEOPLE=10 SPOTS_LIVE_TOUCHES=100.
PEOPLE = int(os.environ.get("SPOTS_LIVE_PEOPLE", "1"))
TOUCHES = int(os.environ.get("SPOTS_LIVE_TOUCHES", "30"))
LENGTH_MM, FULL_MN = 85.0, 8000.0
RISE_S, LIFT_S = 0.012, 0.015  # of the fingers of the page, see hand.js


def taps(person: int) -> ScenarioFile:
    """Return a person's taps, with the forces over time that the page gives to its fingers."""
    file = fast_typing(load_layout("digits"), None, TOUCHES, LENGTH_MM, seed=person)
    fingers = []
    for one in file.touch:
        (down_s, x_mm, _), _, (up_s, _, force_mN), _ = one.points
        full_s = down_s + RISE_S
        up_s = max(up_s, full_s + 0.001)
        times = (down_s, 0.0), (full_s, force_mN), (up_s, force_mN), (up_s + LIFT_S, 0.0)
        fingers.append(Finger(points=[(time_s, x_mm, force) for time_s, force in times]))
    return replace(file, touch=fingers)


def events(file: ScenarioFile) -> list[dict]:
    """Return the events of pointers that press like the fingers of a scenario, in their order."""
    found = []
    for number, finger in enumerate(file.touch):
        (down_s, x_mm, _), (_, _, force_mN), (up_s, *_), _ = finger.points
        event = {"id": number, "xMm": x_mm, "pressure": force_mN / FULL_MN}
        found.append({**event, "down": True, "atMs": 1000 * down_s})
        found.append({**event, "down": False, "atMs": 1000 * up_s})
    return sorted(found, key=lambda event: event["atMs"])


def on_a_virtual_board(file: ScenarioFile, seed: int) -> dict:
    """Return what `type_on_board` returns for these fingers."""
    truth = Scenario(file)
    board, _ = open_fast("default", truth, seed)
    with board:
        return type_on_board(board, truth, 0.0, file.seconds - board.now_s(), True, "digits")


@pytest.mark.parametrize("person", range(PEOPLE))
def test_the_page_types_what_the_virtual_board_types(node, live, monkeypatch, person):
    # Fails if force, contact, light or time of the page's fingers differ from the simulator's.
    monkeypatch.setenv("SPOTS_VIRTUAL_RUNTIME", "cpython")
    file = taps(person)
    given = {"page": str(live), "events": events(file), "seconds": file.seconds}
    script = Path(__file__).with_name("fingers.mjs")
    run = subprocess.run(
        [node, script], input=json.dumps(given), capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr[-2000:]
    shown = TypedText()
    for key in json.loads(run.stdout):
        shown.key(key["page"], key["usage"], key["modifiers"], key["pressed"])
    assert len(shown.text) > 0.9 * TOUCHES
    assert shown.text == on_a_virtual_board(file, person)["typed"]
