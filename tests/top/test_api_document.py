"""The examples of docs/program/api.md and of public docstrings, on a board in simulated time."""

from __future__ import annotations

import doctest
import importlib
import re
from pathlib import Path

import matplotlib
import pytest

import spots
from spots.link.board import Board
from spots.link.connect import prepare
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.files import ScenarioFile, load
from spots_sim.strip.scenario import Scenario

TEXT = (Path(__file__).parents[2] / "docs/program/api.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
FILES = Path(__file__).parents[1] / "data"  # run.spots and joint.toml of the examples
matplotlib.use("Agg")


@pytest.fixture
def simulated(sensor, calibration, monkeypatch):
    """Let `spots.open` open a calibrated board in simulated time; return the list of boards."""
    made = []

    def opened(port=None):
        assert port == "virtual"
        made.append(Board(LockstepLink(sensor, Scenario(load(ScenarioFile, "demo")))))
        prepare(made[-1], calibration)
        return made[-1]

    monkeypatch.setattr(spots, "open", opened)
    yield made
    for board in made:
        board.close()


@pytest.mark.board
def test_the_document_runs(simulated, capsys):
    names = {}
    for block in BLOCKS:
        exec(compile(block, "api.md", "exec"), names)
    board = simulated[0]
    assert board.state == "closed"
    assert len(names["table"]) > 100
    assert len(names["recent"]) > 100
    assert names["fingers"]
    assert names["settings"]["average"] == 2
    assert board.info["calibration"] is not None
    assert "Touch(" in capsys.readouterr().out


@pytest.mark.parametrize("name", sorted(set(spots._MODULES.values())))
def test_the_examples_of_docstrings_run(name, simulated, monkeypatch):
    monkeypatch.chdir(FILES)
    module = importlib.import_module(f"spots.{name}")
    result = doctest.testmod(module, extraglobs={"spots": spots})
    assert result.failed == 0


CLASSES = {name for name in spots.__all__ if name[0].isupper()}


@pytest.mark.parametrize("name", sorted(CLASSES))
def test_each_public_class_has_an_example(name):
    found = doctest.DocTestFinder().find(getattr(spots, name), name)
    assert any(test.examples for test in found), f"{name} has no example in its docstring"
