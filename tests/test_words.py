"""One thing, one word: documents and help texts avoid the words that CONTRIBUTING.md excludes."""

from __future__ import annotations

import argparse
import re

import pytest
from support.documents import ROOT

from spots.cli import _parser

TABLE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("\n## Words\n")[2]
ROW = re.compile(r"^\| (?!word )(.+) \| (.+) \| (.*)\|$", re.MULTILINE)
EXCLUDED = [
    word
    for row in ROW.findall(TABLE.partition("\n## ")[0])
    for word in row[2].strip().split(", ")
    if word
]
WORDS = re.compile(rf"\b(?:{'|'.join(map(re.escape, EXCLUDED))})s?\b", re.IGNORECASE)
DOCUMENTS = [
    path
    for path in (*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("examples/**/*.md"))
    if path.name not in ("CHANGELOG.md", "CONTRIBUTING.md")
]


def helps(parser):
    """Yield the help of a command and of all commands below it."""
    yield parser.format_help()
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from helps(below)


@pytest.mark.parametrize(
    "path", DOCUMENTS, ids=[path.relative_to(ROOT).as_posix() for path in DOCUMENTS]
)
def test_a_document_uses_the_agreed_words(path):
    assert WORDS.findall(path.read_text(encoding="utf-8")) == []


@pytest.mark.board
def test_help_texts_use_the_agreed_words():
    texts = list(helps(_parser()))
    assert len(texts) > 20
    assert [found for text in texts if (found := WORDS.findall(" ".join(text.split())))] == []


def test_the_table_excludes_words():
    assert len(EXCLUDED) > 20
    assert WORDS.findall("two packets, a log file, and repackets") == ["packets", "log file"]
