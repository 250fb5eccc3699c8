"""Virtual boards with different seeds are different boards, each with its own calibration."""

import json

import pytest

import spots
import spots_sim
from spots import cli
from spots_sim.board.identity import board_id
from spots_sim.demo.linkage_demo import endless
from spots_sim.strip.files import SensorFile, load


def test_the_id_depends_on_the_number_of_the_board():
    sensor = load(SensorFile, "default")
    assert len({board_id(sensor, number) for number in range(9)}) == 9
    assert board_id(sensor) == board_id(sensor, 0)


@pytest.mark.board
@pytest.mark.parametrize("runtime", ["", "cpython"])
def test_virtual_boards_with_different_seeds_are_different_boards(runtime, monkeypatch):
    if runtime:
        monkeypatch.setenv("SPOTS_VIRTUAL_RUNTIME", runtime)
    with (
        spots.open("virtual") as first,
        spots_sim.open(seed=3) as second,
        spots.open("virtual") as third,  # its own id, beside the first one
    ):
        assert len({board.info["id"] for board in (first, second, third)}) == 3
        assert first.info["calibration"]
        assert second.info["calibration"]
        assert f"board {second.info['id']}" in second.calibration


@pytest.mark.board
def test_the_boards_of_a_simulated_linkage_are_different_boards():
    machine = endless("default")
    with machine.open(0) as first, machine.open(1) as second:
        assert first.info["id"] != second.info["id"]
        assert first.calibration
        assert second.calibration


@pytest.mark.board
def test_a_calibration_belongs_to_the_virtual_board_of_its_seed(tmp_path, capsys):
    session, made = str(tmp_path / "a.jsonl"), str(tmp_path / "a.toml")
    words = ["calibrate", "--rough", "--port", "virtual", "--session", session]
    assert cli.main([*words, "--seed", "4"]) == 0
    assert cli.main(["rezero", made, "--port", "virtual", "--seed", "4", "--marks", "1"]) == 0
    with spots_sim.open(seed=4) as board:
        assert json.loads(open(session).readline())["board"] == board.info["id"]
    capsys.readouterr()
    assert cli.main(["rezero", made, "--port", "virtual", "--marks", "1"]) == 2
    assert "the calibration was made on board" in capsys.readouterr().err
