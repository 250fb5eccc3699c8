"""Commands in README and first-press.md run from the wheel, with the packages of `make demo`."""

from __future__ import annotations

import re
import shlex
import shutil
import signal
import subprocess
import threading

import pytest
from support.documents import ROOT, blocks
from support.environments import variables
from support.readme import LINES, NEEDS_HARDWARE, WALKED, steps, walk

pytestmark = pytest.mark.board

TIMEOUT_S = 120
# Commands that do not end by themselves, and a text that each prints when it runs.
ENDLESS = {
    "spots demo --page": "http://",
    "spots serve --port virtual": "http://",
    "spots monitor --port virtual": " mm",
    "spots publish --port virtual": "publish",
    "spots controller --port virtual --dry-run": "x",
    "spots twin --port virtual": "end point",
    "spots doctor --port virtual": "hello",  # it judges the speed of this computer
    "spots keyboard --layout mini --dry-run --port virtual": "down",
    "python": " ",
}
RECORDING = "run.spots"
# Additional options. Another program may use the usual HTTP port. With the usual exposure of
# 100 ms, `characterize` takes three times as long as with 10 ms. 20 presses are the fewest.
MORE = {"serve": ["--http-port", "0"], "characterize": ["--exposure-us", "10000"]}
MORE["calibrate"] = ["--places", "20"]
# Text that each other command prints, by name of the command.
PRINTED = {
    "flash": "copy main.py",
    "command": '"exposure_us": 10000',
    "record": RECORDING,
    "info": "virtual",
    "export": "run.mcap",
    "calibrate": " mm",
    "characterize": "accuracy",
    "design": "mm",
}


@pytest.fixture(scope="module")
def newcomer(tmp_path_factory, environment):
    """Working directory, and variables of an environment with the packages of `make demo`."""
    recipe = (ROOT / "Makefile").read_text(encoding="utf-8").split("\n.venv/demo:")[1]
    extras = ",".join(re.findall(r"'\.\[([a-z,]+)\]'", recipe.split("\n\n")[0]))
    return tmp_path_factory.mktemp("newcomer"), variables(environment(*extras.split(",")))


def run(words, said, newcomer):
    """Run a command to its end, or send Ctrl-C when it has printed `said`; return its output."""
    folder, environment = newcomer
    program = shutil.which(words[0], path=environment["PATH"])
    process = subprocess.Popen(
        [program, *words[1:]],
        cwd=folder,
        env=environment | {"PYTHONUNBUFFERED": "1"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    timer = threading.Timer(TIMEOUT_S, process.kill)
    timer.start()
    lines, awaited = [], said
    for line in process.stdout:
        lines.append(line)
        if awaited and awaited in line:
            process.send_signal(signal.SIGINT)
            awaited = ""
    timer.cancel()
    output = "".join(lines)
    assert not awaited, output
    assert process.wait() in ((0, 130, -signal.SIGINT) if said else (0,)), output
    return output


@pytest.mark.parametrize("line", LINES)
def test_a_line_of_the_readme_runs_after_make_demo(line, newcomer):
    words = shlex.split(line)
    if RECORDING in words and words[1] != "record" and not (newcomer[0] / RECORDING).exists():
        (record,) = (one for one in LINES if one.startswith("spots record"))  # in another process
        run(shlex.split(record), "", newcomer)
    words += MORE.get(words[1], [])
    output = run(words, ENDLESS.get(line, ""), newcomer)
    assert "Traceback" not in output
    assert PRINTED.get(words[1], "") in output


@pytest.mark.parametrize("text", [text for kind, text in blocks("README.md") if kind == "python"])
def test_a_program_of_the_readme_runs_after_make_demo(text, newcomer):
    run(["python", "-c", text], ENDLESS["python"], newcomer)


@pytest.mark.parametrize("line", sorted(WALKED))
def test_a_step_from_bare_board_to_key_press_runs_on_a_virtual_board(line, newcomer):
    words = shlex.split(line)
    words += [] if "--rough" in words else MORE.get(words[1], [])
    output = run(words, ENDLESS.get(line, ""), newcomer)
    assert "Traceback" not in output


def test_only_steps_without_a_command_are_left_out_of_the_walk():
    assert {*NEEDS_HARDWARE} <= {*walk()}
    left_out = {line for line in walk() if not line.startswith("spots ")}
    assert left_out < {*NEEDS_HARDWARE}
    for step in (".uf2", "BOOTSEL"):
        assert step in steps()
