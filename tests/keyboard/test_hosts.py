"""Characters: what the reports of a board type on a Linux desktop, whose own library is asked."""

import itertools
import random
import unicodedata

import numpy as np
import pytest
from support.engine_bench import Bench

import xkb
from spots import cli
from spots.errors import SpotsError
from spots.keyboard import hosts
from spots.keyboard.keys import say
from spots.keyboard.layout import compiled
from spots.keyboard.writing import Writing
from spots.outputs.usages import ON_BOARDS, USAGES
from spots_device.keys.layout import STEPS_MAX, TAP, action, parse
from spots_sim.person.typist import TypedText

TABLES, SEQUENCES = hosts.read(hosts.FILE.read_text("utf-8").splitlines())
NAMES = [table.name for table in TABLES]
TABLE = {table.name: table for table in TABLES}
# Linux's code of each usage, by the names in usages.txt; evdev is not on every system.
CODE = {
    **{4 + i: code for i, code in enumerate((30, 48, 46, 32, 18, 33, 34, 35, 23, 36, 37, 38, 50))},
    **{17 + i: code for i, code in enumerate((49, 24, 25, 16, 19, 31, 20, 22, 47, 17, 45, 21, 44))},
    **{0x1E + i: 2 + i for i in range(10)},
    0x28: 28,
    0x2B: 15,
    0x2C: 57,
    0x2D: 12,
    0x2E: 13,
    0x2F: 26,
    0x30: 27,
    0x31: 43,
    0x33: 39,
    0x34: 40,
    0x35: 41,
    0x36: 51,
    0x37: 52,
    0x38: 53,
    0x64: 86,
    0x87: 89,
    0x89: 124,
}
MODIFIER_CODES = (29, 42, 56, 125, 97, 54, 100, 126)
SHIFT, ALT_GR = 42, 100
NOT_ON_WINDOWS = {"it": "~`"}
LEVELS = ((), (SHIFT,), (ALT_GR,), (SHIFT, ALT_GR))


def desktop(name, locale=None):
    """Return the desktop of a host, by libxkbcommon."""
    try:
        return xkb.Xkb(TABLE[name].xkb, f"{locale or TABLE[name].language}.UTF-8")
    except OSError:
        pytest.skip("libxkbcommon, xkb-data or libx11-data is missing")


def seen(reports, keyboard):
    """Return what a desktop types for keyboard reports."""
    text = ""
    before = bytes(8)
    for report in reports:
        changed = before[0] ^ report[0]
        for bit, code in enumerate(MODIFIER_CODES):
            if changed >> bit & 1:
                keyboard.key(code, bool(report[0] >> bit & 1))
        for usage in set(before[2:]) - set(report[2:]):
            keyboard.key(CODE[usage], False)
        for usage in report[2:]:
            if usage and usage not in before[2:]:
                text += keyboard.key(CODE[usage], True)
        before = report
    return text.replace("\r", "\n")


def file_of(host, keys, system="linux"):
    return f'name = "x"\nhost = "{host}"\nos = "{system}"\n[[layer]]\nname = "a"\nkeys = [{keys}]\n'


def quoted(text):
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'


def reports_of(host, texts):
    """Return the reports of a board that types texts, each with its own key."""
    keys = ", ".join(f"{{text = {quoted(text)}}}" for text in texts)
    bench = Bench(compiled(hosts.FILE, file_of(host, keys)).lines)
    for i in range(len(texts)):
        bench.tap("finger", (i + 0.5) / len(texts))
        while bench.engine._types() or bench.engine._count:
            bench.at(bench.ms + 10)
    bench.at(bench.ms + 30)
    bench.keyboard.pump()
    assert not any(bench.keyboard.reports[-1])
    return bench.keyboard.reports


def batches(host, texts):
    """Yield groups of texts that a board has room for, and that are keys of one layer."""
    group, steps = [], 0
    for text in texts:
        more = len(Writing(host, "linux").text(text))
        if steps + more > STEPS_MAX or len(group) == 40:
            yield group
            group, steps = [], 0
        group.append(text)
        steps += more
    yield group


