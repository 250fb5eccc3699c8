"""LeRobot itself reads our datasets, and drives our teleoperator; run by ``make labs``."""

from __future__ import annotations

import numpy as np
import pytest
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.teleoperators import make_teleoperator_from_config
from lerobot_teleoperator_spots import SpotsTeleoperator, SpotsTeleoperatorConfig
from lerobot_teleoperator_spots.mapping import REST, Mapping

import spots
from spots.recording.export import export


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("lab") / "run.spots"
    with spots.open("virtual") as board, spots.Recorder(board, path):
        board.stream("touch", "spectrum")
        for text in ("tap", "slide"):
            board.mark(text)
            for _ in board.frames(3):
                pass
    return path


def test_lerobot_reads_a_dataset(recorded, tmp_path):
    out = tmp_path / "data"
    export(recorded, "lerobot", out)
    data = LeRobotDataset("spots/run", root=out)
    assert data.num_episodes == 2
    assert data.fps == 100
    first = data[0]
    assert first["task"] == "tap"
    assert first["action"].shape == (3,)
    assert first["observation.tactile"].shape == (6,)
    last = data[len(data) - 1]
    assert last["task"] == "slide"
    touches = spots.read_dataframe(recorded)
    forces = np.array([data[i]["observation.state"][1] for i in range(0, len(data), 5)])
    assert forces.max() <= touches.force_mN.max() / 1000 + 1e-6
    assert forces.max() > 0.5


def test_lerobot_makes_and_drives_the_teleoperator():
    teleop = make_teleoperator_from_config(SpotsTeleoperatorConfig(port="virtual"))
    assert isinstance(teleop, SpotsTeleoperator)
    assert [*teleop.action_features] == ["position", "force", "gripper"]
    teleop.connect()
    try:
        assert teleop.is_connected
        actions = []
        while len(actions) < 100_000 and not (actions and actions[-1]["gripper"] > 0.3):
            actions.append(teleop.get_action())
        assert actions[-1]["force"] > 1
        assert 0 < actions[-1]["position"] < 1
        assert len(teleop.tactile()) == 6
    finally:
        teleop.disconnect()
    assert not teleop.is_connected


def test_what_is_untrusted_repeats_the_last_action():
    mapping = Mapping(100_000)
    touch = spots.Touch(0, 0, 0, 9, 0, 0, 25_000, 2750)
    action = mapping.action(touch, REST)
    assert action == {"position": 0.25, "force": 2.75, "gripper": 0.5}
    assert mapping.action(touch._replace(flags=9 | 16), action) == action
    lifted = {"position": 0.25, "force": 0.0, "gripper": 0.0}
    assert mapping.action(touch._replace(flags=8), action) == lifted
    assert mapping.action(None, action) == lifted
