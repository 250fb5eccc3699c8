"""Asks before a command removes what a user may have on a board."""

import sys

from ..common import typed_ahead
from ..errors import StateError, printable


def confirm(command: str, question: str, unchanged: str) -> None:
    """Ask a question in the terminal; only the answer y or yes lets the command go on.

    StateError if the answer is another one, or nobody can answer; it says what is `unchanged`.
    """
    if not sys.stdin.isatty():
        raise StateError(
            f"{command} asks for a confirmation: add --yes to run it without a terminal"
        )
    typed_ahead.drop()
    print(f"{printable(question)} [y/N] ", end="", flush=True)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise StateError(f"{unchanged}, because the answer was not 'y' or 'yes'")