@pytest.mark.board
@pytest.mark.parametrize("name", NAMES)
def test_a_desktop_gets_every_character_and_200_sentences(name):
    keyboards = [desktop(name), desktop(name, "en_US")]
    every = hosts.host_of(name).characters
    chosen = random.Random(name)
    letters = [one for one in every if one.isalpha()]
    words = ["".join(chosen.choices(letters, k=chosen.randint(1, 6))) for _ in range(60)]
    sentences = [
        " ".join(chosen.choices(words, k=3)) + chosen.choice(every) + chosen.choice(".!?\n\t")
        for _ in range(200)
    ]
    whole = ["".join(every[i : i + 100]) for i in range(0, len(every), 100)]
    for group in batches(name, [*whole, *sentences]):
        reports = reports_of(name, group)
        for keyboard in keyboards:
            assert seen(reports, keyboard) == "".join(group)


@pytest.mark.board
@pytest.mark.parametrize("name", NAMES)
def test_a_host_knows_every_character_that_the_desktop_types(name):
    own, other = desktop(name), desktop(name, "en_US")
    has_levels = own.symbol(ALT_GR)[0] == "ISO_Level3_Shift"
    symbols = {
        own.symbol(CODE[usage], level)
        for usage in hosts.KEYS
        for level in LEVELS[: 4 if has_levels else 2]
    }
    known = set(hosts.host_of(name).characters)
    direct = {character for _, character in symbols if character}
    assert direct
    assert direct <= known
    dead = [symbol for symbol, _ in symbols if symbol.startswith("dead_")]
    made = set()
    for sequence in itertools.product(dead, [symbol for symbol, _ in symbols]):
        typed = {"".join(map(each.compose, numbers_of(each, sequence))) for each in (own, other)}
        if len(typed) == 1 and len(min(typed)) == 1:
            made |= typed
    assert made <= known
    assert len(dead) < 3 or made
    # What the desktops of two languages do not agree on is refused.
    for character in TABLE[name].without:
        assert not hosts.host_of(name).strokes(character)


def numbers_of(keyboard, names):
    return [keyboard.named(name)[0] for name in names]


def test_the_codes_of_this_test_are_those_of_the_table():
    ecodes = pytest.importorskip("evdev").ecodes.ecodes
    assert {usage: ecodes[USAGES[7, usage].linux] for usage in CODE} == CODE


@pytest.mark.parametrize("name", NAMES)
def test_each_system_types_what_programmers_need_and_a_mac_nothing_with_option(name):
    linux, windows, mac = (hosts.host_of(name, system) for system in hosts.SYSTEMS)
    assert set(mac.characters) <= set(linux.characters)
    for one in mac.characters:
        assert not any(stroke.modifiers & hosts.ALT_GR for stroke in mac.strokes(one))
    ascii_signs = {chr(code) for code in range(0x20, 0x7F)}
    assert ascii_signs <= set(linux.characters)
    # Windows' Italian layout has neither ~ nor `, and the others all signs.
    assert ascii_signs - set(windows.characters) == set(NOT_ON_WINDOWS.get(name, ""))


