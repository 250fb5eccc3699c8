"""Applications without the simulator installed: the error is one sentence, and exit code 2."""

import sys

import pytest

import spots.cli
from spots.link import ports

ARGUMENTS = [
    "keyboard --port virtual --dry-run",
    "keys push mini --port virtual",
    "controller --port virtual --dry-run",
    "controller --port virtual --calibrate",
    "wearable --port virtual --dry-run",
    "twin",
    "twin --port virtual",
    "twin --port virtual --port virtual",
    "twin --record a.spots",
    "serve --linkage default --port virtual",
    "serve --linkage default",
]


@pytest.fixture
def product_alone(monkeypatch):
    """Hide all modules and entry points of the simulator."""
    for module in (ports, spots.cli):
        known = module.entry_points
        monkeypatch.setattr(
            module,
            "entry_points",
            lambda known=known, **named: [
                one for one in known(**named) if not one.value.startswith("spots_sim")
            ],
        )
    for name in [*sys.modules]:
        if name.split(".")[0] == "spots_sim":
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "spots_sim", None)  # as one that is not installed


@pytest.mark.parametrize("arguments", ARGUMENTS)
def test_without_the_laboratory_a_command_answers_in_one_sentence(
    product_alone, arguments, capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    assert spots.cli.main(arguments.split()) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert said.err.startswith("spots: ")
    named = ("needs the simulator", "--linkage", "linkage file", "--port")
    assert any(word in said.err for word in named)
    assert list(tmp_path.iterdir()) == []
