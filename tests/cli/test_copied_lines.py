"""Lines that a reader copies from the documents into cmd.exe, zsh or another shell."""

import re
import shlex
from pathlib import Path

import pytest

from spots import cli

ROOT = Path(__file__).parents[2]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^ *```sh\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
# cmd.exe knows no single quotes, no variables before a command, and takes # for a word.
NOT_IN_CMD = re.compile(r"^'|[ =]'|^[A-Z_]+=|\$[A-Z{(]")
# Outside a comment, these characters mean something to zsh, which has no comments at its prompt,
# or to cmd.exe.
NOT_IN_COMMENT = re.compile(r"['\"`()<>|&*?$;\[\]{}~!]")


def lines():
    for path in DOCUMENTS:
        for block in BLOCK.findall(path.read_text(encoding="utf-8")):
            for line in block.splitlines():
                command, _, comment = line.strip().partition(" #")
                if command.startswith(("spots ", "python ", "make ", ".venv/")):
                    yield pytest.param(command, comment, id=f"{path.name}: {line.strip()[:50]}")


@pytest.mark.parametrize(("command", "comment"), [*lines()])
def test_a_line_of_a_document_works_in_each_shell(command, comment):
    assert not NOT_IN_CMD.search(command)
    assert not NOT_IN_COMMENT.search(comment)
    assert command.startswith("spots ") or not comment  # a script would take it for arguments
    assert shlex.split(command)


def test_a_comment_that_the_shell_passes_is_ignored(capsys):
    assert cli.main(["keys", "check", "mini", "#", "is", "it", "--right?"]) == 0
    assert "no problem found" in capsys.readouterr().out
