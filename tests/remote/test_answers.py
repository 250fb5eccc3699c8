"""Questions from afar never cost a board its readings."""

from __future__ import annotations

import inspect
from contextlib import nullcontext
from types import SimpleNamespace

from spots.errors import SpotsError
from spots.link.serial_link import Link
from spots.remote.answers import Answers
from spots.remote.zenoh_link import ZenohLink


class Query(nullcontext):
    payload = attachment = None
    parameters = ""

    def __init__(self, said):
        super().__init__()
        self.reply_err = said.append


def test_a_board_that_does_not_answer_is_asked_a_tenth_of_the_time():
    clock = SimpleNamespace(s=0.0)
    asked = []

    def command(line, timeout_s):
        asked.append(line)
        clock.s += timeout_s
        raise SpotsError("no reply")

    board = SimpleNamespace(
        now_s=lambda: clock.s, command=command, stats=SimpleNamespace(restarts=0)
    )
    declared = []

    def declare_queryable(name, note):
        declared.append(note)
        return SimpleNamespace(key_expr=name)

    answers = Answers(board, "a1", SimpleNamespace(declare_queryable=declare_queryable))
    said = []
    busy_s = 0.0
    for _ in range(3000):
        for note in declared:
            getattr(note, "callback", note)(Query(said))
        began_s = clock.s
        answers.give()
        busy_s += clock.s - began_s
        clock.s += 0.01
    assert said
    assert busy_s < 0.15 * clock.s


def test_a_link_from_afar_has_all_that_a_link_has():
    methods = {name for name, _ in inspect.getmembers(Link, inspect.isfunction) if name[0] != "_"}
    assert methods <= set(dir(ZenohLink))
