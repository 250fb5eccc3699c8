"""Links between documents lead to existing headings, with GitHub's names of anchors."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCUMENTS = subprocess.run(
    ["git", "ls-files", "*.md"], cwd=ROOT, capture_output=True, text=True, check=True
).stdout.split()
CODE = re.compile(r"^(```|~~~).*?^\1", re.MULTILINE | re.DOTALL)
HEADING = re.compile(r"^#{1,6} +(.*?) *#*$", re.MULTILINE)
LINK = re.compile(r"\]\((?!https?:)([^)#\s]*)#([^)\s]+)\)")


def prose(path):
    """Return the text of a document without its code blocks."""
    return CODE.sub("", path.read_text(encoding="utf-8"))


def anchors(text):
    """Return the anchors of a document's headings, as GitHub names them."""
    found = []
    for heading in HEADING.findall(text):
        words = re.sub(r"\]\([^)]*\)", "", heading)
        anchor = re.sub(r"[^\w\- ]", "", words).strip().lower().replace(" ", "-")
        again = sum(re.fullmatch(rf"{re.escape(anchor)}(-\d+)?", one) is not None for one in found)
        found.append(f"{anchor}-{again}" if anchor in found else anchor)
    return found


def broken(path):
    """Return (document, anchor) of each link in a document whose anchor does not exist."""
    links = [(path.parent / to if to else path, anchor) for to, anchor in LINK.findall(prose(path))]
    return [(to.name, anchor) for to, anchor in links if anchor not in anchors(prose(to))]


@pytest.mark.parametrize("name", DOCUMENTS)
def test_anchors_of_links_exist(name):
    assert broken(ROOT / name) == []


def test_anchors_are_named_as_github_does():
    text = "# A `name`, and 2 µm\n\n## A name\n\n## A name\n"
    assert anchors(text) == ["a-name-and-2-µm", "a-name", "a-name-1"]


def test_a_broken_anchor_is_found(tmp_path):
    (tmp_path / "b.md").write_text("# Here\n```sh\n# not here\n```\n")
    page = tmp_path / "a.md"
    page.write_text("[x](b.md#here) [y](b.md#not-here) [z](#there) [w](https://a.b/c#d)\n")
    assert broken(page) == [("b.md", "not-here"), ("a.md", "there")]
