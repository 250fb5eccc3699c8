"""A five-bar linkage whose two strips are on one board."""

from __future__ import annotations

import math
import threading
from contextlib import nullcontext
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from support.joints import JOINT
from support.joints import touch as reading
from support.refusals import refusal

from spots.calibrate import calibration_file as file
from spots.errors import CalibrationError, SettingError
from spots.keyboard import layout
from spots.link.board import Board
from spots_linkage import Encoder, Linkage, Twin, mounted, panel, twin_source
from spots_linkage.mounted import Mounted, Mounting
from spots_sim.board.lockstep import LockstepLink
from spots_sim.measure.simulated_linkage import START_S, calibrated, moved
from spots_sim.person.mechanism import Mechanism, guided
from spots_sim.strip.files import LinkageFile, PathFile, load
from spots_web.panel_feed import readers_of, shower
from spots_web.state import PageState

EXPOSURE_US = 30_000


@pytest.fixture(scope="module")
def arm(sensor, tmp_path_factory):
    """Linkage file, motion of a five-bar linkage, and a function that opens its board.

    The board has two strips: the first joint turns strip 1, the second joint turns strip 0.
    """
    folder = tmp_path_factory.mktemp("arm")
    strip = calibrated(sensor, 0, EXPOSURE_US)
    file.save(strip, folder / "strip0.toml", None)
    file.save(moved(strip, 1), folder / "strip1.toml", None)
    mechanism = Mechanism(load(LinkageFile, "default"), sensor)
    motion = guided(load(PathFile, "sust"), START_S)
    second, first = mechanism.drive(motion)  # joint 1 turns strip 1
    path = folder / "arm.toml"
    joints = [
        Mounting(calibration=f"strip{1 - joint}.toml", offset_deg=math.degrees(zero))
        for joint, zero in enumerate(mechanism.zero_rad)
    ]
    mounted.save(
        Mounted(bar_mm=mechanism.bar_mm, base_mm=mechanism.base_mm, joint=joints), path, None
    )

    def open_board(port):
        return Board(LockstepLink(sensor, first, 0, second=(second, 1)))

    return path, motion, open_board


@pytest.mark.board
def test_one_port_is_enough_for_both_strips_and_so_is_one_recording(arm, monkeypatch, tmp_path):
    path, motion, open_board = arm
    monkeypatch.setattr(twin_source, "open", open_board)
    record = tmp_path / "both.spots"
    with twin_source.opened(path, ["here"], [record]) as source:
        assert source.boards[0] is source.boards[1]
        assert source.sensors == (1, 0)
        live = list(source.follow(4.0))
    time_s, x_mm, y_mm = np.array([(t.time_s, t.x_mm, t.y_mm) for t in live]).T
    true_x, true_y = motion.at(time_s)
    assert len(live) > 200
    assert np.hypot(x_mm - true_x, y_mm - true_y)[time_s > START_S].max() < 0.5
    with twin_source.opened(path, [f"recording:{record}"]) as source:
        assert list(source.follow()) == live


def test_two_joints_with_the_calibration_of_one_strip_are_refused(arm, monkeypatch, tmp_path):
    path, _, open_board = arm
    monkeypatch.setattr(twin_source, "open", open_board)
    found = mounted.load(path)
    one = path.with_name("one.toml")
    mounted.save(msgspec.structs.replace(found, joint=[found.joint[0]] * 2), one, None)
    with (
        refusal(CalibrationError),
        twin_source.opened(one, ["here"]),
    ):
        pass


def test_a_reading_of_a_third_sensor_is_refused_in_one_sentence():
    twin = Twin(Linkage((100, 45, 45, 100), 80), (Encoder(JOINT), Encoder(JOINT)))
    with refusal(SettingError):
        twin.take(2, reading(0.0, 10_000))


class Shown(PageState):
    """A `PageState` that records that a position of the end point was shown."""

    def __init__(self):
        super().__init__()
        self.position = threading.Event()

    def put(self, name, value):
        super().put(name, value)
        if name == "panel-twin" and value["x_mm"] is not None:
            self.position.set()


def test_the_web_ui_follows_both_joints_of_one_board(arm, monkeypatch):
    path, _, open_board = arm
    monkeypatch.setattr(panel, "finder", lambda port: lambda board_id: open_board(port))
    state = Shown()
    sources = panel.linkage_sources(str(path), ["here"], shower(state, "twin"))
    (reader,) = readers_of(sources, layout.load("digits"), state)
    reader.start()
    try:
        assert state.position.wait(60)
    finally:
        reader.stop(60)


def test_each_of_two_boards_is_found_by_its_id_and_only_the_strip_of_its_joint_counts(monkeypatch):
    strips = SimpleNamespace(board="a"), SimpleNamespace(board="b-1")
    searched, taken = [], []

    def search(board_id):
        searched.append(board_id)
        return nullcontext(board_id)

    replaced = {
        "loaded": lambda linkage, ports: (None, strips),
        "finder": lambda port: search,
        "give": lambda board, strip, number: strips.index(strip),
        "TwinFeed": lambda twin, show: SimpleNamespace(
            take=lambda *pair: taken.append(pair), lost=print
        ),
    }
    for name, substitute in replaced.items():
        monkeypatch.setattr(panel, name, substitute)
    for open_board, on_touch, _ in panel.linkage_sources("arm.toml", [], print):
        open_board(None)
        for sensor in (0, 1):
            on_touch(reading(10_000)._replace(sensor=sensor))
    assert searched == ["a", "b"]
    assert [(joint, touch.sensor) for joint, touch in taken] == [(0, 0), (1, 1)]
