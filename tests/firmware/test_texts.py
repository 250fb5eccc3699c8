"""Texts and macros: all steps in their order, then the keys typed meanwhile; an end at any time."""

import random
from pathlib import Path

import pytest
from support.engine_bench import Bench

from spots.keyboard.layout import compiled
from spots_device.keys import layout as layouts

FOUR = (0.125, 0.375, 0.625, 0.875)  # middles of four keys


def bench(keys, more="", tuning="", keyboard=None):
    file = f'name = "x"\nhost = "us"\n[tuning]\n{tuning}\n[[layer]]\nname = "a"\nkeys = [{keys}]\n'
    return Bench(compiled(Path("x"), file + more).lines, keyboard)


def spaced(text):
    return text.replace("<00 SPACEBAR>", " ")


def wait(made, ms=3000):
    made.at(made.ms + ms)
    return spaced(made.keyboard.text())


def random_text(chosen, length):
    return "".join(chosen.choices("abcXYZ 12!?.,-_aa", k=length))


def test_a_text_of_all_steps_comes_out_beside_keys_that_are_typed_meanwhile():
    chosen = random.Random(1)
    text = random_text(chosen, layouts.STEPS_MAX)
    made = bench(f'{{text = "{text}"}}, "F1", "F2", "F3"')
    made.tap("t", FOUR[0])
    typed = ""
    for _ in range(14):  # one every 0.12 s: as 100 words a minute, while the text takes longer
        i = chosen.randint(1, 3)
        made.tap("f", FOUR[i], 50)
        made.at(made.ms + 70)
        typed += f"<00 F{i}>"
    assert made.engine._types()
    assert wait(made, 40_000) == text + typed
    presses = [event for event in made.events if event[3]]
    assert len(presses) == layouts.STEPS_MAX + 14


def test_a_step_waits_for_room_in_the_outbox():
    made = bench('{text = "hello world, how are you"}, "B", "C", "D"')
    made.keyboard.takes = False
    made.tap("t", FOUR[0])
    made.at(made.ms + 400)
    assert made.keyboard.keys.outbox.count <= 12
    made.keyboard.takes = True
    assert wait(made) == "hello world, how are you"


@pytest.mark.parametrize("how", ["release", "forget"])
def test_a_text_that_is_ended_at_100_random_moments_leaves_no_key_down(how):
    chosen = random.Random(2)
    for _ in range(100):
        made = bench('{text = "Hello World, How Are You?"}, "LEFT_SHIFT", "C", "D"')
        made.press("held", FOUR[1])
        made.tap("t", FOUR[0])
        made.at(made.ms + chosen.randint(0, 60))
        made.keyboard.takes = chosen.random() < 0.5
        made.at(made.ms + chosen.randint(0, 60))
        getattr(made.engine, how)()
        if how == "release":
            made.keyboard.keys.release()
            made.keyboard.computer.release()
        else:
            made.release("held")
        made.keyboard.takes = True
        before = spaced(made.keyboard.computer.text)
        made.at(made.ms + 500)
        made.keyboard.pump()
        assert not any(made.keyboard.reports[-1])
        assert not made.keyboard.computer.down
        assert spaced(made.keyboard.computer.text) == before
        assert "Hello World, How Are You?".startswith(before)
        assert made.keyboard.merger.down == made.keyboard.merger._wanted() == 0


@pytest.mark.parametrize("after", range(10))
def test_an_interrupt_within_a_step_leaves_no_key_down(after):
    made = bench('{text = "Ab!"}, "B", "C", "D"')
    usage, calls = made.usage, iter(range(100))

    def fails(*event):
        usage(*event)
        if next(calls) == after:
            raise KeyboardInterrupt

    made.usage = fails
    made.press("t", FOUR[0])
    with pytest.raises(KeyboardInterrupt):
        made.at(200)
    made.usage = usage
    made.engine.release()
    assert not made.keyboard.computer.down
    assert made.keyboard.merger.down == made.keyboard.merger._wanted() == 0
    assert not any(made.keyboard.merger._counts)


def test_dropped_reports_end_the_text():
    made = bench('{text = "hello world"}, "B", "C", "D"')
    made.press("t", FOUR[0])
    made.at(made.ms + 30)
    made.keyboard.merger.drops += 1
    made.release("t")
    made.tap("b", FOUR[1])
    assert wait(made) == "helb"


