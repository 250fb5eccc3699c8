"""The commands in README and hardware.md run from the wheel, with the packages of `make demo`."""

from __future__ import annotations

import re
import shlex
import shutil
import signal
import subprocess
import threading

import pytest
from test_documents import ROOT, blocks, shell_lines

from environments import variables

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
# Commands in the list of hardware.md that cannot run here, and why. Other steps of the list have no
# command: copying a .uf2 file to the drive of a bootloader, wiring, painting, and the udev file.
_NETWORK, _ROOT = "downloads from PyPI", "changes this computer, as root"
_DRIVE = "copies to the drive of a boot loader; deploy/test_bootsel.py has a substitute"
_DOWNLOADED = "needs a file from micropython.org; deploy/test_image.py has a substitute"
_CHIP = "writes the flash of a real ESP32-S3"
NEEDS_HARDWARE = {
    'pip install -e ".[all]"': _NETWORK,
    "pip install esptool": _NETWORK,
    'sudo usermod -aG dialout "$USER"': _ROOT,
    "sudo udevadm control --reload": _ROOT,
    "esptool --port PORT erase_flash": _CHIP,
    "esptool --port PORT write_flash 0 spots.bin": _CHIP,
    "spots flash pico --runtime RPI_PICO.uf2": _DRIVE,
    "spots image xiao_esp32s3 --runtime ESP32_GENERIC_S3.bin --out spots.bin": _DOWNLOADED,
    "spots dark": "a person unplugs the LED; calibrate/test_dark_command.py simulates the person",
}
_NO_BOARD = {"spots ports", "spots boards"}
_PROGRAMS = {"spots", "pip", "sudo", "esptool", "mpremote", "make", "python", "python3"}
LINES = [one for one in shell_lines("README.md") if one.startswith("spots ")]
RECORDING = "run.spots"
# Additional options. Another program may use the usual HTTP port. With the usual exposure of
# 100 ms, `characterize` takes three times as long as with 10 ms.
MORE = {"serve": ["--http-port", "0"], "characterize": ["--exposure-us", "10000"]}
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


def steps():
    """Return the text of the section `From bare board to key press` in docs/hardware.md."""
    text = (ROOT / "docs/hardware.md").read_text(encoding="utf-8")
    return text.split("## From bare board to key press\n")[1].split("\n## ")[0]


def walk():
    """Return the commands in the code blocks and in the text of this section, as keys of a dict."""
    numbers = [int(number) for number in re.findall(r"^(\d+)\. ", steps(), re.MULTILINE)]
    assert numbers == list(range(1, len(numbers) + 1))
    block = re.compile(r"^ *```(\w+)\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)
    inside = [text for kind, text in block.findall(steps()) if kind == "sh"]
    lines = [line.strip() for text in inside for line in text.splitlines()]
    spans = re.findall(r"`([^`]+)`", block.sub("", steps()))
    named = [" ".join(span.split()) for span in spans if span.split()[0] in _PROGRAMS]
    assert {"spots doctor", "spots calibrate"} <= {*lines}
    assert {"spots flash pico", "spots calibrate --rough", "spots dark"} <= {*named}
    return dict.fromkeys(lines + named)


def on_a_virtual_board(line):
    """Return a command of hardware.md, changed for a virtual board as the section describes."""
    if line == "spots flash pico":
        return "spots flash virtual --dry-run"
    return line if line in _NO_BOARD or "virtual" in line else line + " --port virtual"


# Each command runs only one time: README has some of them, and `save` is repeated in hardware.md.
WALKED = {on_a_virtual_board(line) for line in walk() if line not in NEEDS_HARDWARE} - {*LINES}


@pytest.mark.parametrize("line", sorted(WALKED))
def test_a_step_from_bare_board_to_key_press_runs_on_a_virtual_board(line, newcomer):
    output = run(shlex.split(line), ENDLESS.get(line, ""), newcomer)
    assert "Traceback" not in output


def test_only_steps_without_a_command_are_left_out_of_the_walk():
    assert {*NEEDS_HARDWARE} <= {*walk()}
    left_out = {line for line in walk() if not line.startswith("spots ")}
    assert left_out < {*NEEDS_HARDWARE}
    for step in (".uf2", "BOOTSEL", "/etc/udev/rules.d/"):
        assert step in steps()
