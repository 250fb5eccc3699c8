"""Queries of remote readers: even a flood of queries does not delay or lose a board's readings."""

from __future__ import annotations

import inspect
from contextlib import nullcontext
from itertools import pairwise
from types import SimpleNamespace

import pytest
from support.net import REQUEST

from spots.errors import NoReplyError
from spots.link.link import Link
from spots_net.answers import Answers
from spots_net.ros2.types import REPLY, store
from spots_net.zenoh_link import ZenohLink


class Query(nullcontext):
    payload, attachment = REQUEST["payload"], REQUEST["attachment"]
    parameters = key_expr = ""

    def __init__(self, reply):
        super().__init__()
        self.reply = reply


@pytest.fixture
def clock():
    return SimpleNamespace(s=0.0)


@pytest.fixture
def answers_of(clock):
    """Return a function that creates the `Answers` of a board with the simulated `clock`.

    Its argument is the function `command` of the board. It returns the `Answers`, and a list of the
    functions that handle queries.
    """

    def of(command):
        board = SimpleNamespace(
            now_s=lambda: clock.s, command=command, stats=SimpleNamespace(restarts=0)
        )
        declared = []
        node = SimpleNamespace(service=lambda topic, note: declared.append(note))
        return Answers(board, "spots_a1", node), declared

    return of


def test_a_board_that_does_not_answer_is_asked_a_tenth_of_the_time(clock, answers_of):
    def command(line, timeout_s):
        clock.s += timeout_s
        raise NoReplyError("no reply")

    answers, declared = answers_of(command)
    said = []

    def reply(key, data, **options):
        said.append(store().deserialize_cdr(data, REPLY))

    busy_s = 0.0
    for _ in range(3000):
        for note in declared:
            note(Query(reply))
        began_s = clock.s
        answers.give()
        busy_s += clock.s - began_s
        clock.s += 0.01
    assert (said[0].success, said[0].message) == (False, '{"re":"hello","error":"no reply"}')
    assert busy_s < 0.15 * clock.s


@pytest.mark.board
def test_a_flood_of_questions_takes_a_tenth_of_the_time_from_the_readings(clock, answers_of):
    def reply(key, data, **options):
        clock.s += 50e-6

    commands, rounds_s, began_s = [], [], 0.0
    answers, declared = answers_of(lambda line, timeout_s: commands.append(line) or {"re": line})
    while clock.s < 10.0:
        for i in range(400):  # in each 10 ms
            declared[i % len(declared)](Query(reply))
        began_s = clock.s
        answers.give()
        rounds_s.append(clock.s - began_s)
        clock.s = began_s + max(0.01, clock.s - began_s)
    assert 0.01 < sum(rounds_s) / clock.s < 0.12
    assert max(rounds_s) < 0.05
    assert len(commands) < 3 * 10.0 / 0.05  # caused by 400,000 queries


def test_a_slow_machine_answers_within_a_second_or_two(clock, answers_of):
    def slow_reply(key, data, **options):
        clock.s += 3.0
        at_s.append(clock.s)

    at_s = []
    answers, declared = answers_of(lambda line, timeout_s: {"re": line})
    for _ in range(1000):
        for note in declared:
            note(Query(slow_reply))
        answers.give()
        clock.s += 0.1
    assert max(later - one for one, later in pairwise(at_s)) < 3.0 + 1.5


def test_a_link_from_afar_has_all_that_a_link_has():
    methods = {name for name, _ in inspect.getmembers(Link, inspect.isfunction) if name[0] != "_"}
    assert methods <= set(dir(ZenohLink))
