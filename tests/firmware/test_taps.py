"""How long a computer sees a tapped key, and what else is pressed meanwhile.

Other tests of keys play the engine without time between two readings, so a key that is down for
1 ms, or a modifier that returns while its text runs, passes them.
"""

from pathlib import Path

import pytest
from support.engine_bench import Bench

from spots.keyboard.layout import compiled
from spots.keyboard.trial import Touch, played
from spots.outputs.usages import name_of

CAPS_LOCK = 0x39
TAPS = {
    '{tap="CAPS_LOCK", hold="LEFT_CONTROL"}': "",
    '{tap="CAPS_LOCK", double="F1"}': "",
    '{tap="CAPS_LOCK", firm="F1"}': "",
    '{tap="tap_dance d"}': "[tap_dance.d]\nactions=['CAPS_LOCK', 'F1']\n",
    '{tap="mod_morph m"}': "[mod_morph.m]\naction='CAPS_LOCK'\nmorphed='F1'\nmods=['LEFT_SHIFT']\n",
    '{tap="A", slide_plus="CAPS_LOCK"}': "",
    '{macro=["CAPS_LOCK"]}': "",
    '{macro=["wait 50", "CAPS_LOCK", "wait 50"]}': "",
    '"CAPS_LOCK"': "",
}


def layout(keys, more="", system="mac", tuning=""):
    head = f'name = "x"\nhost = "us"\nos = "{system}"\n[tuning]\n{tuning}\n'
    return compiled(Path("x"), f'{head}[[layer]]\nname = "a"\nkeys = [{keys}]\n{more}').lines


def spans(lines, touches):
    return played(lines, touches, 2500, lambda page, usage, bits: (bits, name_of(page, usage)))


@pytest.mark.parametrize("key", TAPS)
@pytest.mark.parametrize(("system", "least_ms"), [("mac", 100), ("linux", 20)])
def test_a_tap_lasts_long_enough_for_the_computer(key, system, least_ms):
    slide = 0.05 if "slide" in key else 0
    shift = ', "LEFT_SHIFT"' if "morph" in key else ', "B"'
    found = spans(layout(key + shift, TAPS[key], system), [Touch(0.25, 0, 12, None, slide)])
    (span,) = (one for one in found if one.what[1] == "CAPS_LOCK")
    assert least_ms <= span.end_ms - span.begin_ms <= least_ms + 3


def test_a_tapped_key_delays_no_other_key_and_a_tapped_modifier_is_not_for_it():
    keys = '{tap = "F1", hold = "LEFT_CONTROL"}, {tap = "LEFT_SHIFT", hold = "LEFT_ALT"}, "A", "B"'
    touches = [
        Touch(0.125, 0, 40),
        Touch(0.375, 41, 60),
        Touch(0.625, 61, 90),
        Touch(0.875, 62, 90),
    ]
    for ms in (0, 1000):
        found = spans(layout(keys, tuning=f"tap_ms = {ms}"), touches)
        assert [one.begin_ms for one in found] == [40, 60, 61, 62]
        assert [one.what for one in found][2:] == [(0, "A"), (0, "B")]


def test_no_key_is_lost_beside_tapped_keys_that_are_still_down():
    keys = ", ".join(f'{{tap = "{one}", hold = "LEFT_CONTROL"}}' for one in "ABCDEFGHIJ")
    touches = [Touch(0.05 + 0.1 * i, 20 * i, 20 * i + 10) for i in range(10)]
    found = spans(layout(keys, tuning="tap_ms = 1000"), touches)
    assert [one.what[1] for one in found] == list("ABCDEFGHIJ")
    assert all(one.end_ms > one.begin_ms for one in found)


def test_nothing_outlives_a_clock_that_restarts():
    # A board has restarted: a host gets the time of its new clock.
    for key in ('{tap = "F1", hold = "F2"}', '{macro = ["F1", "wait 500", "F2"]}', '"F1"'):
        bench = Bench(layout(f'{key}, "B"', tuning="tap_ms = 500"))
        bench.press("f", 0.2)
        bench.at(100)
        if key != '"F1"':
            bench.release("f")
            bench.at(120)
        bench.ms = -5000
        bench.at(-4980)
        if key == '"F1"':
            bench.release("f")
        bench.at(-4900)
        assert bench.keyboard.text() == "<00 F1>"


MORPH = '[mod_morph.m]\naction = "A"\nmorphed = "%s"\nmods = ["LEFT_SHIFT"]\n'
DANCE = "[tap_dance.d]\nactions = [%s]\n"
STARTED = {
    '{tap = "mod_morph m", double = "F1"}': "",
    '{tap = "mod_morph m", hold = "F1"}': "",
    '{tap = "mod_morph m", firm = "F1"}': "",
    '"tap_dance d"': DANCE % '"mod_morph m", "F1"',
}


