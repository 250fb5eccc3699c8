"""Writes host/spots/keyboard/hosts.txt: which keys type a character in the layouts of computers.

Needs libxkbcommon, and the data of xkb-data and libx11-data::

    python tools/host_layouts.py

The layouts are facts of xkb-data, whose licence is that of X.Org (MIT). A dead key with the next
key makes a character by the Compose file of a locale. A sequence that the locale of a layout and
en_US do not agree on is left out.
"""

import re
import subprocess
import unicodedata
from pathlib import Path

from xkb import Xkb

from spots.keyboard import hosts
from spots.outputs.usages import USAGES

COMPOSE = Path("/usr/share/X11/locale/en_US.UTF-8/Compose")
PACKAGES = ("xkb-data", "libx11-data", "libxkbcommon0")
EVERYWHERE = "en_US.UTF-8"
# Name in layout files: XKB's name, and the language of its users.
LAYOUTS = {
    "us": ("us", "en_US"),
    "us-intl": ("us(intl)", "en_US"),
    "us-dvorak": ("us(dvorak)", "en_US"),
    "us-colemak": ("us(colemak)", "en_US"),
    "uk": ("gb", "en_GB"),
    "de": ("de", "de_DE"),
    "ch": ("ch", "de_CH"),
    "ch-fr": ("ch(fr)", "fr_CH"),
    "fr": ("fr", "fr_FR"),
    "be": ("be", "fr_BE"),
    "ca": ("ca", "fr_CA"),
    "es": ("es", "es_ES"),
    "latam": ("latam", "es_MX"),
    "it": ("it", "it_IT"),
    "pt": ("pt", "pt_PT"),
    "br": ("br", "pt_BR"),
    "se": ("se", "sv_SE"),
    "no": ("no", "nb_NO"),
    "dk": ("dk", "da_DK"),
    "fi": ("fi", "fi_FI"),
    "pl": ("pl", "pl_PL"),
    "cz": ("cz", "cs_CZ"),
    "sk": ("sk", "sk_SK"),
    "hu": ("hu", "hu_HU"),
    "ro": ("ro", "ro_RO"),
    "tr": ("tr", "tr_TR"),
    "jp": ("jp", "ja_JP"),
    "kr": ("kr", "ko_KR"),
}
# Characters of AltGr on Windows, from the comments of QMK's quantum/keymap_extras and Microsoft's
# pictures of its layouts (€ on E): pairs of the character on an American keyboard (< is the key
# beside left shift) and the typed character. With shift, a letter is its capital. ~´`^¨ may be dead
# keys. A pair counts only if Linux types the same with this key.
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
    "it": "e€ [[ ]] [{ ]} ;@ '#",
    "pt": "2@ 3£ 4§ 7{ 8[ 9] 0} e€",
    "br": "1¹ 2² 3³ 4£ 5¢ 6¬ =§ e° [ª ]º",
    "se": r"2@ 3£ 4$ e€ 7{ 8[ 9] 0} -\ ]~ <| mµ",
    "fi": r"2@ 3£ 4$ e€ 7{ 8[ 9] 0} -\ ]~ <| mµ",
    "no": "2@ 3£ 4$ e€ 7{ 8[ 9] 0} =´ ]~ mµ",
    "dk": r"2@ 3£ 4$ e€ 7{ 8[ 9] 0} =| ]~ <\ mµ",
    "pl": "eę u€ oó aą sś lł zż xź cć nń",
    "cz": r"1~ q\ w| e€ f[ g] ;$ 'ß x# c& v@ b{ n} ,< .> /*",
    "sk": r"1~ 7` q\ w| e€ p' [÷ ]× sđ dĐ f[ g] kł lŁ ;$ 'ß z> x# v@ b{ n} <<",
    "hu": r"1~ 7` q\ w| u€ [÷ ]× sđ dĐ f[ g] kł lŁ ;$ 'ß \¤ z> x# c& v@ b{ n} ,; /* <<",
    "tr": r"2£ 3# 4$ 5½ 7{ 8[ 9] 0} -\ =| q@ e€ t₺ aæ sß [¨ ]~ ;´ ,`",
}
SHIFT, ALT_GR = 42, 100  # Linux's codes of left shift and right alt
LEVELS = ((), (SHIFT,), (ALT_GR,), (SHIFT, ALT_GR))
DEAD = "dead_"
DEAD_KEYS = {"~": "tilde", "´": "acute", "`": "grave", "^": "circumflex", "¨": "diaeresis"}


def codes():
    """Return Linux's code of each usage of `hosts.KEYS`."""
    from evdev import ecodes

    return {usage: ecodes.ecodes[USAGES[7, usage].linux] for usage in hosts.KEYS}


def rows(keyboard, code_of):
    """Return the four rows of a layout: names of dead keys, characters, or empty texts."""
    found = []
    for modifiers in LEVELS:
        row = []
        for usage in hosts.KEYS:
            name, character = keyboard.symbol(code_of[usage], modifiers)
            row.append(name if name.startswith(DEAD) else character)
        found.append(row)
    if keyboard.symbol(ALT_GR)[0] != "ISO_Level3_Shift":
        del found[2:]
    return found


