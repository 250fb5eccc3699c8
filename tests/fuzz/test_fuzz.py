"""Runs each fuzz target with stored inputs, and with inputs that hypothesis makes from them."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import desk
import kept
from spots.link.frames import Text, Touch
from spots_device.board.command import LINE_MAX
from targets import TARGETS, run

INPUTS = {name: kept.kept(name) for name in TARGETS}


@pytest.mark.board
@pytest.mark.parametrize("name", TARGETS)
def test_what_was_kept(name):
    assert INPUTS[name]
    for title, data in INPUTS[name].items():
        try:
            run(name, data)
        except Exception as error:
            raise AssertionError(f"{title} breaks {name}") from error


@st.composite
def changed(draw, inputs):
    """Return random pieces of several stored inputs, joined by random bytes."""
    data = b""
    for _ in range(draw(st.integers(1, 3))):
        whole = draw(st.sampled_from(inputs))
        begin = draw(st.integers(0, len(whole)))
        data += draw(st.binary(max_size=6))
        data += whole[begin : draw(st.integers(begin, len(whole)))] if data else whole[:begin]
    return data


@pytest.mark.parametrize("flood", [b"x" * 5000, b"hello\n" * 20])
def test_a_flood_lets_readings_have_their_turn(flood):
    board = desk.Board()
    board.hear(b"stream touch\n")
    board.said()
    board.hear(flood)
    said = board.said()
    replies = sum(isinstance(frame, Text) for frame in said)
    assert sum(isinstance(frame, Touch) for frame in said) >= max(replies, 5000 // LINE_MAX // 2)


@pytest.mark.board
@pytest.mark.parametrize("name", TARGETS)
def test_any_bytes(name):
    # Derandomized, so that each run tests the same bytes; `make fuzz` uses random bytes.
    @settings(max_examples=25, derandomize=True)
    @given(st.one_of(st.binary(max_size=200), changed([*INPUTS[name].values()])))
    def check(data):
        run(name, data)

    check()


@pytest.mark.parametrize(("name", "good"), [("recording", "whole"), ("layout_toml", "mini")])
def test_a_target_can_fail(name, good, monkeypatch):
    import targets

    monkeypatch.setattr(targets, "_draw", lambda picture: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        run(name, INPUTS[name][good])
