"""The package works without simulator and workshop, and its help does not mention them."""

import os
import re
import subprocess
import sys

import pytest

pytestmark = pytest.mark.board

HIDE = """
import importlib.metadata as metadata, sys
class Hide:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("spots_sim", "spots_make"):
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Hide())
every = metadata.entry_points()
found = [one for group in every.groups for one in every.select(group=group)]
product = [one for one in found if not one.value.startswith(("spots_sim", "spots_make"))]
metadata.entry_points = lambda: metadata.EntryPoints(product)
"""
# Prints the help of each command that is named, after a line with its name.
HELP = """
import sys
from spots.cli import main
for name in sys.argv[1:]:
    print("--", name)
    try:
        main([name, "--help"])
    except SystemExit as end:
        assert end.code == 0, name
"""
COMMANDS = "ports boards build flash erase doctor dark command monitor serve keys keyboard "
COMMANDS += "wearable controller twin calibrate record replay info export publish subscribe"


@pytest.fixture(scope="module")
def spots(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hidden")
    (folder / "sitecustomize.py").write_text(HIDE)

    def run(*arguments, program=("-m", "spots")):
        return subprocess.run(
            [sys.executable, *program, *arguments],
            cwd=folder,
            env=os.environ | {"PYTHONPATH": str(folder)},
            capture_output=True,
            text=True,
            check=False,
        )

    return run


def test_the_commands_are_the_products(spots):
    said = spots("--help").stdout
    for name in COMMANDS.split():
        assert re.search(rf"\n    {name}\s", said)
    for name in ("demo", "characterize", "design"):
        assert name not in said


def test_no_help_names_what_is_simulated(spots):
    run = spots(*COMMANDS.split(), program=("-c", HELP))
    assert run.returncode == 0, run.stderr
    assert run.stdout.count("-- ") >= len(COMMANDS.split())
    # Only the output of `spots boards` names the virtual board, because its files are packaged.
    for word in ("virtual", "simulat", "--sensor", "--scenario"):
        assert word not in run.stdout


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("monitor",), "or give ble:NAME, recording:FILE or zenoh:ID as the port"),
        (("monitor", "--port", "virtual"), "port 'virtual' needs the simulator"),
        (("twin",), "port 'virtual' needs the simulator"),
    ],
)
def test_a_mistake_is_one_sentence(spots, arguments, says):
    run = spots(*arguments)
    assert run.returncode == 2
    assert says in run.stderr
    assert run.stderr.count("\n") == 1