@pytest.mark.parametrize("key", STARTED)
@pytest.mark.parametrize("morphed", ["text k-l", "DELETE", "key_repeat", "tap_dance e"])
def test_a_morphed_action_is_without_its_modifier_also_after_its_finger(key, morphed):
    more = MORPH % morphed + STARTED[key] + "[tap_dance.e]\nactions = ['DELETE', 'F2']\n"
    touches = [
        Touch(0.1, 0, 40),
        Touch(0.4, 400, 2000),
        Touch(0.7, 600, 640),
        Touch(0.1, 1500, 1540),
    ]
    found = spans(layout(f'"F3", "LEFT_SHIFT", {key}', more), touches)
    pressed = [one.what for one in found if one.what[1] != "LEFT_SHIFT"]
    own = {"text k-l": ["K", "MINUS", "L"], "key_repeat": ["F3"]}.get(morphed, ["DELETE"])
    assert pressed == [(0, "F3"), *((0, name) for name in own), (2, "F3")]


def test_a_modifier_is_hidden_from_the_morphed_key_only():
    keys = '"LEFT_SHIFT", "mod_morph m", "B", "C"'
    touches = [Touch(0.1, 0, 900), Touch(0.4, 100, 500), Touch(0.6, 300, 600)]
    found = spans(layout(keys, MORPH % "DELETE"), touches)
    assert [one.what for one in found][1:] == [(0, "DELETE"), (2, "B")]


def test_the_second_tap_of_a_dance_that_a_click_started_counts():
    key = '{tap = "tap_dance d", double = "F1"}'
    more = DANCE % '"A", "B"' + "tapping_term_ms = 900\n"
    touches = [Touch(0.7, 0, 30), Touch(0.7, 400, 430)]
    assert [one.what[1] for one in spans(layout(f'"F3", "F4", {key}', more), touches)] == ["B"]


class Clocked(Bench):
    """A bench with a reading every millisecond, and the time of each report."""

    def at(self, ms):
        while self.ms < ms:
            self.ms += 1
            self.engine.tick(self.ticks)
            before = len(self.keyboard.reports)
            self.keyboard.pump()
            self.times += [self.ms] * (len(self.keyboard.reports) - before)


def reports(key, until=1500, tuning="text_ms = 30"):
    bench = Clocked(layout(f'{key}, "B"', tuning=tuning))
    bench.times = []
    bench.press("f", 0.2)
    bench.at(10)
    bench.release("f")
    bench.at(until)
    shown = [(one[0], sorted(set(one[2:]) - {0})) for one in bench.keyboard.reports]
    return list(zip(shown, [b - a for a, b in zip(bench.times, bench.times[1:])]))


def test_a_text_has_each_modifier_before_its_key_and_each_key_for_its_time():
    found = reports('{text = "aABba"}')
    down = [(what, ms) for what, ms in found if what != (0, []) and what != (2, [])]
    assert [what for what, _ in down] == [(0, [4]), (2, [4]), (2, [5]), (0, [5]), (0, [4])]
    assert all(ms >= 30 for _, ms in down[:-1])
    assert down[-1][1] >= 20  # tap_ms: the next key of a finger does not wait
    before = [found[i - 1] for i, (what, _) in enumerate(found) if what == (2, [4])]
    assert before[0][0] == (2, [])
    assert before[0][1] >= 30
    (gone,) = (ms for (what, ms), (after, _) in zip(found, found[1:]) if after == (0, [5]))
    assert gone >= 30  # shift is up before the next key
    assert all(ms >= 30 for what, ms in reports('{text = "ll"}')[:-1])


def test_a_macro_holds_keys_until_it_releases_them_or_ends():
    found = [what for what, _ in reports('{macro = ["press LEFT_ALT", "TAB", "TAB", "ENTER"]}')]
    keys = [what for what in found if what[1]]
    assert keys == [(4, [0x2B]), (4, [0x2B]), (4, [0x28])]
    assert found[0] == (4, [])
    assert found[-1] == (4, [])
    macro = '["press LEFT_SHIFT+F1", "wait 200", "F2", "release F1", "release LEFT_SHIFT", "F3"]'
    held = reports(f"{{macro = {macro}}}")
    assert [what for what, _ in held if what[1]] == [
        (2, [0x3A]),
        (2, [0x3A, 0x3B]),
        (2, [0x3A]),
        (0, [0x3C]),
    ]
    assert held[1][1] >= 200


@pytest.mark.parametrize(
    ("macro", "why"),
    [
        ('"press MUTE"', "needs one key of the keyboard"),
        ('"press A", "press A"', "'press A': the key is down already"),
        ('"release A"', "'release A': the key is not down already"),
        (", ".join(f'"press {one}"' for one in "ABCDEF"), "at most 5 keys"),
    ],
)
def test_a_macro_that_holds_wrongly_is_refused(macro, why):
    with pytest.raises(Exception, match=f"line.*{why}"):
        layout(f"{{macro = [{macro}]}}")
