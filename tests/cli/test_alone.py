"""The host package alone: its commands load no package that plugs into it, and need none."""

import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

import pytest

pytestmark = pytest.mark.board

RUN = Path(__file__).parents[1] / "data" / "run.spots"
LOADED = """
import sys
import spots.cli
try:
    code = spots.cli.main(sys.argv[1:])
finally:
    names = {name.partition(".")[0] for name in sys.modules if name.startswith("spots")}
    print("loaded", *sorted(names))
sys.exit(code)
"""


def run(folder, line):
    """Run ``spots``; return its exit code, its output, and the packages that it loaded."""
    done = subprocess.run(
        [sys.executable, "-c", LOADED, *line.split()],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    output, _, loaded = done.stdout.rpartition("loaded ")
    return done.returncode, output + done.stderr, {*loaded.split()}


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (f"monitor --port recording:{RUN}", " s "),
        (f"keyboard --dry-run --port recording:{RUN}", ""),
        (f"wearable --dry-run --port recording:{RUN}", ""),
        (f"export {RUN} --to csv --out run", "run"),
        ("keys show mini", "ENTER"),
        ("boards", "Raspberry Pi Pico"),
    ],
)
def test_a_command_loads_no_package_beside_the_host_package(line, says, tmp_path):
    code, output, loaded = run(tmp_path, line)
    assert code == 0, output
    assert says in output
    assert loaded == {"spots", "spots_device"}


@pytest.mark.parametrize("line", ["record run.spots --port /dev/none", "monitor --port /dev/none"])
def test_a_missing_port_loads_no_package_beside_the_host_package(line, tmp_path):
    code, output, loaded = run(tmp_path, line)
    assert (code, output.count("\n")) == (2, 1)
    assert loaded == {"spots", "spots_device"}


def test_the_help_lists_the_commands_and_options_of_all_packages(tmp_path):
    commands = entry_points(group="spots.commands")
    packages = {point.value.partition(".")[0] for point in commands}
    assert run(tmp_path, "--help")[2] == packages | {"spots", "spots_device"}
    _, text, _ = run(tmp_path, "monitor --help")
    assert "--sensor FILE" in text
    assert "--zenoh-config FILE" in text


def test_an_option_of_a_package_loads_this_package(tmp_path):
    code, output, loaded = run(tmp_path, "monitor --port /dev/none --seed 1")
    assert (code, "--seed has no effect here: add --port virtual" in output) == (2, True)
    assert "spots_sim" in loaded
