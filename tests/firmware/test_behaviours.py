"""What switches do: layers, sticky keys, tap dance, mod-morph and others; no key is lost."""

from pathlib import Path

import pytest
from support.engine_bench import Bench

from spots.keyboard.layout import compiled


def bench(text, **tuning):
    """Return a `Bench` with a layout: `text` is the part of the file after its name."""
    settings = "".join(f"{name} = {value!r}\n" for name, value in tuning.items())
    file = f'name = "x"\n[tuning]\n{settings}{text}'
    return Bench(compiled(Path("x"), file).lines)


def layer(*keys, name="a", more=""):
    """Return a layer of a file; a key is a name of an action or a table."""
    written = ", ".join(key if key.startswith("{") else f'"{key}"' for key in keys)
    return f'[[layer]]\nname = "{name}"\n{more}\nkeys = [{written}]\n'


def play(made, *events):
    """Play events such as ``0d1`` (at 0 ms, down, switch 1); ``f`` is firm, ``s`` is a slide.

    There are four keys side by side. Returns what the computer saw.
    """
    for event in events:
        at = next(i for i, one in enumerate(event) if one.isalpha())
        made.at(int(event[:at]))
        switch, _, to = event[at + 1 :].partition(">")
        share = (int(switch) + 0.5) / 4
        if event[at] == "d":
            made.press(switch, share)
        elif event[at] == "u":
            made.release(switch)
        elif event[at] == "f":
            made.firm(switch)
        else:
            made.move(switch, float(to))
    made.at(made.ms + 3000)
    made.keyboard.text()  # nothing stays pressed
    return " ".join(made.keyboard.computer.log)


SHIFT = '{tap = "F", hold = "LEFT_SHIFT"}'


def test_keys_that_are_pressed_while_a_key_is_undecided_all_follow():
    made = bench(layer(SHIFT, "B", "C", "D"), tapping_term_ms=800, flavor="tap-preferred")
    log = play(made, "0d0", "100d1", "150u1", "200d2", "250u2", "300d1", "350u1", "400u0")
    # All at once: the next key does not wait until the tapped one is up.
    assert log == "+F +B +C -B +B -F -C -B"
    made = bench(layer(SHIFT, "B", "C", "D"), tapping_term_ms=300, flavor="tap-preferred")
    log = play(made, "0d0", "100d1", "150u1", "200d2", "250u2", "400u0")
    assert log == "+LEFT_SHIFT +B +C -C -B -LEFT_SHIFT"


def test_more_events_than_the_queue_has_places_lose_no_release():
    made = bench(layer(SHIFT, "B", "C", "D"), tapping_term_ms=9000, flavor="tap-preferred")
    events = [f"{100 + 20 * i}{'du'[i % 2]}1" for i in range(40)]
    log = play(made, "0d0", *events, "2000u0").split()
    assert log.count("+B") == log.count("-B") >= 4
    assert log[0] == "+F"


def test_two_hold_taps_are_decided_one_after_the_other():
    other = '{tap = "J", hold = "LEFT_CONTROL"}'
    made = bench(layer(SHIFT, other, "C", "D"), tapping_term_ms=300)
    # The second key waits until the first one is a hold; its own time is over then, too.
    assert play(made, "0d0", "100d1", "450u1", "500u0") == (
        "+LEFT_SHIFT +LEFT_CONTROL -LEFT_CONTROL -LEFT_SHIFT"
    )


def test_a_key_that_is_found_late_has_the_time_of_its_first_light():
    made = bench(layer(SHIFT, "B", "C", "D"), tapping_term_ms=300, flavor="hold-preferred")
    made.press("0", 0.1)
    made.at(290)
    made.press("1", 0.4, ago_ms=40)
    made.release("0")
    made.release("1")
    made.at(1000)
    assert made.keyboard.computer.log[0] == "+LEFT_SHIFT"
    made = bench(layer(SHIFT, "B", "C", "D"), tapping_term_ms=300, flavor="tap-unless-interrupted")
    made.press("0", 0.1)
    for switch, ago_ms in (("1", 0),):  # after the term: the end of the term decides first
        made.ms = 320
        made.press(switch, 0.4, ago_ms=ago_ms)
    assert made.keyboard.computer.log == ["+F", "+B"]


