"""Simulated time: a sensor, a scenario and a seed give the same bytes in each run."""

import json
import shutil
from pathlib import Path

import pytest
from support.viper import need_viper

import spots_device
from spots.cli import main
from spots.deploy.constants import inline
from spots.deploy.staging import VIPER, stage, use_viper
from spots.link.board import Board
from spots.link.connect import upload
from spots_sim.board import vm
from spots_sim.board.kept_folder import FOLDER
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.files import ScenarioFile, load
from spots_sim.strip.scenario import Scenario

pytestmark = pytest.mark.board


def figures(capsys, *arguments):
    assert main(["demo", "--fast", "--seconds", "5", "--json", *arguments]) == 0
    return json.loads(capsys.readouterr().out.splitlines()[-1])


def test_the_same_seed_gives_the_same_stream_and_another_one_another(capsys):
    first, second = figures(capsys), figures(capsys)
    other = figures(capsys, "--seed", "1")
    assert first == second
    assert first["stream_sha256"] != other["stream_sha256"]


def test_the_demo_meets_its_figures(capsys):
    run = figures(capsys)
    assert run["runtime"].startswith("micropython")
    assert run["rate_hz"] >= 95
    assert run["lost"] == run["bad_crc"] == 0
    assert run["touches"] >= 3
    assert run["position_rmse_um"] <= 150
    assert run["latency_ms"]["p50"] == pytest.approx(5.6, abs=0.6)  # half an exposure and the bus


@pytest.mark.usefixtures("own_firmware")
@pytest.mark.parametrize("seed", ["0", "7"])
def test_machine_code_changes_no_byte_of_the_stream(capsys, monkeypatch, seed):
    need_viper()
    portable = figures(capsys, "--seed", seed)
    staged = []

    def with_viper(device, folder):
        stage(device, folder)
        package = folder / "spots_device"
        firmware = Path(spots_device.__file__).parent
        for path in firmware.rglob(f"*{VIPER}.py"):
            shutil.copy(path, package / path.relative_to(firmware))
        use_viper(package)
        inline(package)
        for path in package.rglob("*.py"):
            if "@micropython.viper" in path.read_text(encoding="utf-8"):
                staged.append(path.stem)

    monkeypatch.setattr(vm, "stage", with_viper)
    assert figures(capsys, "--seed", seed) == portable
    assert {"burst", "kernel", "locate"} <= set(staged)


@pytest.mark.parametrize("board", ["virtual", "virtual_circuitpython"])
def test_shared_firmware_changes_no_byte_of_the_stream(
    sensor, calibration, tmp_path, monkeypatch, board
):
    streams = []
    for folder in (None, tmp_path):
        if folder:
            monkeypatch.delenv(FOLDER)  # sources in its own folder
        scenario = Scenario(load(ScenarioFile, "demo"))
        with Board(LockstepLink(sensor, scenario, 3, folder, board=board)) as made:
            sent = []
            made.channel.taps.append(lambda data, now_s, sent=sent: sent.append(data))
            upload(made, calibration)
            touches = list(made.touches(seconds=3))
            assert any(touch.touching for touch in touches)
            streams.append(b"".join(sent))
    assert (tmp_path / "spots_device" / "board" / "app.py").exists()
    assert streams[0] == streams[1]
