"""Layouts on a board: only completely valid layouts are accepted; errors are a sentence."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.keys import key, letter

from spots_device.fingers.tracker import elapsed
from spots_device.keys.layout import (
    CONSUMER,
    KEY_SIZE,
    LAYERS_MAX,
    LIMITS,
    TOGGLE,
    LayoutError,
    action,
    default_lines,
    parse,
)

SOUND = ["layer 0 0", key(0, 500, letter(4)), key(500, 1000, action(CONSUMER, 0xE9))]


def test_what_is_left_out_is_the_default_and_milliseconds_become_ticks():
    layout = parse(["tapping_term_ms 1024", *SOUND])
    assert layout.tapping_term_t == 1000
    assert layout.quick_tap_t == LIMITS["quick_tap_ms"][2] * 1000 // 1024
    assert layout.detect == LIMITS["detect"][2]
    assert layout.pages == (7, 12)
    assert (layout.first(0), layout.first(1)) == (0, 2 * KEY_SIZE)


@pytest.mark.parametrize(
    ("lines", "why"),
    [
        ([], "1 to 128 keys"),
        (["layer 0 0"], "1 to 128 keys"),
        ([key(0, 10, 0)], "keys must ascend"),
        ([*SOUND, key(900, 950)], "keys must ascend"),
        (["layer 0 0", key(0, 1001)], "keys must ascend"),
        (["layer 0 0", key(5, 5)], "keys must ascend"),
        (["layer 0 0", "key 0 10"], "needs 8 whole numbers"),
        (["layer 0 0", "key 0 10 x 0 0 0 0 0"], "needs 8 whole numbers"),
        (["layer 0 0", "key 0 10 -1 0 0 0 0 0"], "needs 8 whole numbers"),
        (["layer 0"], "needs 2 whole numbers"),
        (["detect 0", *SOUND], "'detect' must be from 1 to 8"),
        (["speed 1", *SOUND], "unknown statement 'speed'"),
        (["layer 0 0", key(0, 10, action(10, 1))], "is invalid"),
        (["layer 0 0", key(0, 10, letter(0))], "is invalid"),
        (["layer 0 0", key(0, 10, letter(0xE8))], "is invalid"),
        (["layer 0 0", key(0, 10, action(TOGGLE, 1))], "is invalid"),
        (["layer 5 0", key(0, 10)], "is invalid"),
        (SOUND * (LAYERS_MAX + 1), "8 layers"),
        (["layer 0 0", *[key(i, i + 1) for i in range(129)]], "1 to 128 keys"),
    ],
)
def test_an_unsound_layout_is_refused(lines, why):
    with pytest.raises(LayoutError, match=why):
        parse(lines)


@given(st.lists(st.text(max_size=40), max_size=5), st.integers(0, 12))
def test_no_line_breaks_it(lines, at):
    whole = [*default_lines()]
    whole[at:at] = lines
    try:
        parse(whole)
    except LayoutError:
        pass


@given(st.integers(0, (1 << 22) - 1), st.integers(0, (1 << 21)))
def test_time_wraps(since, duration):
    assert elapsed(since, (since + duration) % (1 << 22)) == duration