def test_another_key_decides_a_key_without_a_hold():
    for key in ('{tap = "A", firm = "F1"}', '{tap = "A", slide_plus = "F1"}'):
        made = bench(layer(key, "B", "C", "D"), firm_ms=500)
        assert play(made, "0d0", "50d1", "100u1", "700u0") == "+A +B -B -A"


def test_a_firm_press_decides_before_another_key_and_the_time():
    key = '{tap = "A", hold = "LEFT_SHIFT", firm = "F1"}'
    made = bench(layer(key, "B", "C", "D"), flavor="tap-preferred")
    assert play(made, "0d0", "50f0", "60d1", "90u1", "700u0") == "+F1 +B -B -F1"
    made = bench(layer("D", key, "C", "B"), flavor="tap-preferred")
    # The firm press of a key that waits itself.
    assert play(made, "0d1", "20u1", "300d1", "320d2", "360u1", "400u2") == "+A -A +A +C -A -C"


def test_a_swipe_decides_before_a_slide_and_a_hold():
    key = '{tap = "A", hold = "LEFT_SHIFT", slide_plus = "F1"}'
    made = bench(layer(key, "B", "C", "D", more='swipe_plus = "F2"'), tapping_term_ms=400)
    assert play(made, "0d0", "40s0>0.3", "80s0>0.5", "600u0") == "+F2 -F2"
    assert play(made, "9000d0", "9300s0>0.3", "9700u0").startswith("+F2 -F2 +F1 -F1")


def test_layers_are_momentary_toggled_or_left():
    text = layer("momentary b", "toggle b", "to b", "A") + layer(
        "X", "toggle b", "to a", "B", name="b"
    )
    assert play(bench(text), "0d0", "50d3", "90u3", "120u0", "200d3", "250u3") == "+B -B +A -A"
    assert play(
        bench(text), "0d1", "50u1", "100d3", "150u3", "200d1", "250u1", "300d3", "350u3"
    ) == ("+B -B +A -A")
    assert play(
        bench(text), "0d2", "50u2", "100d3", "150u3", "200d2", "250u2", "300d3", "350u3"
    ) == ("+B -B +A -A")
    # The key that is pressed on a layer is released, whatever layer is on.
    assert play(bench(text), "0d0", "50d3", "90u0", "120u3") == "+B -B"


def test_keys_with_more_than_a_tap_work_on_every_layer():
    keys = ('{tap = "C", hold = "D"}', '{tap = "E", firm = "F"}', '{tap = "G", double = "H"}')
    text = layer("momentary b", "A", "A", "A") + layer(
        "Z", *keys, name="b", more='swipe_plus = "S"'
    )
    held = bench(text, tapping_term_ms=300)
    assert play(held, "0d0", "10d1", "90u1", "200u0") == "+C -C"
    assert play(held, "9000d0", "9010d1", "9500u1", "9600u0").endswith("+D -D")
    assert play(held, "19000d0", "19010d2", "19050f2", "19100u2", "19600u0").endswith("+F -F")
    log = play(held, "29000d0", "29010d3", "29060u3", "29100d3", "29150u3", "29600u0")
    assert log.endswith("+H -H")
    log = play(held, "39000d0", "39010d1", "39060s1>0.7", "39100u1", "39600u0")
    assert log.endswith("+S -S")


def test_a_sticky_layer_has_double_taps_and_held_taps():
    keys = ("Z", '{tap = "C", hold = "D"}', '{tap = "G", double = "H"}', "I")
    text = layer("sticky b", "1", "2", "3") + layer(*keys, name="b")
    assert play(bench(text), "0d0", "50u0", "300d3", "350u3", "500d3", "550u3") == (
        "+I -I +THREE -THREE"
    )
    assert play(bench(text), "0d0", "50u0", "300d2", "350u2", "400d2", "450u2") == "+H -H"
    assert play(
        bench(text), "0d0", "50u0", "300d1", "350u1", "400d1", "900u1", "1200d1", "1250u1"
    ) == ("+C -C +C -C +ONE -ONE")
    # Held, it is a momentary layer.
    assert play(
        bench(text), "0d0", "50d3", "90u3", "100d3", "150u3", "400u0", "500d3", "550u3"
    ) == ("+I -I +I -I +THREE -THREE")


