"""Keys and game controller during all kinds of faults: no press without a finger, no stuck key.

Two key engines run in parallel: that of the board, which sends USB reports, and that of the host,
which gets only the frames that arrive undamaged.
"""

import numpy as np
import pytest

from spots.controller.controller_settings import load as load_settings
from spots.controller.gamepad_engine import Controller
from spots.keyboard.key_engine import KeyEngine
from spots.keyboard.keys import push
from spots.keyboard.layout import load as load_layout
from spots.link.board import Board
from spots.link.connect import prepare
from spots.link.frames import Touch
from spots.link.timeouts import RELEASE_S
from spots_sim.board.faults import FaultyLink, of_scenario
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.files import ScenarioFile, load
from spots_sim.strip.scenario import Scenario

SECONDS = 60.0
DIGITS = list(range(30, 40))
LENGTH_UM = 85_000
SEEN_S = 0.1  # longer touches must cause a key press
LATE_S = 0.06


class Timed:
    """A keyboard that records key events with their times."""

    def __init__(self, now_s):
        self._now_s = now_s
        self.events = []

    def key(self, page, usage, modifiers, pressed):
        self.events.append((self._now_s(), usage, pressed))


class Run:
    """One minute of the scenario `fire` on a virtual board; records all key events and states."""

    def __init__(self, sensor, calibration, seed, folder):
        file = load(ScenarioFile, "fire")
        self.touches = file.touch
        self.truth = Scenario(file)
        faults = of_scenario(file, seed)
        link = LockstepLink(sensor, self.truth, seed, folder, faults=faults)
        self.reports = []
        self._watch_usb(link)
        with Board(FaultyLink(link, faults)) as board:
            prepare(board, calibration)
            push(board, load_layout("digits"))
            board.command("stream off")  # without this command, `frames` would start all streams
            board.command("reboot")  # the board becomes a USB keyboard at its start
            for _ in board.frames(1.0):
                pass
            prepare(board, calibration)
            self.ready_s = board.now_s()
            self.host = Timed(board.now_s)
            engine = KeyEngine(
                load_layout("digits"), LENGTH_UM, self.host, board.command("hello")["decay"]
            )
            settings = load_settings()
            controller = Controller(settings, LENGTH_UM)
            self.states = []
            board.command("stream touch")
            while board.now_s() < SECONDS:
                for frame in board.frames(0.01):
                    if isinstance(frame, Touch):
                        engine.take(frame, board.now_s())
                        self._keep(board, controller.take(frame, board.now_s()))
                engine.tick(board.now_s())
                self._keep(board, controller.tick(board.now_s()))
            self.stats = board.stats
            engine.release()
        self.ledger = faults.ledger

    def _keep(self, board, state):
        if state is not None:
            self.states.append((board.now_s(), state))

    def _watch_usb(self, link):
        offer = link.usb.offer

        def watched(interface, report):
            offer(interface, report)
            if report and interface == 0:
                self.reports.append((link.now_s(), report[2]))

        link.usb.offer = watched


@pytest.fixture(scope="module", params=[1])
def run(request, sensor, calibration, tmp_path_factory):
    return Run(sensor, calibration, request.param, tmp_path_factory.mktemp("fire"))


def under(run, now_s):
    """Return the keys (characters) that fingers touch at `now_s` or up to `LATE_S` before it."""
    moments = np.arange(now_s - LATE_S, now_s + 0.005, 0.005)
    found = set()
    for moment in moments:
        for press in run.truth.presses(moment):
            for off_mm in (-0.6, 0.6):
                share = (press.position_mm + off_mm) * 1000 / LENGTH_UM
                found.add(DIGITS[min(max(int(10 * share), 0), 9)])
    return found


@pytest.mark.board
def test_the_minute_was_one_of_fire(run):
    assert run.stats.bad_crc > 20
    assert run.stats.restarts >= 1
    print(run.ledger)


@pytest.mark.board
def test_no_key_that_no_finger_pressed_and_none_stays(run):
    down = {}
    for now_s, usage, pressed in run.host.events:
        if pressed:
            assert usage in under(run, now_s), (now_s, usage)
            down[usage] = now_s
        else:
            began_s = down.pop(usage)
            ends_s = [touch.points[-1][0] for touch in run.touches if touch.points[0][0] <= began_s]
            assert now_s - ends_s[-1] < RELEASE_S + LATE_S, (began_s, now_s)
    assert not down


def test_nor_has_the_boards_own_keyboard(run):
    held = 0
    for now_s, usage in run.reports:
        if usage and not held:
            assert usage in under(run, now_s), (now_s, usage)
        held = usage
    assert held == 0


def seen(events_s, touch):
    began_s, ended_s = touch.points[0][0], touch.points[-1][0]
    return any(began_s - 0.005 <= now_s <= ended_s + LATE_S for now_s in events_s)


def test_every_press_is_seen_on_the_host_and_on_the_board(run):
    """Each touch is longer than the longest burst of damage, and not completely in a brown-out."""
    presses_s = [now_s for now_s, _, pressed in run.host.events if pressed]
    reports_s = [now_s for now_s, usage in run.reports if usage]
    played = [
        touch
        for touch in run.touches
        if touch.points[0][0] > run.ready_s and touch.points[-1][0] < SECONDS - 0.5
    ]
    for touch in played:
        assert touch.points[-1][0] - touch.points[0][0] > SEEN_S
        assert seen(presses_s, touch), touch
        assert seen(reports_s, touch), touch
    print(f"{len(played)} presses longer than {SEEN_S} s, all of them seen")
    assert len(played) > 25


def test_the_controller_goes_only_where_a_finger_was_or_to_rest(run):
    settings = load_settings()
    hold_s = settings.hold_ms / 1000
    for now_s, state in run.states:
        if state.x == 0 and state.z == 0:
            continue
        places = []
        for moment in np.arange(now_s - hold_s - 0.1, now_s + 0.005, 0.005):
            places += [press.position_mm for press in run.truth.presses(moment)]
        assert places, (now_s, state)
