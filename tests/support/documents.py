"""Code blocks of the documents."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def blocks(name):
    return BLOCK.findall((ROOT / name).read_text(encoding="utf-8"))


def shell_lines(name):
    """Return the lines of a document's shell blocks, without their comments."""
    lines = [line for kind, text in blocks(name) if kind == "sh" for line in text.splitlines()]
    bare = [re.sub(r"\s+#.*$", "", line) for line in lines]
    return [one.strip() for line in bare for one in line.split("&&") if one.strip()]


# A block ``text`` directly after a program or command shows what it prints.
PRINTED = r"(?:\n+^ *```text\n(?P<printed>.*?)^ *```)?"


def masked(line):
    """Return a line with # for each number and port: these differ in each run."""
    line = re.sub(r"\bon (/dev/\S+|virtual):", "on #:", line)
    return re.sub(r"-?\b\d+(\.\d+)?\b|\bnan\b", "#", line).strip()


def check_printed(shown, output):
    """Assert that the output has each line that a page shows, except for its numbers."""
    lines = {masked(line) for line in output.splitlines()}
    assert [line for line in (shown or "").splitlines() if masked(line) not in lines] == []
