"""Layout files: compiled to the lines that a board stores; errors name the line and the remedy."""

from pathlib import Path

import numpy as np
import pytest
from support.refusals import refusal

from spots import cli
from spots.errors import FileError, SettingError, SpotsError
from spots.keyboard.keys import say
from spots.keyboard.layout import FOLDER, compiled, load
from spots.outputs.usages import USAGES
from spots_device.keys.layout import (
    HOLD_TAP,
    KEY_SIZE,
    RETRO_TAP,
    TAP,
    action,
    parse,
)
from spots_sim.person.typist import Typist

BUILT_IN = sorted(file.stem for file in FOLDER.glob("*.toml"))


def write(tmp_path, text):
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("name", BUILT_IN)
def test_every_layout_of_the_package_is_one_that_a_board_takes(name, capsys):
    layout = load(name)
    board = parse(layout.lines)
    assert board.layers == len(layout.layers)
    assert len(board.keys) == KEY_SIZE * sum(len(keys) for keys in layout.layers.values())
    assert cli.main(["keys", "check", name]) == 0
    assert "no problem found" in capsys.readouterr().out
    assert cli.main(["keys", "show", name]) == 0
    said = capsys.readouterr().out
    assert layout.name in said
    for keys in layout.layers.values():
        for key in keys:
            assert key.label in said


EVERY_ACTION = """
name = "All"
[[layer]]
name = "base"
swipe_minus = "POWER"
swipe_plus = "toggle more"
keys = [
  {tap = "A", double = "B", hold = "C", firm = "D", slide_minus = "E", slide_plus = "F"%s},
  "G",
]
[[layer]]
name = "more"
swipe_minus = "LEFT_CONTROL+LEFT_ALT+DELETE"
keys = ["to base", {hold = "sticky last"}, {tap = "toggle more"}]
[[layer]]
name = "last"
keys = ["momentary last"]
"""
LABELS = ["", "k", "a label that has more characters than there are columns for it in a table"]


