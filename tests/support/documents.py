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