# Characters of AltGr on Windows, from the comments of QMK's quantum/keymap_extras and Microsoft's
# pictures of its layouts (€ on E): pairs of the character on an American keyboard (< is the key
# beside left shift) and the typed character. The sources do not agree about
# [ª ]º of Brazilian and ,` of Turkish keyboards, which are refused.
WINDOWS = {
    "us-intl": r"1¡ 2² 3³ 4¤ 5€ 6¼ 7½ 8¾ 9‘ 0’ -¥ =× qä wå eé r® tþ yü uú ií oó pö [« ]» \¬ aá sß "
    "dð lø ;¶ zæ c© nñ mµ ,ç /¿",
    "uk": "`¦ 4€ eé uú ií oó aá",
    "de": r"2² 3³ 7{ 8[ 9] 0} -\ q@ e€ ]~ mµ <|",
    "ch": r"-´ =~ 1¦ 2@ 3# 6¬ 7| 8¢ e€ [[ ]] '{ <\ \}",
    "ch-fr": r"-´ =~ 1¦ 2@ 3# 6¬ 7| 8¢ e€ [[ ]] '{ <\ \}",
    "fr": r"2~ 7` 3# 4{ 5[ 6| 8\ 0@ -] =} e€ ]¤",
    "be": r"'´ \` <\ 1| 2@ 3# 6^ 9{ 0} e€ [[ ]]",
    "es": r"`\ 1| 2@ 3# 4~ e€ 6¬ [[ ]] '{ \}",
    "latam": r"`¬ -\ q@ ]~ '^ \`",
    "it": "e€ [[ ]] ;@ '#",
    "pt": "2@ 3£ 4§ 7{ 8[ 9] 0} e€",
    "br": "1¹ 2² 3³ 4£ 5¢ 6¬ =§ e°",
    "se": r"2@ 3£ 4$ e€ 7{ 8[ 9] 0} -\ ]~ <| mµ",
    "fi": r"2@ 3£ 4$ e€ 7{ 8[ 9] 0} -\ ]~ <| mµ",
    "no": "2@ 3£ 4$ e€ 7{ 8[ 9] 0} =´ ]~ mµ",
    "dk": r"2@ 3£ 4$ e€ 7{ 8[ 9] 0} =| ]~ <\ mµ",
    "pl": "eę u€ oó aą sś lł zż xź cć nń",
    "cz": r"1~ q\ w| e€ f[ g] ;$ 'ß x# c& v@ b{ n} ,< .> /*",
    "sk": r"1~ 7` q\ w| e€ p' [÷ ]× sđ dĐ f[ g] kł lŁ ;$ 'ß z> x# v@ b{ n} <<",
    "hu": r"1~ 7` q\ w| u€ [÷ ]× sđ dĐ f[ g] kł lŁ ;$ 'ß \¤ z> x# c& v@ b{ n} ,; /* <<",
    "tr": r"2£ 3# 4$ 5½ 7{ 8[ 9] 0} -\ =| q@ e€ t₺ aæ sß [¨ ]~ ;´",
}
ACCENTS = {"~": "tilde", "´": "acute", "`": "grave", "^": "circumflex", "¨": "diaeresis"}


@pytest.mark.parametrize("name", WINDOWS)
def test_alt_gr_on_windows_is_what_a_second_source_says(name):
    usages = {one.pynput: one.usage for one in reversed(USAGES.values()) if one.page == 7}
    usages["<"] = 0x64
    host = hosts.host_of(name, "windows")
    for key, character in WINDOWS[name].split():
        typed = host.typed(hosts.Stroke(hosts.ALT_GR, usages[key]))
        assert typed in (character, ACCENTS.get(character)), key


def test_signs_of_dead_keys_on_windows_need_a_space():
    # The rows without AltGr differ, too.
    for name, character, strokes in [
        ("es", "~", ((0x40, 0x21), (0, 0x2C))),
        ("fr", "`", ((0x40, 0x24), (0, 0x2C))),
        ("pl", "~", ((2, 0x35), (0, 0x2C))),
        ("tr", "^", ((2, 0x20), (0, 0x2C))),
        ("sk", "'", ((0x40, 0x13),)),
        ("de", "~", ((0x40, 0x30),)),
    ]:
        found = hosts.host_of(name, "windows").strokes(character)
        assert found == strokes


@pytest.mark.parametrize("name", NAMES)
def test_what_linux_and_windows_have_in_common_a_linux_desktop_types(name):
    host, keyboard = hosts.host_of(name, hosts.BOTH), desktop(name)
    assert set(host.characters) <= set(hosts.host_of(name, "windows").characters)
    for one in host.characters:
        report = [
            (stroke.modifiers, 0, stroke.usage, 0, 0, 0, 0, 0) for stroke in host.strokes(one)
        ]
        pressed = [bytes(each) for stroke in report for each in (stroke, bytes(8))]
        assert seen(pressed, keyboard) == one


@pytest.mark.parametrize("system", [*hosts.SYSTEMS, hosts.BOTH])
def test_what_is_shown_is_what_the_host_types(system):
    for name in NAMES:
        host, shown = hosts.host_of(name, system), TypedText(hosts.host_of(name, system))
        for one in host.characters:
            for stroke in host.strokes(one):
                shown.key(7, stroke.usage, stroke.modifiers, True)
        assert shown.text == "".join(host.characters), name
    assert [hosts.host_of(name).cap(usage) for name, usage in CAPS] == list(CAPS.values())
    layout = layout_of("de", '"SEMICOLON", "LEFT_CONTROL+LEFT_BRACKET"')
    assert [key.label for key in layout.layers["a"]] == ["Ö", "Ctrl+Ü"]


