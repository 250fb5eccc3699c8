"""Keys under two fingers, through light, firmware and USB reports, on board and host."""

from pathlib import Path

import pytest
from support.boards import store
from support.computer import Computer
from support.hold_tap import SWITCHES, cases, log_of
from support.zmk import cases as zmk_cases
from support.zmk import played

from spots.keyboard.key_engine import KeyEngine
from spots.keyboard.keys import push
from spots.keyboard.layout import compiled
from spots.link.board import Board
from spots.link.frames import Touch
from spots_sim.board.lockstep import LockstepLink
from spots_sim.person.stage import calibrate
from spots_sim.strip.files import Finger, ScenarioFile
from spots_sim.strip.scenario import Scenario

pytestmark = pytest.mark.board

START_S = 3.0
BETWEEN_S = 0.9  # from the end of a case, when all is released, to the start of the next one
RAMP_S = 0.02
FORCE_MN = 1500
LONGEST_MS = 2000  # longer cases would take minutes
# A larger factor leaves more samples in each case, so it cannot fail where this one passes.
TIMES = 4


def fingers_of(case, times, start_s, length_mm):
    """Return the fingers of a case, and the time at which the last one has left."""
    fingers, down, end_s = [], {}, start_s
    for ms, is_press, switch in case.events:
        at_s = start_s + times * ms / 1000
        if is_press:
            down[switch] = at_s
            continue
        began_s, x_mm = down.pop(switch), length_mm * (switch + 0.5) / SWITCHES
        points = [(began_s, 0), (began_s + RAMP_S, FORCE_MN), (at_s, FORCE_MN), (at_s + RAMP_S, 0)]
        fingers.append(Finger(points=[(time_s, x_mm, force) for time_s, force in points]))
        end_s = max(end_s, at_s + RAMP_S)
    return fingers, end_s


def play(sensor, lines, folder, some, times, exposure_us):
    """Play cases one after the other; return the logs of board and host for each of them."""
    starts_s, fingers, now_s = [], [], START_S
    for case in some:
        starts_s.append(now_s)
        found, end_s = fingers_of(case, times, now_s, sensor.length_mm)
        fingers += found
        now_s = end_s + BETWEEN_S + times * case.after_ms / 1000
    store(folder, calibration=lines, settings=["keys=1", f"exposure_us={exposure_us}"])
    scenario = Scenario(ScenarioFile(seconds=now_s + 1, touch=fingers))
    logs = []
    with Board(LockstepLink(sensor, scenario, seed=1, folder=folder)) as board:
        board.command("hello")
        reports = board._link.usb.reports
        for i, case in enumerate(some):
            layout = compiled(Path(case.name), case.layout(times))
            push(board, layout)
            info = board.command("hello")
            computer = Computer()
            engine = KeyEngine(
                layout, info["length_um"], computer, info["decay"], cross=info["cross"]
            )
            board.command("stream touch")
            assert board.now_s() < starts_s[i]
            before = len(reports)
            end_s = (starts_s[i + 1] if i + 1 < len(some) else now_s) - BETWEEN_S / 2
            for frame in board.frames(end_s - board.now_s()):
                if isinstance(frame, Touch):
                    engine.take(frame, board.now_s())
            logs.append(
                (log_of([data for number, data in reports[before:] if number == 0]), computer.log)
            )
    return logs


def test_a_hold_tap_decides_under_fingers_as_keyboard_firmware_does(sensor, tmp_path):
    some = cases()[::2]
    logs = play(sensor, calibrate(sensor, 10_000), tmp_path, some, TIMES, 10_000)
    wrong = {
        case.name: (case.outcome, board, host)
        for case, (board, host) in zip(some, logs)
        if not board == host == case.outcome
    }
    assert not wrong


def test_keys_do_under_two_fingers_what_the_engine_does(sensor, tmp_path):
    some = [one for one in zmk_cases() if one.events[-1][0] < LONGEST_MS and one.fingers <= 2]
    assert len(some) > 50
    some = some[::3]  # tests/firmware/test_zmk.py plays all of them without light
    logs = play(sensor, calibrate(sensor, 10_000), tmp_path, some, 8, 10_000)
    wrong = {}
    for case, (board, host) in zip(some, logs):
        keyboard = played(case).keyboard
        if board != log_of(keyboard.reports) or host != keyboard.computer.log:
            wrong[case.name] = (keyboard.computer.log, board, host)
    assert not wrong