def sequences(keyboard):
    """Yield dead keys, last character and result of each sequence of the Compose file."""
    for line in COMPOSE.read_text("utf-8").splitlines():
        match = re.match(r'((?:<\w+>\s*)+):\s*"((?:[^"\\]|\\.)*)"', line)
        if match and line.startswith(f"<{DEAD}"):
            *dead, last = re.findall(r"<(\w+)>", match[1])
            if not last.startswith(DEAD):
                last = keyboard.named(last)[1]
            result = re.sub(r"\\(.)", r"\1", match[2])
            if last and len(result) == 1 and all(name.startswith(DEAD) for name in dead):
                yield tuple(dead), last, result


def token(text):
    """Return a character or the name of a dead key as a word of the file."""
    if not text:
        return hosts.NOTHING
    if text.startswith(DEAD):
        return text.removeprefix(DEAD)
    if len(text) == 1 and unicodedata.category(text)[0] in "ZCM":
        return f"U+{ord(text):04X}"
    return text


def on_windows(name, rows):
    """Return the keys that type the same with AltGr on Windows, as words of the file."""
    usages = {one.pynput: one.usage for one in reversed(USAGES.values()) if one.page == 7}
    usages["<"] = 0x64
    words = []
    for key, character in WINDOWS.get(name, "").split():
        column = hosts.KEYS.index(usages[key])
        same = character, DEAD + DEAD_KEYS.get(character, "")
        levels = [level for level, row in enumerate(rows[2:]) if row[column] in same][:1]
        if character.isalpha() and levels == [0] and rows[3][column] == character.upper():
            levels.append(1)
        if not levels:
            print(f"{name}: AltGr+{key} is {character} on Windows, {rows[2][column]} on Linux")
        bits = (hosts.ALT_GR, hosts.ALT_GR | hosts.SHIFT)
        words += [f"{bits[level]:02x}:{usages[key]:02x}" for level in levels]
    return words


def is_typed(strokes, text, keyboard, code_of):
    """Return whether keys that are pressed one after the other type a text."""
    typed = ""
    for modifiers, usage in strokes:
        down = [ALT_GR] * (modifiers >> 6 & 1) + [SHIFT] * (modifiers >> 1 & 1) + [code_of[usage]]
        typed += "".join(keyboard.key(code, True) for code in down)
        for code in reversed(down):
            keyboard.key(code, False)
    return typed == text


def block(name, code_of, rows, sequences):
    """Return the lines of a layout."""
    xkb, language = LAYOUTS[name]
    lines = [f"host {name} {xkb} {language}"]
    for row in rows:
        words = [token(text) for text in row]
        while words[-1] == hosts.NOTHING:
            words.pop()
        lines.append(" ".join(words))
    windows = on_windows(name, rows)
    if windows:
        lines.append("windows " + " ".join(windows))
    tables, known = hosts.read([*sequences, *lines])
    host = hosts.Host(tables[0], known)
    keyboards = [Xkb(xkb, EVERYWHERE), Xkb(xkb, f"{language}.UTF-8")]
    wrong = [
        one
        for one in host.characters
        if not all(is_typed(host.strokes(one), one, each, code_of) for each in keyboards)
    ]
    if wrong:
        lines.append("without " + " ".join(map(token, wrong)))
    print(f"{name}: {len(host.characters) - len(wrong)} characters; without", *wrong)
    return lines


def main():
    """Write the file."""
    code_of = codes()
    every = list(sequences(Xkb("us", EVERYWHERE)))
    found, used = {}, set()  # used: sequences whose keys a layout has
    for name, (xkb, _) in LAYOUTS.items():
        found[name] = rows(Xkb(xkb, EVERYWHERE), code_of)
        made = {text for row in found[name] for text in row}
        used |= {one for one in every if made.issuperset((*one[0], one[1]))}
    dead_lines = []
    for dead in sorted({one[0] for one in used}):
        texts = [text for one in sorted(used) if one[0] == dead for text in one[1:]]
        words = ",".join(map(token, dead)), *map(token, texts)
        dead_lines.append("dead " + " ".join(words))
    lines = ["# Written by tools/host_layouts.py from facts of these packages:"]
    for package in PACKAGES:
        version = subprocess.check_output(["dpkg-query", "-Wf", "${Version}", package], text=True)
        lines.append(f"# {package} {version}")
    lines += [
        "# xkb-data and libx11-data have the licence MIT/X11. Windows: see tools/host_layouts.py.",
        "# A dead key, and pairs of the next character and what it becomes. Then the hosts: name,",
        "# name in XKB, locale; rows of characters, see `hosts.Table`.",
        *dead_lines,
    ]
    for name in LAYOUTS:
        lines += block(name, code_of, found[name], dead_lines)
    hosts.FILE.write_text("\n".join(lines) + "\n", "utf-8")


if __name__ == "__main__":
    main()