CAPS = {
    ("de", 0x33): "Ö",
    ("de", 0x2D): "ß",
    ("tr", 0x34): "İ",
    ("fr", 0x1F): "é",
    ("us-dvorak", 0x14): "'",
    ("es", 0x34): "",  # a dead key
}
IN_WORDS = {
    ("de", "gör_ß-a"): "GÖR_ß-a",
    ("fr", "a,b"): "A,b",
    ("us-dvorak", "two"): "TWO",
    ("hu", "íz"): "ÍZ",
    ("es", "mamá"): "MAMÁ",
    ("tr", "ışık i"): "IŞIK i",
    ("pl", "łza"): "ŁZA",
    ("jp", "a_b"): "A_B",
}


@pytest.mark.parametrize("case", IN_WORDS)
def test_caps_word_follows_the_letters_of_the_host(case):
    name, text = case
    keys = ", ".join(quoted(one) for one in ("caps_word", *text.replace(" ", "")))
    layout = layout_of(name, keys.replace('"i"', '"SPACEBAR", "i"') if " " in text else keys)
    shown = TypedText(hosts.host_of(name))
    bench = Bench(layout.lines)
    bench.key = lambda *event: shown.key(*event)
    many = len(layout.layers["a"])
    for i in range(many):
        bench.tap("f", (i + 0.5) / many)
        bench.at(bench.ms + 300)
    assert shown.text == IN_WORDS[case]


@pytest.mark.parametrize("ctrl", ["LEFT_CONTROL", "LEFT_ALT", "RIGHT_GUI", "RIGHT_SHIFT"])
@pytest.mark.parametrize("way", ['"%s", "C"', '"sticky %s", "C"', '"B", "%s+C"'])
def test_caps_word_does_not_change_a_key_with_another_modifier(ctrl, way):
    layout = layout_of("de", '"caps_word", "A", ' + way % ctrl)
    bench = Bench(layout.lines)
    bench.tap("f", 0.1)
    bench.at(300)
    bench.press("ctrl", 0.6)
    if "sticky" in way:
        bench.release("ctrl")
    bench.tap("f", 0.9)
    bit = {"LEFT_CONTROL": 1, "LEFT_ALT": 4, "RIGHT_GUI": 0x80, "RIGHT_SHIFT": 0x20}[ctrl]
    (bits,) = [one[2] for one in bench.events if one[:2] == (7, 6) and one[3]]
    assert bits == bit


def layout_of(host, keys, system="linux"):
    return compiled(hosts.FILE, file_of(host, keys, system))


def tap_of(host, key):
    return parse(layout_of(host, quoted(key)).lines).keys[TAP]


def test_a_letter_alone_is_its_key_on_the_host():
    assert tap_of("de", "Z") == tap_of("de", "z") == action(7, 0x1C)
    assert tap_of("us", "Z") == action(7, 0x1D)
    assert tap_of("fr", "A") == action(7, 0x14)
    assert tap_of("de", "Ä") == tap_of("de", "ä") == action(7, 0x34)
    assert tap_of("de", "LEFT_SHIFT+Ä") == action(7, 0x34, 2)
    assert tap_of("tr", "I") == action(7, 0x0C)
    assert tap_of("tr", "i") == action(7, 0x34)
    # The shift of this key types another letter.
    assert tap_of("ch", "é") == action(7, 0x33, 2)
    assert tap_of("es", "ª") == action(7, 0x35, 2)
    # A name of several characters is a position.
    assert tap_of("de", "SEMICOLON") == action(7, 0x33)


def test_signs_are_those_of_the_host():
    assert tap_of("de", "/") == action(7, 0x24, 2)
    assert tap_of("de", "€") == action(7, 0x08, 0x40)
    assert tap_of("fr", "1") == action(7, 0x1E, 2)
    assert tap_of("de", "LEFT_CONTROL+/") == action(7, 0x24, 3)
    layout = layout_of("de", '"/", "LEFT_CONTROL+Z", "ê"')
    assert [key.label for key in layout.layers["a"]] == ["/", "Ctrl+Z", "ê"]
    shown = [say(layout, key.actions["tap"]) for key in layout.layers["a"]]
    assert shown == ["/", "LEFT_CONTROL+Z", "text ê"]