@pytest.mark.parametrize("label", LABELS)
def test_a_layout_is_shown_with_all_its_actions_each_on_one_line(label, tmp_path, capsys):
    path = write(tmp_path, EVERY_ACTION % (label and f', label = "{label}"'))
    layout = load(path)
    stored = [line.split() for line in layout.lines if line.startswith(("layer ", "key "))]
    actions = {int(word) for kind, *words in stored for word in words[2 * (kind == "key") :]}
    assert len(actions - {0}) == 13
    assert cli.main(["keys", "show", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    for number in actions - {0}:
        name = say(layout, number)
        assert any(f" {name} " in line for line in lines), name


def test_no_name_of_a_key_is_broken_at_the_end_of_a_line(tmp_path, capsys):
    names = sorted({usage.name for usage in USAGES.values()}, key=len)[-4:]
    keys = ", ".join(f'{{tap = "{name}", double = "{name}", hold = "{name}"}}' for name in names)
    path = write(tmp_path, f'name = "Long"\n[[layer]]\nname = "base"\nkeys = [{keys}]\n')
    assert cli.main(["keys", "show", str(path)]) == 0
    shown = capsys.readouterr().out
    assert [shown.count(f" {name} ") for name in names] == [3] * len(names)


def test_the_mini_keyboard_has_a_way_to_every_letter_and_digit():
    typist = Typist(load("mini"), 85.0, np.random.default_rng(0))
    typist.type("the quick brown fox jumps over the lazy dog 1234567890,.!?\n")


def test_keys_divide_the_strip_by_their_widths_with_gaps_between_them(tmp_path):
    path = write(
        tmp_path,
        'name = "x"\n[[layer]]\nname = "a"\ngap_percent = 20\n'
        'keys = ["A", {tap = "B", width = 2}, "LEFT_SHIFT+C"]\n',
    )
    layout = load(path)
    keys = layout.layers["a"]
    assert [(key.low, key.high) for key in keys] == [
        pytest.approx(pair) for pair in ((0, 0.225), (0.275, 0.725), (0.775, 1))
    ]
    assert [key.actions["tap"] for key in keys] == [action(7, 4), action(7, 5), action(7, 6, 2)]
    assert say(layout, keys[2].actions["tap"]) == "LEFT_SHIFT+C"
    assert parse(layout.lines).keys[TAP] == action(7, 4)


def test_tuning_is_that_of_the_board(tmp_path):
    path = write(
        tmp_path,
        'name = "x"\n[tuning]\ntapping_term_ms = 512\nflavor = "tap-preferred"\n'
        '[[layer]]\nname = "a"\nkeys = ["A"]\n',
    )
    board = parse(load(path).lines)
    assert (board.tapping_term_t, board.flavor) == (500, 2)


HEAD = 'name = "x"\n[[layer]]\nname = "a"\n'
MISTAKES = {
    'keys = ["A", "ENTRE"]': "line 4: in layer 'a', key 2: there is no key 'ENTRE'.*ENTER",
    'keys = ["LEFT_SHFT+A"]': "line 4: in layer 'a', key 1: there is no key 'LEFT_SHFT'",
    'keys = ["A+B"]': "line 4.*'A' is not a modifier: use one of LEFT_CONTROL",
    'keys = ["A+MUTE"]': "line 4.*'A' is not a modifier",
    'keys = ["usage 7:0xDE"]': "line 4.*a board cannot report 'usage 7:0xDE'",
    'keys = ["text "]': "line 4.*there is no key 'text '",
    'keys = [{macro = ["wait 0"]}]': "key 1: 'wait 0': write 'wait MS', from 1 to 60000",
    'keys = [{macro = ["wait"]}]': "key 1: 'wait ': write 'wait MS'",
    'keys = [{macro = ["key_repeat"]}]': "line 4.*'key_repeat' is no key: a macro has keys, text",
    'keys = [{tap = "A", macro = ["B"]}]': "line 4.*key 1: use one of tap, text and macro",
    'keys = ["macro x"]': r"line 4.*\[macro\] has no 'x': add it",
    'keys = ["A"]\n[macro]\nx = []': "macro.x must be a list of at least 1 entry, not 0",
    'keys = ["toggle b"]': "line 4.*no layer is called 'b'; valid names are a",
    'keys = [{tap = "A", hodl = "B"}]': "line 4.*hodl",
    'keys = ["A", {tap = "B", width = 0}]': "line 4: in layer 'a', key 2: width must be a number",
    'keys = ["A", 3]': "line 4: in layer 'a', key 2: must be text or a table, not a whole number",
    'keys = ["A"]\n[[layer]]\nnaem = "b"': "line 6: in layer 2: unknown key 'naem'",
    'keys = ["KC_TRNS"]': "line 4: in layer 'a', key 1: 'KC_TRNS' has no meaning here: docs",
    'keys = ["TD(0)"]': r"line 4: in layer 'a', key 1: 'TD\(0\)' has no meaning here: docs",
    'keys = ["&mo 1"]': "line 4.*'&mo 1' names layer 1, and the layers are 0 to 0",
    'keys = [{double = "MT(MOD_LCTL, KC_A)"}]': "a whole key: write tap = 'KC_A', hold = 'LEFT_CON",
    'keys = ["ö"]': "'ö' needs the .* these hosts can: us-intl.*such as host = 'us-intl'",
    "keys = []": "line 4.*keys",
    'keys = ["A"]\ngap_percent = 90': "line 5.*gap_percent",
    'keys = ["A"\nswipe_plus = 1': "line 5",
    'keys = ["A", {tap = "B", width = 0.05}]\ngap_percent = 10': (
        "line 3: in layer 'a', key 2: too narrow: increase its width, or reduce gap_percent"
    ),
    'keys = [{tap = "A", width = 0.001}, "B", "C"]': "line 3: in layer 'a', key 1: too narrow",
    'keys = ["A"]\n[[layer]]\nname = "b"\nkeys = ["B"]': (
        "line 6: no key leads to layer 'b': add 'toggle b' to a key"
    ),
    'keys = ["toggle b"]\n[[layer]]\nname = "b"\nkeys = ["B"]': (
        "line 6: no key leaves layer 'b': add 'toggle b' or 'to a' to one of its keys"
    ),
    'keys = ["A"]\n[[layer]]\nname = "a"\nkeys = ["B"]': "line 3: two layers are called 'a'",
    'keys = ["A"]\n[tuning]\ntapping_term_ms = 5': "line 6.*tapping_term_ms",
    'keys = ["A"]\n[tuning]\nflavor = "sweet"': "line 6.*sweet",
}


MISTAKES |= {
    'keys = ["momentary a"]': "line 4.*the first layer is always on: use 'to a'",
    'keys = ["sticky bb"]': "line 4.*there is no key 'bb'.*layers are a",
    'keys = ["tap_dance x"]': r"line 4.*\[tap_dance.x\] does not exist: add this table",
    'keys = ["tap_dance x"]\n[tap_dance.x]\nactions = ["A", "tap_dance x"]': (
        r"line 4: in \[tap_dance.x\]: \[tap_dance.x\] refers to itself"
    ),
    'keys = ["tap_dance x"]\n[tap_dance.x]\nactions = ["A"]': "line 6.*actions",
    'keys = ["tap_dance x"]\n[tap_dance.x]\nactions = ["A", "B"]\nholds = ["C", "D", "E"]': (
        r"line 4: in \[tap_dance.x\]: there are more holds than actions: remove some"
    ),
    'keys = ["mod_morph x"]\n[mod_morph.x]\naction = "A"\nmorphed = "B"\nmods = ["C"]': (
        r"line 8: in \[mod_morph.x\]: 'C' is no modifier"
    ),
    'keys = [{tap = "A", flavor = "balanced"}]': (
        "in layer 'a', key 1: flavor and terms are those of a hold: add one"
    ),
    'keys = [{tap = "A", retro_tap = true}]': (
        "in layer 'a', key 1: flavor and terms are those of a hold: add one"
    ),
}


@pytest.mark.parametrize("text", MISTAKES)
def test_a_mistake_is_told_with_its_line_and_what_to_do(tmp_path, capsys, text):
    path = write(tmp_path, HEAD + text)
    with pytest.raises(SpotsError, match=MISTAKES[text]) as refused:
        load(path)
    assert str(path) in str(refused.value)
    assert cli.main(["keys", "check", str(path)]) == 2
    error = capsys.readouterr().err
    assert error.startswith("spots: layout ")
    assert error.count("\n") == 1


def test_no_file_says_which_there_are():
    with refusal(FileError, file="maxi"):
        load("maxi")


def test_a_character_without_a_key_is_told():
    with refusal(SettingError):
        Typist(load("digits"), 85.0, np.random.default_rng(0)).type("a")


def test_a_key_can_have_its_own_flavor_and_terms(tmp_path):
    text = """name = "x"
[tuning]
tapping_term_ms = 300
[[layer]]
name = "a"
keys = [
  {tap = "A", hold = "LEFT_SHIFT", flavor = "hold-preferred", quick_tap_ms = 0},
  {tap = "B", hold = "LEFT_SHIFT", tapping_term_ms = 1024, require_prior_idle_ms = 128},
  {tap = "C", hold = "LEFT_SHIFT"},
  {tap = "D", hold = "LEFT_SHIFT", retro_tap = true},
]
"""
    layout = load(write(tmp_path, text))
    board = parse(layout.lines)
    assert [list(board.behaviours[i : i + 5]) for i in (0, 6, 12)] == [
        [HOLD_TAP, 0, 300 * 125 >> 7, 0, 0],
        [HOLD_TAP, 1, 1000, 200 * 125 >> 7, 125],
        [HOLD_TAP, 1 + RETRO_TAP, 300 * 125 >> 7, 200 * 125 >> 7, 0],
    ]
    assert {say(layout, key.actions["hold"]) for key in layout.layers["a"]} == {"LEFT_SHIFT"}


NEVER = """name = "x"
[[layer]]
name = "a"
keys = ["A", "to c"]
[[layer]]
name = "b"
keys = ["B", {tap = "2", label = "two"}]
[[layer]]
name = "c"
keys = ["C", %s, "to a"]
"""


@pytest.mark.parametrize("action", ["momentary b", "sticky b"])
def test_what_can_never_be_typed_is_found_key_by_key(tmp_path, capsys, action):
    path = write(tmp_path, NEVER % f'"{action}"')
    assert len(load(path).problems) == 2
    assert cli.main(["keys", "check", str(path)]) == 2
    shown = capsys.readouterr()
    assert [line.split(" can never")[0] for line in shown.out.splitlines()] == [
        "layer 'b', key 1 (B)",
        "layer 'b', key 2 (two)",
    ]
    assert "2 keys or actions can never be typed" in shown.err


DANCE = """
[tap_dance.x]
actions = ["A", "LEFT_SHIFT+B"]
"""
MORPH = """
[mod_morph.y]
action = "A"
morphed = "B"
mods = ["LEFT_SHIFT"]
"""
# Part of a file after its name, what can never be typed, and a change after which all can be typed.
PARTS = [
    (
        'swipe_plus = "C"\nkeys = [{tap = "A", hold = "B", slide_plus = "D"}]\n'
        "[tuning]\ntapping_term_ms = 250",
        "key 1 (A B): slide_plus can never be typed: the key is decided after tapping_term_ms (250",
        ("250", "260"),
    ),
    (
        'keys = ["C", {tap = "A", firm = "B"}]\n[tuning]\npress_mN = 3000\nfirm_mN = 3000',
        "key 2 (A B): tap can never be typed: each touch is firm: set firm_mN to more",
        ("firm_mN = 3000", "firm_mN = 3001"),
    ),
    (
        'keys = [{tap = "tap_dance x", double = "C"}]' + DANCE,
        "what its tap_dance does after two taps can never be typed: a second tap within double_ms",
        (', "LEFT_SHIFT+B"]', ', "LEFT_SHIFT+B"]\ntapping_term_ms = 400'),
    ),
    (
        'keys = [{tap = "tap_dance x", hold = "C"}]' + DANCE + 'holds = ["D"]',
        "the first of holds of its tap_dance can never be typed: a long touch is the hold",
        ('holds = ["D"]', 'holds = ["", "D"]'),
    ),
    (
        'keys = ["mod_morph y", "RIGHT_SHIFT"]' + MORPH,
        "mod_morph y: morphed can never be typed: no key of this layout presses its mods",
        ("RIGHT", "LEFT"),
    ),
    (
        'keys = ["mod_morph y", "B"]' + MORPH,
        "mod_morph y: morphed can never be typed",
        ('"B"]', '"sticky LEFT_SHIFT"]'),
    ),
    (
        'keys = ["A"]' + DANCE,
        "[tap_dance.x] can never be typed: no key uses it",
        ('"A"]', '"tap_dance x"]'),
    ),
    (
        'keys = ["A"]' + MORPH,
        "[mod_morph.y] can never be typed",
        ('["A"]', '["mod_morph y", "LEFT_SHIFT"]'),
    ),
]


@pytest.mark.parametrize(("text", "sentence", "change"), PARTS)
def test_what_can_never_be_typed_of_a_key_is_found(tmp_path, text, sentence, change):
    (problem,) = load(write(tmp_path, HEAD + text)).problems
    assert sentence in problem
    assert not load(write(tmp_path, HEAD + text.replace(change[0], change[1], 1))).problems


@pytest.mark.parametrize("name", BUILT_IN)
def test_all_of_a_layout_of_the_package_can_be_typed(name):
    assert not load(name).problems


SHOWN = """name = "x"
[[layer]]
name = "a"
swipe_plus = "F9"
keys = [
  {tap = "S", hold = "LEFT_SHIFT", firm = "F1"},
  {tap = "D", hold = "momentary b", retro_tap = true, tapping_term_ms = 300},
  "tap_dance x",
  "mod_morph y",
]
[[layer]]
name = "b"
keys = ["1"]
"""


def test_show_draws_what_a_key_does(tmp_path, capsys):
    path = write(tmp_path, SHOWN + DANCE + 'holds = ["F2"]\n' + MORPH)
    assert cli.main(["keys", "show", str(path)]) == 0
    out = capsys.readouterr().out
    lines = [" ".join(line.strip("│ ").split()) for line in out.splitlines()]
    for expected in (
        "key tap hold firm swipe away",
        "S S LEFT_SHIFT (1) F1",
        "D b D momentary b (2)",
        "(anywhere) F9",
        "1 tap: A, held: F2",
        "2 taps: LEFT_SHIFT+B",
        "at most 200 ms from press to press",
        "with LEFT_SHIFT: B, without LEFT_SHIFT",
        "balanced ========== tapping term 200 ms",
        "balanced, retro_tap ========== tapping term 300 ms",
    ):
        assert lines.count(expected) == 1, (expected, out)
    drawn = [line for line in lines if line.startswith(("a long touch", "another finger"))]
    assert [line.split()[-1] for line in drawn] == [
        *("hold", "hold", "tap", "hold"),
        *("tap", "hold", "tap", "hold"),
    ]


def test_a_layer_below_that_can_be_seen_is_no_problem(tmp_path):
    text = NEVER.replace('"A", "to c"', '"A", "momentary c"') % '"toggle b"'
    assert load(write(tmp_path, text.replace('keys = ["B"', 'keys = ["toggle b"'))).problems == []


FOREIGN = {
    "KC_NO": "",
    "XXXXXXX": "",
    "&none": "",
    "KC_EXLM": "LEFT_SHIFT+1",
    "EXCL": "LEFT_SHIFT+1",
    "KC_UNDS": "LEFT_SHIFT+-",
    "&kp EXCL": "LEFT_SHIFT+1",
    "HYPR": "LEFT_CONTROL+LEFT_SHIFT+LEFT_ALT+LEFT_GUI",
    "LCTL(KC_C)": "LEFT_CONTROL+C",
    "LCTL(LSFT(KC_C))": "LEFT_CONTROL+LEFT_SHIFT+C",
    "&kp LC(C)": "LEFT_CONTROL+C",
    "MEH(KC_A)": "LEFT_CONTROL+LEFT_SHIFT+LEFT_ALT+A",
    "MO(1)": "momentary b",
    "&mo 1": "momentary b",
    "TG(1)": "toggle b",
    "&to 0": "to a",
    "OSL(1)": "sticky b",
    "OSM(MOD_LSFT|MOD_LCTL)": "sticky LEFT_SHIFT+LEFT_CONTROL",
    "&sk LSHFT": "sticky LEFT_SHIFT",
    "CW_TOGG": "caps_word",
    "&key_repeat": "key_repeat",
    "&mkp LCLK": "MOUSE_LEFT",
    "MT(MOD_LCTL, KC_A)": '{tap = "A", hold = "LEFT_CONTROL"}',
    "LCTL_T(KC_A)": '{tap = "A", hold = "LEFT_CONTROL"}',
    "&mt LCTRL A": '{tap = "A", hold = "LEFT_CONTROL"}',
    "LT(1, KC_A)": '{tap = "A", hold = "momentary b"}',
    "&lt 1 A": '{tap = "A", hold = "momentary b"}',
}


def test_notations_of_other_firmware_are_what_is_written_here():
    def lines(key):
        key = key if key.startswith("{") else f'"{key}"'
        more = '[[layer]]\nname = "b"\nkeys = ["to a", "B"]\n'
        return compiled(Path("x"), f'{HEAD}keys = [{key}, "toggle b"]\n{more}').lines

    for text, ours in FOREIGN.items():
        assert lines(text) == lines(ours), text


def test_a_layer_with_one_bracket_is_named_with_its_line():
    with pytest.raises(FileError, match=r"line 3: write \[\[layer\]\] with two brackets"):
        compiled(Path("x"), 'name = "x"\n\n[layer]\nname = "a"\nkeys = ["A"]\n')


def test_characters_of_two_code_points_are_those_of_one():
    file = 'name = "x"\nhost = "de"\n[[layer]]\nname = "a"\nkeys = ["%s", {text = "%s"}]\n'
    one = compiled(Path("x"), file % ("ü", "süß"))
    two = compiled(Path("x"), file % ("u\u0308", "su\u0308ß"))
    assert one.lines == two.lines
