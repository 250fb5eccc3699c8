"""Commands of the documents, walked on a virtual board."""

from __future__ import annotations

import re

from support.documents import ROOT, shell_lines

# Commands in first-press.md that cannot run here, and why.
_NETWORK = "downloads from PyPI"


_DRIVE = "copies to the drive of a boot loader; deploy/test_bootsel.py has a substitute"


NEEDS_HARDWARE = {
    'pip install -e ".[virtual,web,flash]"': _NETWORK,
    "spots flash pico --runtime RPI_PICO.uf2 --layout mini --led gpio": _DRIVE,
    "spots dark": "a person unplugs the LED; calibrate/test_dark_command.py simulates the person",
}


_NO_BOARD = {"spots ports", "spots boards"}


_PROGRAMS = {"spots", "pip", "sudo", "esptool", "mpremote", "make", "python", "python3"}


LINES = [one for one in shell_lines("README.md") if one.startswith("spots ")]


def steps():
    """Return the text of docs/build/first-press.md, From bare board to key press."""
    return (ROOT / "docs/build/first-press.md").read_text(encoding="utf-8")


def walk():
    """Return the commands in the code blocks and in the text of this page, as keys of a dict."""
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
    """Return a command of first-press.md, changed for a virtual board as the section describes."""
    if line == "spots flash pico":
        return "spots flash virtual --dry-run"
    return line if line in _NO_BOARD or "virtual" in line else line + " --port virtual"


# Each command runs only one time: README has some of them, and `save` is repeated in the list.
WALKED = {on_a_virtual_board(line) for line in walk() if line not in NEEDS_HARDWARE} - {*LINES}
