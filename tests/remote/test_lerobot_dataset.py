"""Datasets of LeRobot, read by pyarrow and pandas, and checked by lerobot-doctor."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from lerobot_doctor.dataset_loader import load_local
from lerobot_doctor.runner import Severity, run_checks
from support.refusals import refusal

import spots
from spots.errors import FileError
from spots.link.board import Board
from spots.link.connect import prepare
from spots.recording.export import export
from spots.recording.recorder import Recorder
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.files import ScenarioFile, load
from spots_sim.strip.scenario import Scenario

pytestmark = pytest.mark.board


@pytest.fixture(scope="module")
def recordings(sensor, calibration, tmp_path_factory):
    """Recordings without marks and with marks."""
    folder = tmp_path_factory.mktemp("lerobot")
    scenario = Scenario(load(ScenarioFile, "demo"))
    with Board(LockstepLink(sensor, scenario, 1)) as board:
        prepare(board, calibration)
        with (
            Recorder(board, folder / "plain.spots"),
            Recorder(board, folder / "marked.spots") as marked,
        ):
            board.stream("touch", "spectrum")
            for text in ("tap", "slide", "end", "tap", None):
                for _ in board.frames(3.0):
                    pass
                if text:
                    marked.mark(text)
    return folder


def checked(folder):
    results = run_checks(load_local(folder))
    return [
        f"{one.name}: {message.message}"
        for one in results.results
        for message in one.messages
        if message.severity == Severity.FAIL
    ]


def test_a_recording_is_one_episode(recordings, tmp_path):
    out = tmp_path / "plain"
    export(recordings / "plain.spots", "lerobot", out)
    assert checked(out) == []
    info = json.loads((out / "meta/info.json").read_text())
    assert info["codebase_version"] == "v3.0"
    assert info["fps"] == 100
    assert info["splits"] == {"train": "0:1"}
    data = pq.read_table(out / "data/chunk-000/file-000.parquet")
    assert set(data.column_names) == set(info["features"])
    assert len(data) == info["total_frames"] > 1400
    for name, feature in info["features"].items():
        kind = data.schema.field(name).type
        if feature["names"]:
            assert kind.list_size == feature["shape"][0] == len(feature["names"])
            assert str(kind.value_type) == "float" == feature["dtype"].replace("32", "")
    times_s = data["timestamp"].to_numpy()
    assert np.allclose(times_s, np.arange(len(data)) / 100, atol=1e-4)  # LeRobot's tolerance
    state = np.stack(data["observation.state"].to_numpy())
    assert not np.isnan(state).any()
    touches = spots.read_dataframe(recordings / "plain.spots")
    trusted = touches[touches.trusted]
    assert state[:, 1].max() == pytest.approx(trusted.force_mN.max() / 1000)
    assert state[:, 2].sum() == pytest.approx(len(trusted), abs=0.02 * len(trusted))
    length_um = info["spots"]["length_um"]
    assert {*state[state[:, 2] > 0, 0].round(5)} <= {
        *(trusted.position_um / length_um).astype("f4").round(5)
    }


def test_episodes_begin_at_marks(recordings, tmp_path):
    out = tmp_path / "marked"
    export(recordings / "marked.spots", "lerobot", out)
    assert checked(out) == []
    episodes = pq.read_table(out / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [one["tasks"] for one in episodes] == [["tap"], ["slide"], ["tap"]]
    assert [one["length"] for one in episodes] == pytest.approx([300, 300, 300], abs=3)
    assert episodes[1]["dataset_from_index"] == episodes[0]["dataset_to_index"]
    tasks = pd.read_parquet(out / "meta/tasks.parquet")  # as LeRobot reads it
    assert tasks.index.tolist() == ["tap", "slide"]
    assert tasks.task_index.tolist() == [0, 1]
    data = pq.read_table(out / "data/chunk-000/file-000.parquet").to_pydict()
    assert sorted({*data["task_index"]}) == [0, 1]
    assert data["index"] == [*range(len(data["index"]))]
    stats = json.loads((out / "meta/stats.json").read_text())
    assert stats["action"]["count"] == [len(data["index"])]


def test_an_existing_folder_and_a_recording_without_readings_are_refused(
    recordings, sensor, tmp_path
):
    (tmp_path / "there").mkdir()
    with refusal(FileError, file="there"):
        export(recordings / "plain.spots", "lerobot", tmp_path / "there")
    board = Board(LockstepLink(sensor, Scenario(load(ScenarioFile, "demo")), 1))
    with board, Recorder(board, tmp_path / "empty.spots"):
        pass
    with refusal(FileError):
        export(tmp_path / "empty.spots", "lerobot", tmp_path / "new")
    assert not (tmp_path / "new").exists()
