"""Sends damaged messages to the editors of files, which must not change anything."""

from __future__ import annotations

import random

from spots.errors import SpotsError

FRAGMENTS = (
    "", '"', "\\", "[", "{", "=", "\n", "#", "9", "-", "\u00e9", "\x00", "clear", "push",
    '{"do":"clear"}',
)  # fmt: skip
COUNT = 1000


def mutated(choice, text):
    """Return a text with some random changes; a short text can become empty."""
    parts = list(text)
    for _ in range(choice.randrange(1, 6)):
        at = choice.randrange(len(parts) + 1)
        part = choice.choice([*FRAGMENTS, *parts[at : at + 1]])
        parts[at : at + choice.randrange(3)] = part
    return "".join(parts)


def fuzz_change_nothing(editor, state, folder, bodies):
    """Send damaged messages to an editor without a board; check that it changes nothing.

    Parameters
    ----------
    editor : object
        Editor of files, such as `LayoutEditor`.
    state : PageState
        State of the web UI, which must not change.
    folder : Path
        Folder in which the editor could write files; it must stay empty.
    bodies : list of str
        Valid messages, from which the damaged messages are made.
    """
    choice = random.Random(0)
    before = state.since(state.begin())[1]
    checks = 0
    for _ in range(COUNT):
        try:
            request = editor.decode(mutated(choice, choice.choice(bodies)).encode())
        except ValueError:
            continue
        answer = editor.submit(request)  # without a board, only checks succeed
        assert answer.done()
        checks += answer.exception() is None
        assert answer.exception() is None or isinstance(answer.exception(), SpotsError)
    assert checks > 10
    assert state.since(state.begin())[1] == before
    assert not list(folder.iterdir())
