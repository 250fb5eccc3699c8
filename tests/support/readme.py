"""Commands of the documents, walked on a virtual board."""

from __future__ import annotations

import re

from support.documents import ROOT, shell_lines

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


def steps():
    """Return the text of the section `From bare board to key press` in docs/build/hardware.md."""
    text = (ROOT / "docs/build/hardware.md").read_text(encoding="utf-8")
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