def test_sticky_modifiers_combine_and_end_with_the_next_key():
    text = layer("sticky LEFT_SHIFT", "sticky LEFT_CONTROL", "A", "B")
    log = play(bench(text), "0d0", "50u0", "200d1", "250u1", "400d2", "500u2", "600d3", "650u3")
    down, _, up = log.partition("+A ")
    assert down == "+LEFT_SHIFT +LEFT_CONTROL "
    assert sorted(up.split()[:2]) == ["-LEFT_CONTROL", "-LEFT_SHIFT"]
    assert up.split()[2:] == ["-A", "+B", "-B"]
    timed = bench(text, release_after_ms=1000)
    log = play(timed, "0d0", "50u0", "1200d2", "1250u2")
    assert log == "+LEFT_SHIFT -LEFT_SHIFT +A -A"


def test_a_rolled_key_after_a_sticky_modifier_is_not_shifted():
    text = layer("sticky LEFT_SHIFT", "C", "A", "B")
    made = bench(text)
    play(made, "0d0", "50u0", "100d2", "130d3", "160u2", "190u3")
    assert made.keyboard.computer.text == "Ab"


DANCE = (
    layer("tap_dance x", "C", "D", "E") + '[tap_dance.x]\nactions = ["A", "LEFT_SHIFT+A", "B"]\n'
)


@pytest.mark.parametrize(
    ("events", "text"),
    [
        (["0d0", "50u0"], "a"),
        (["0d0", "500u0"], "a"),
        (["0d0", "50u0", "100d0", "150u0"], "A"),
        (["0d0", "50u0", "100d0", "150u0", "200d0", "250u0"], "b"),
        (["0d0", "50u0", "100d0", "150u0", "200d0", "250u0", "300d0", "350u0"], "ba"),
        (["0d0", "50u0", "300d0", "350u0"], "aa"),
        (["0d0", "50u0", "80d1", "120u1"], "ac"),
        (["0d0", "50d1", "90u1", "200u0"], "ac"),
        (["0d0", "50u0", "100d0", "150d2", "190u2", "230u0"], "Ad"),
    ],
)
def test_a_tap_dance_counts_taps(events, text):
    made = bench(DANCE)
    play(made, *events)
    assert made.keyboard.computer.text == text


MORPH = """[mod_morph.x]
action = "A"
morphed = "B"
mods = ["LEFT_SHIFT"]
"""


@pytest.mark.parametrize("term_ms", [250, 300])
def test_a_hold_that_is_decided_before_the_swipe_ends_leaves_no_slide(term_ms):
    # `spots keys check` finds the first case: no movement at any time is a slide.
    key = '{tap = "A", hold = "LEFT_SHIFT", slide_plus = "F1"}'
    text = layer(key, "B", "C", "D", more='swipe_plus = "F2"')
    seen = set()
    for ms in range(20, 400, 10):
        made = bench(text, tapping_term_ms=term_ms)
        seen |= set(play(made, "0d0", f"{ms}s0>0.23", "900u0").split())
    assert ("+F1" in seen) == (term_ms > 250)
    assert bool(
        compiled(Path("x"), f'name = "x"\n[tuning]\ntapping_term_ms = {term_ms}\n{text}').problems
    ) == (term_ms == 250)


def test_a_double_tap_hides_the_second_tap_of_a_dance():
    dance = '[tap_dance.x]\nactions = ["A", "B"]\ntapping_term_ms = %d\n'
    for term_ms in (250, 500):
        text = layer('{tap = "tap_dance x", double = "F"}', "C", "D", "E") + dance % term_ms
        seen = set()
        for between_ms in range(60, 600, 10):
            made = bench(text)
            events = "0d0", "40u0", f"{40 + between_ms}d0", f"{80 + between_ms}u0"
            seen |= set(play(made, *events).split())
        assert ("+B" in seen) == (term_ms > 250)
        assert bool(compiled(Path("x"), f'name = "x"\n{text}').problems) == (term_ms == 250)