def test_waits_take_their_time_and_media_keys_their_modifiers():
    made = bench(
        '{macro = ["a", "wait 3000", "LEFT_SHIFT+VOL_UP", "b", "wait 500"]}, "C", "D", "E"'
    )
    made.tap("t", FOUR[0])
    made.at(1000)
    made.tap("c", FOUR[1])
    made.at(2900)
    assert made.keyboard.computer.text == "a"
    made.at(3200)
    assert made.keyboard.computer.text == "a<02 VOLUME_INCREMENT>b"
    made.at(3490)
    assert made.keyboard.computer.text == "a<02 VOLUME_INCREMENT>b"
    made.at(4000)
    made.keyboard.pump()
    assert made.keyboard.computer.text == "a<02 VOLUME_INCREMENT>bc"


def test_modifiers_that_a_finger_holds_do_not_change_a_text():
    made = bench('{text = "ab"}, "LEFT_SHIFT", "C", "D"')
    made.press("s", FOUR[1])
    made.tap("t", FOUR[0])
    made.at(made.ms + 300)
    made.tap("c", FOUR[2])
    made.release("s")
    assert wait(made) == "abC"


CASES = {
    # A tap that is decided by the next key, which then follows its text.
    '{tap = "text abc", double = "F1"}, "D", "E", "F"': ((0, 1), "abcd"),
    '{tap = "text abc", hold = "F1"}, "D", "E", "F"': ((0, 1), "abcd"),
    '"tap_dance x", "D", "E", "F"': ((0, 1, 0, 0), "abcdxyz"),
    # A text is a key for what comes with the next key.
    '"sticky LEFT_SHIFT", {text = "ab"}, "D", "E"': ((0, 1, 2), "abd"),
    '"sticky b", "D", "E", "F"': ((0, 1, 1), "xyzd"),
    '{text = "ab"}, "key_repeat", "D", "E"': ((0, 1, 2, 1), "ababdd"),
    '{text = "ab"}, {text = "cd"}, "D", "E"': ((0, 1, 0), "abcdab"),
}
MORE = """
[[layer]]
name = "b"
keys = ["D", "text xyz", "E", "F"]
"""
DANCE = """
[tap_dance.x]
actions = ["text abc", "text xyz"]
"""


@pytest.mark.parametrize("keys", CASES)
@pytest.mark.parametrize("pause_ms", [20, 400])
def test_texts_beside_other_behaviours_keep_their_order(keys, pause_ms):
    touched, text = CASES[keys]
    made = bench(keys, MORE if "sticky b" in keys else DANCE if "dance" in keys else "")
    if "dance" in keys and pause_ms > 250:
        text = "abcdabcabc"
    for i in touched:
        made.tap("f", FOUR[i], 40)
        made.at(made.ms + pause_ms)
    assert wait(made) == text


def test_a_slide_types_its_text_once_for_each_step():
    made = bench('{tap = "A", slide_plus = "text xy"}, "B"', tuning="slide_um = 4000")
    made.press("f", 0.1)
    made.at(50)
    made.move("f", 0.19)
    made.at(400)
    made.move("f", 0.19)
    made.at(800)
    made.release("f")
    assert wait(made) == "xyxy"


LINES = ["text 4 5", "behaviour 0 7 0 2", "layer 0 0", "key 0 1000 5242880 0 0 0 0 0"]


@pytest.mark.parametrize(
    "change",
    [
        {0: "text 4 65536"},
        {0: "text"},
        {0: "text 4 239"},  # no such usage
        {1: "behaviour 0 7 0 3"},
        {1: "behaviour 0 7 2 1"},
        {1: "behaviour 0 7 0 0"},
        {0: "\n".join(["text 4"] * 1025)},
    ],
)
def test_a_board_refuses_steps_that_it_cannot_type(change):
    assert list(layouts.parse(LINES).steps) == [4, 5]
    lines = [change.get(i, line) for i, line in enumerate(LINES)]
    with pytest.raises(layouts.LayoutError):
        layouts.parse("\n".join(lines).split("\n"))


def test_a_layout_of_texts_opens_the_pages_that_they_use():
    assert layouts.parse(LINES).pages == (layouts.KEYBOARD,)
    assert layouts.parse(["text 4 " + str(0xE9 << 8 | 0xE8), *LINES[1:]]).pages == (7, 12)


def test_more_steps_than_a_board_has_room_for_are_refused():
    bench(f'{{text = "{"a" * 1024}"}}')
    with pytest.raises(Exception, match=r"press 1025 keys.*room for 1024: shorten"):
        bench(f'{{text = "{"a" * 1024}"}}, "text b"')
