"""docs/extend/application.md: its files are a package whose command and panel work."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from textwrap import dedent

import pytest
from support.documents import ROOT

from spots.common import toml

pytestmark = pytest.mark.board
PAGE = (ROOT / "docs" / "extend" / "application.md").read_text(encoding="utf-8")
PANELS = "from spots_web.panels import installed; print([one.message() for one in installed()])"


def texts(language):
    found = re.findall(rf"^( *)```{language}\n(.*?)^\1```", PAGE, re.MULTILINE | re.DOTALL)
    return [dedent(text) for _, text in found]


@pytest.fixture
def run(tmp_path):
    """A function that runs Python, for which the package of the page is installed."""
    (project,) = map(toml.loads, texts("toml"))
    static = tmp_path / "my_knob" / "static"
    static.mkdir(parents=True)
    (tmp_path / "my_knob" / "__init__.py").write_text("\n".join(texts("python")), encoding="utf-8")
    (script,) = texts("js")
    (static / "panel.js").write_text(script, encoding="utf-8")
    about = tmp_path / "my_knob-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: my-knob\nVersion: 1.0\n")
    lines = []
    for group, entries in project["project"]["entry-points"].items():
        lines += [f"[{group}]", *(f"{name} = {place}" for name, place in entries.items())]
    (about / "entry_points.txt").write_text("\n".join(lines) + "\n")

    def run_python(*words):
        return subprocess.run(
            [sys.executable, *words],
            env=os.environ | {"PYTHONPATH": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout

    return run_python


def test_its_command_is_listed_and_reads_a_board(run):
    assert "Show a volume that a sliding finger changes" in run("-m", "spots", "--help")
    shown = run("-m", "spots", "knob", "--port", "virtual", "--seconds", "1")
    assert "50" in shown.splitlines()


def test_its_panel_can_be_shown(run):
    shown = run("-c", PANELS)
    assert "{'name': 'knob', 'title': 'Knob', 'style': False}" in shown