def test_a_key_with_a_retro_tap_is_a_hold_only_beside_another_key():
    for flavor in ("balanced", "tap-preferred"):
        key = f'{{tap = "F", hold = "LEFT_SHIFT", retro_tap = true, flavor = "{flavor}"}}'
        text = layer(key, "B", "C", "D")
        assert play(bench(text), "0d0", "900u0") == "+F -F"
        assert (
            play(bench(text), "0d0", "900d1", "950u1", "990u0") == "+LEFT_SHIFT +B -B -LEFT_SHIFT"
        )
        # A key that waits at the end of the term makes it a hold at once.
        made = bench(text)
        made.press("0", 0.1)
        made.at(150)
        made.press("1", 0.4)
        made.at(300)
        assert made.keyboard.computer.log == ["+LEFT_SHIFT", "+B"]


def test_the_last_tap_of_a_dance_may_be_held_too():
    text = layer("tap_dance x", "C", "D", "E") + (
        '[tap_dance.x]\nactions = ["A", "B"]\nholds = ["", "LEFT_SHIFT"]\n'
    )
    assert play(bench(text), "0d0", "900u0") == "+A -A"  # no hold after one tap
    assert play(bench(text), "0d0", "50u0", "90d0", "140u0") == "+B -B"
    log = play(bench(text), "0d0", "50u0", "90d0", "900d1", "950u1", "990u0")
    assert log == "+LEFT_SHIFT +C -C -LEFT_SHIFT"
    # Another key before the time ends: the key is its tap.
    assert play(bench(text), "0d0", "50u0", "90d0", "120d1", "150u1", "990u0") == "+B +C -C -B"


def test_a_mod_morph_hides_its_modifier_unless_that_is_kept():
    text = layer("LEFT_SHIFT", "mod_morph x", "C", "D")
    made = bench(text + MORPH)
    play(made, "0d1", "50u1", "100d0", "150d1", "200u1", "250d2", "300u2", "350u0")
    assert made.keyboard.computer.text == "abC"
    made = bench(text + MORPH + 'keep_mods = ["LEFT_SHIFT"]\n')
    play(made, "100d0", "150d1", "200u1", "350u0")
    assert made.keyboard.computer.text == "B"


def test_key_repeat_presses_the_last_key_with_its_modifiers():
    text = layer("key_repeat", "LEFT_SHIFT+1", "A", "LEFT_CONTROL")
    made = bench(text)
    play(
        made, "0d0", "50u0", "100d1", "150u1", "200d0", "250u0", "300d2", "350u2", "400d0", "450u0"
    )
    assert made.keyboard.computer.text == "!!aa"
    play(made, "9000d3", "9050d2", "9100u2", "9150u3", "9200d0", "9250u0")
    assert made.keyboard.computer.text.endswith("<01 A><01 A>")


def test_caps_word_ends_with_the_word():
    text = layer("caps_word", "A", "1", "SPACEBAR")
    made = bench(text)
    taps = [0, 1, 2, 1, 3, 1, 0, 1, 0, 1]
    play(
        made,
        *[f"{100 * i + 50 * up}{'du'[up]}{key}" for i, key in enumerate(taps) for up in (0, 1)],
    )
    assert made.keyboard.computer.text == "A1A<00 SPACEBAR>aAa"


def test_a_layout_that_is_used_again_keeps_its_behaviours_but_ends_the_caps_word():
    made = bench(layer("caps_word", "sticky LEFT_SHIFT", "A", "B"))
    engine = made.engine
    kept = engine.caps, engine._sticky
    made.tap("0", 0.1)
    made.tap("1", 0.4)
    engine.set_layout(engine.layout, 1000 * engine._length_mm)
    assert (engine.caps, engine._sticky) == kept
    made.tap("2", 0.6)
    made.at(made.ms + 3000)
    assert made.keyboard.text() == "a"


def test_a_busy_host_delays_keys_and_loses_none():
    made = bench(layer("A", "B", "C", "D"))
    made.keyboard.takes = False
    for _ in range(10):
        made.tap("0", 0.1, 10)
    assert not made.has_room()
    made.keyboard.takes = True
    made.at(made.ms + 500)
    assert made.keyboard.text() == 10 * "a"


def test_silence_drops_what_waits_for_a_next_key():
    text = layer("sticky LEFT_SHIFT", '{tap = "A", double = "B"}', "tap_dance x", "D")
    made = bench(text + '[tap_dance.x]\nactions = ["E", "F"]\n')
    for switch in "012":
        made.tap(switch, (int(switch) + 0.5) / 4)
        made.engine.forget()
        made.at(made.ms + 2000)
    made.tap("3", 0.9)
    assert made.keyboard.text() == "d"