def test_commands_and_moves_by_a_word_are_those_of_the_system():
    for system, primary, word in (("linux", 1, 1), ("windows", 1, 1), ("mac", 8, 4)):
        layout = layout_of("us", '"primary+C", "LEFT_SHIFT+word+LEFT_ARROW"', system)
        keys = layout.layers["a"]
        assert keys[0].actions["tap"] == action(7, 6, primary)
        assert keys[1].actions["tap"] == action(7, 0x50, 2 | word)


REFUSED = {
    ("de", "linux", '"ł̣"'): "there is no key",
    ("us", "linux", '"ä"'): "'us' on linux cannot type 'ä', these hosts can: us-intl, us-colemak",
    ("us", "linux", '"漢"'): "cannot type '漢', no host of SPOTS can",
    ("de", "mac", '"€"'): "the host 'de' on mac cannot type '€', ",
    ("de", "linux", '"LEFT_SHIFT+/"'): "'/' needs shift or AltGr on this host",
    ("de", "linux", '"LEFT_SHIFT+ê"'): "'ê' needs two keys on this host",
    ("de", "linux", '"sticky ê"'): "'ê' needs several keys",
    ("xx", "linux", '"A"'): "line 2: there is no host 'xx': use one of us, us-intl",
    ("us", "amiga", '"A"'): "line 3.*amiga",
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_a_host_cannot_type_is_refused_with_a_remedy(case):
    host, system, keys = case
    with pytest.raises(SpotsError, match=REFUSED[case]) as refused:
        layout_of(host, keys, system)
    assert "line" in str(refused.value)


HEAD = 'name = "x"\n%s[[layer]]\nname = "a"\nkeys = [%s]\n'
UNNAMED = {
    ("", '"ä"'): r"line 4.*the character 'ä' needs .*us-intl.* such as host = 'us-intl'",
    ("", '"text a"'): "line 4.*the character 'a' needs.*host = 'us'",
    ("", '"primary+C"'): "line 4.*'primary' depends on the computer: add os = 'linux'",
    ('host = "de"\n', '"æ"'): "line 5.*'de' has 'æ' only on Linux: add os = 'linux'",
    ('host = "es"\n', '"text ~"'): "line 5.*'es' has '~' on other keys on Windows than on Linux",
}


@pytest.mark.parametrize("case", UNNAMED)
def test_what_needs_a_host_or_a_system_asks_for_it(case):
    with pytest.raises(SpotsError, match=UNNAMED[case]):
        compiled(hosts.FILE, HEAD % case)


def test_without_a_system_only_what_linux_and_windows_agree_on_is_typed():
    layout = compiled(hosts.FILE, HEAD % ('host = "de"\n', '"€", "ä", "ê"'))
    taps = [key.actions["tap"] for key in layout.layers["a"]]
    assert taps[:2] == [action(7, 0x08, 0x40), action(7, 0x34)]
    assert layout.texts == {"text ê": (0x35, 0x08)}


def test_every_layout_is_written_in_one_form():
    text = hosts.FILE.read_text("utf-8")
    assert unicodedata.normalize("NFC", text) == text
    assert np.all([len(table.rows) in (2, 4) for table in TABLES])
    assert np.all([len(table.windows) in (0, 4) for table in TABLES])
    assert len(text.encode()) < 34_000


def test_where_keys_are_pressed_by_their_characters_another_host_is_refused(
    tmp_path, monkeypatch, capsys
):
    path = tmp_path / "mine.toml"
    path.write_text(file_of("de", '"z"'), "utf-8")
    monkeypatch.setattr("sys.platform", "win32")
    assert cli.main(["keyboard", "--layout", str(path), "--port", "virtual"]) == 2
    assert "not those of the host 'de'" in capsys.readouterr().err


def test_the_names_of_keys_are_listed(capsys):
    assert cli.main(["keys", "names", "vol_up"]) == 0
    assert capsys.readouterr().out.startswith("VOLUME_INCREMENT ")
    assert cli.main(["keys", "names", "ñ"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "host es SEMICOLON" in [" ".join(line.split()) for line in lines]
    assert "host be RIGHT_ALT+FORWARD_SLASH, N" in [" ".join(line.split()) for line in lines]
    assert cli.main(["keys", "names"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == len(USAGES) + len(ON_BOARDS)
    assert cli.main(["keys", "names", "zzz"]) == 2
    assert cli.main(["keys", "show"]) == 2
    assert "keys show needs a layout" in capsys.readouterr().err
