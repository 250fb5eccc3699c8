"""The programs of docs/program and of public docstrings run on a board in simulated time."""

from __future__ import annotations

import doctest
import importlib
import re
import shutil
import textwrap
from pathlib import Path

import matplotlib
import pandas as pd
import pytest
from make import build_site
from support.documents import PRINTED, check_printed

import spots
from spots import errors
from spots.errors import SpotsError
from spots.link.board import Board
from spots.link.board_errors import REASONS
from spots.link.connect import prepare
from spots_device.board.settings import checksum
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.files import ScenarioFile, load
from spots_sim.strip.scenario import Scenario

PAGES = {
    page: build_site.source(page).read_text(encoding="utf-8")
    for page in build_site.pages()
    if page.startswith("program/")
}
# A comment before a block explains why it does not run here.
BLOCK = re.compile(
    r"^( *)(<!-- not run[^\n]*\n *)?```python\n(.*?)^ *```" + PRINTED, re.MULTILINE | re.DOTALL
)
FILES = Path(__file__).parents[1] / "data"  # run.spots and joint.toml of the examples
matplotlib.use("Agg")


@pytest.fixture
def simulated(sensor, calibration, monkeypatch):
    """Let `spots.open` open a calibrated board in simulated time; return the list of boards."""
    made = []

    def opened(port=None):
        assert port in (None, "virtual")
        made.append(Board(LockstepLink(sensor, Scenario(load(ScenarioFile, "demo")))))
        prepare(made[-1], calibration)
        return made[-1]

    monkeypatch.setattr(spots, "open", opened)
    yield made
    for board in made:
        board.close()


def blocks(page):
    """Return the programs of a page, each with what the page shows as its output."""
    found = BLOCK.findall(PAGES[page])
    return [(textwrap.dedent(text), shown) for _, left_out, text, shown in found if not left_out]


@pytest.fixture
def run(simulated, tmp_path, monkeypatch, capsys):
    """Return a function that runs the programs of a page, and returns their names and output."""

    def run_page(page):
        programs = blocks(page)
        shutil.copy(FILES / "run.spots", tmp_path)
        monkeypatch.chdir(tmp_path)
        names, whole = {}, ""
        for program, shown in programs:
            exec(compile(program, page, "exec"), names)
            whole += (out := capsys.readouterr().out)
            check_printed(shown, out)
        return names, whole

    return run_page


@pytest.mark.board
def test_the_tutorial_prints_each_press(run):
    names, out = run("program/index.md")
    assert names["board"].state == "closed"
    assert set(names["board"].info["channels"]) == set(re.findall(r"'(F\d)': \d+", out))
    assert re.findall(r"^\d\.\d\d N$", out, re.MULTILINE)


@pytest.mark.board
def test_a_loop_reads_without_waiting(run):
    names, out = run("program/latest.md")
    assert names["board"].state == "closed"
    assert names["newest"][0].time_s
    assert any(line.startswith("400.") for line in out.splitlines())


@pytest.mark.board
def test_fingers_and_keys_are_followed(run):
    names, out = run("program/contacts.md")
    assert names["fingers"]
    assert names["alone"]
    assert "left the strip" in out


@pytest.mark.board
def test_a_notebook_has_tables_and_a_plot(run):
    names, out = run("program/notebooks.md")
    assert {"position_um", "mark"} <= {*names["table"].columns}
    assert len(names["recent"]) > 100
    assert "Touch(" in out


@pytest.mark.board
def test_many_boards_are_read_in_one_program(run):
    names, _ = run("program/many-boards.md")
    assert {one for one, _ in names["got"]} == {*names["by_id"]}


@pytest.mark.board
def test_settings_and_a_layout_reach_the_board(run):
    names, out = run("program/commands.md")
    assert names["settings"]["average"] == 2
    assert f"\n{checksum(names['load']('mini').lines)}\n" in out
    assert "bad_value" in out


@pytest.mark.board
def test_the_page_of_errors_prints_what_it_shows(run):
    _, out = run("program/errors.md")
    tree, *shown = re.findall(r"^```text\n(.*?)^```", PAGES["program/errors.md"], re.M | re.S)
    assert tree.startswith("SpotsError\n")
    assert out == "".join(shown)


@pytest.mark.board
def test_a_recording_is_made_and_read(run):
    names, out = run("program/recordings.md")
    assert len(spots.read_arrays("fingers.spots").contacts) > 10
    touches = spots.read_arrays("run.spots").touches
    mean_um = touches["position_um"][touches["known"]].mean()
    assert 0 < len(names["touches"]) < len(touches)
    assert names["touches"]["position_um"].mean() == pytest.approx(mean_um)
    assert names["table"].position_um.mean() == pytest.approx(mean_um)
    assert Path("run.png").read_bytes().startswith(b"\x89PNG")
    assert out


@pytest.mark.board
def test_exports_leave_out_what_is_unknown(run):
    names, out = run("program/export.md")
    assert re.search(r"^/spots_\w+/strip0/reading spots_msgs/msg/Reading \d+$", out, re.MULTILINE)
    assert len(pd.read_parquet("run.parquet")) == len(names["touch"])
    assert 0 < names["touch"]["known"].sum() < len(names["touch"])


@pytest.mark.board
def test_the_programs_of_each_page_run_in_a_test():
    text = Path(__file__).read_text(encoding="utf-8")
    with_programs = {page for page in PAGES if blocks(page)}
    assert with_programs == {*re.findall(r'run\("(program/[^"]+)"\)', text)}


@pytest.mark.board
def test_the_simulator_is_opened(run):
    run("program/api/simulator.md")


def test_the_page_of_errors_has_the_tree_of_the_classes():
    page = PAGES["program/errors.md"]
    tree = errors.__doc__.partition("::\n\n")[2].rstrip()
    assert f"```text\n{textwrap.dedent(tree)}\n```" in page
    every = {name for name, one in vars(errors).items() if _is_error(one)}
    assert every == {*re.findall(r"\b\w+Error\b", tree)}


def test_the_page_of_errors_has_the_codes_of_boards():
    codes = PAGES["program/errors.md"].partition("\n## Codes of a board\n")[2]
    rows = re.findall(r"^\| `(\w+)` \| (.*) \|$", codes, re.MULTILINE)
    assert {code: text for code, text in rows if code != "why"} == REASONS


def _is_error(one):
    return isinstance(one, type) and issubclass(one, SpotsError)


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
