"""Upgrades a board from version 0.1.0: calibration and settings must survive."""

import json
import zipfile
from itertools import islice
from pathlib import Path

import pytest
from boards import running

import spots
from spots.cli import main
from spots.deploy import flash, place
from spots.deploy.build import build, files_of
from spots.deploy.staging import device_of
from spots.link.frames import Spectrum, Touch
from spots_sim.demo.virtual import virtual_board

DATA = Path(__file__).parents[1] / "data" / "0.1.0"
BOARDS = ("virtual", "virtual_circuitpython")
KEPT = ("settings.txt", "calibration.txt", "layout.txt")
SET = {"average": 2, "baseline": 1, "keys": 1, "watchdog": 1, "gain": 9, "exposure_us": 10_000}
CALIBRATION, LAYOUT = "ae012d46", "94153cee"


def unpacked(board, folder):
    """Unpack the file system of a board that version 0.1.0 has flashed; return the folder."""
    with zipfile.ZipFile(DATA / f"{board}.zip") as archive:
        archive.extractall(folder)
    return folder


def check_state(board):
    """Check that a board has the stored settings, calibration and layout of version 0.1.0."""
    found = board.command("hello") | board.command("get")
    assert {name: found[name] for name in SET} == SET
    assert (found["calibration"], found["layout"]) == (CALIBRATION, LAYOUT)
    return found


@pytest.mark.parametrize("name", BOARDS)
def test_a_board_of_0_1_0_answers_this_host(tmp_path, capsys, name):
    with running(unpacked(name, tmp_path), name) as start:
        port = start["port"]
        with spots.open(port) as board:
            assert board.info["firmware"] == "0.1.0"
            assert "rate_mHz" not in check_state(board)
            board.command("stream touch spectrum")
            frames = list(islice(board.frames(), 40))
            assert {type(frame) for frame in frames} >= {Touch, Spectrum}
            board.command("stream off")
            assert board.command("set average=1 led_mA=10")["average"] == 1
            with pytest.raises(spots.SpotsError, match="no setting is called"):
                board.command("set nonsense=1")
        assert main(["command", "--port", port, "get"]) == 0
        assert json.loads(capsys.readouterr().out)["led_mA"] == 10
        assert main(["doctor", "--port", port]) == 2
        assert f"0.1.0 on the board, {spots.__version__} here" in capsys.readouterr().out


def test_the_firmware_of_before_does_not_answer_for_the_new_one(tmp_path, monkeypatch):
    monkeypatch.setattr(place, "_RETURN_S", 1.0)
    with running(unpacked("virtual", tmp_path)) as start:
        there = place.Place(start["port"], None, lambda: [start["port"]])
        with pytest.raises(spots.SpotsError, match=r"still runs firmware 0\.1\.0"):
            flash._greet(there)


@pytest.mark.parametrize("name", BOARDS)
def test_a_flash_upgrades_0_1_0_and_keeps_what_the_user_made(tmp_path, monkeypatch, name):
    folder = unpacked(name, tmp_path / "board")
    own = {path: (folder / path).read_bytes() for path in KEPT}
    if name == "virtual":
        own["tactile/hers.py"] = b"the user's own"
        (folder / "tactile" / "hers.py").write_bytes(own["tactile/hers.py"])
    with virtual_board(folder, device_of(name)) as there:
        monkeypatch.setattr(place, "_on_drive", lambda drive: there)
        assert main(["flash", name, "--port", there.name]) == 0
        with spots.open(there.ports()[0]) as board:
            assert board.info["firmware"] == spots.__version__
            assert "note" not in board.info
            check_state(board)
            board.command("stream touch")
            touches = (frame for frame in board.frames(20) if isinstance(frame, Touch))
            assert any(touch.touching and touch.trusted for touch in touches)
    wanted = files_of(build(name, tmp_path / "build"))
    assert {path: data for path, data in files_of(folder).items() if path != "boot_out.txt"} == (
        wanted | own
    )
    assert (folder / "tactile").exists() == ("tactile/hers.py" in own)
    assert not (folder / "tactile" / "runtime").exists()
