"""Documents point at what exists."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = subprocess.run(
    ["git", "ls-files", "*.md"], cwd=ROOT, capture_output=True, text=True, check=True
).stdout.split()
LINK = re.compile(r"\]\(([^)#\s]+)(?:#([^)]+))?\)")
NAMED = re.compile(r"`((?:host|firmware|tests|docs|boards|examples)/[a-z0-9_./-]+)`")


@pytest.mark.parametrize("name", FILES)
def test_links_and_named_files_exist(name):
    text = (ROOT / name).read_text(encoding="utf-8")
    folder = (ROOT / name).parent
    missing = [
        link
        for link, _ in LINK.findall(text)
        if not link.startswith(("http:", "https:")) and not (folder / link).exists()
    ]
    # Changes name what was there once.
    named = [] if name == "CHANGELOG.md" else NAMED.findall(text)
    missing += [path for path in named if not (ROOT / path).exists()]
    assert missing == []
