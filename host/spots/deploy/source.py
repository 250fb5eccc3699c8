"""The source text of a module, in which a build replaces parts."""

from __future__ import annotations

import ast
from itertools import accumulate
from pathlib import Path


class Source:
    """A module of which parts can be replaced, without a change of the rest of its text.

    Parts are replaced by their positions in the syntax tree `tree`.
    """

    def __init__(self, path: Path):
        self._path = path
        self._text = path.read_bytes()
        self.tree = ast.parse(self._text)
        # Number of bytes before each line. The columns of a syntax tree also count bytes.
        self._before = [0, *accumulate(map(len, self._text.splitlines(keepends=True)))]
        self._changes: list[tuple[int, int, bytes]] = []

    def replace(self, first: tuple[int, int], end: tuple[int, int], text: str) -> None:
        """Replace a part of the module when the file is written.

        `first` and `end` are line number and column of the first character, and of the character
        after the last.
        """
        self._changes.append((self._at(*first), self._at(*end), text.encode()))

    def omit_right(self, node: ast.BinOp) -> None:
        """Omit the operator ``^`` or ``-`` of an operation, and its right operand."""
        left = self._at(node.left.end_lineno, node.left.end_col_offset)
        right = self._at(node.right.lineno, node.right.col_offset)
        # Between the operands there may be parentheses, too.
        kept = self._text[left:right].rstrip(b" ^-\n")
        stop = self._at(node.right.end_lineno, node.right.end_col_offset)
        self._changes.append((left + len(kept), stop, b""))

    def _at(self, line: int, column: int) -> int:
        return self._before[line - 1] + column

    def write(self) -> None:
        """Write the module's file again, with all replacements."""
        text = self._text
        for first, end, new in sorted(self._changes, reverse=True):
            text = text[:first] + new + text[end:]
        self._path.write_bytes(text)
