"""Writes host/spots/keyboard/hosts.txt: which keys type a character in the layouts of computers.

Needs libxkbcommon, and the data of xkb-data and libx11-data::

    python tools/host_layouts.py FOLDER

The layouts are facts of xkb-data, whose licence is that of X.Org (MIT). A dead key with the next
key makes a character by the Compose file of a locale. A sequence that the locale of a layout and
en_US do not agree on is left out. Those of Windows are facts of WorldAlphabets (MIT): FOLDER is its
folder ``data/layouts``.
"""

import json
import re
import subprocess
import sys
import unicodedata
from pathlib import Path

from spots.keyboard import hosts
from spots.outputs.usages import USAGES
from xkb import Xkb

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
# Tables of Windows in WorldAlphabets. Windows has no Colemak; the Japanese table there is that of
# another keyboard.
WINDOWS = {
    "us": "en-us",
    "us-intl": "en-united-states-international",
    "us-dvorak": "en-united-states-dvorak",
    "uk": "en-united-kingdom",
    "de": "de-german",
    "ch": "de-swiss-german",
    "ch-fr": "fr-swiss-french",
    "fr": "fr-french-legacy-azerty",
    "be": "fr-belgian-french",
    "ca": "fr-canadian-french",
    "es": "es-spanish",
    "latam": "es-latin-american",
    "it": "it-italian",
    "pt": "pt-portuguese",
    "br": "pt-portuguese-brazil-abnt2",
    "se": "sv-swedish",
    "no": "no-norwegian",
    "dk": "da-danish",
    "fi": "fi-finnish",
    "pl": "pl-polish-programmers",
    "cz": "cs-czech",
    "sk": "sk-slovak",
    "hu": "hu-hungarian",
    "ro": "ro-romanian-programmers",
    "tr": "tr-turkish-q",
    "kr": "ko-korean",
}
SOURCE = "github.com/willwade/WorldAlphabets, 59d856c"
# Scan codes of the set 1 in the order of `hosts.KEYS`.
SCAN_CODES = (  # noqa: SIM905
    "1E 30 2E 20 12 21 22 23 17 24 25 26 32 31 18 19 10 13 1F 14 16 2F 11 2D 15 2C "
    "02 03 04 05 06 07 08 09 0A 0B 0C 0D 1A 1B 2B 27 28 29 33 34 35 39 56 73 7D"
).split()
LEGENDS = ("base", "shift", "altgr", "shift_altgr")
# Names in XKB of the dead keys of Windows. American keyboards have ' and " for two of them.
ACCENTS = {
    "´": "acute", "'": "acute", "`": "grave", "^": "circumflex", "~": "tilde", "¨": "diaeresis",
    '"': "diaeresis", "ˇ": "caron", "˘": "breve", "°": "abovering", "˛": "ogonek", "˙": "abovedot",
    "˝": "doubleacute", "¸": "cedilla",
}  # fmt: skip
SHIFT, ALT_GR = 42, 100  # Linux's codes of left shift and right alt
LEVELS = ((), (SHIFT,), (ALT_GR,), (SHIFT, ALT_GR))
DEAD = "dead_"


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


def on_windows(name, folder):
    """Return the rows of a layout on Windows, and pairs of each dead key; None if unknown."""
    if name not in WINDOWS:
        return None
    found = json.loads((folder / f"{WINDOWS[name]}.json").read_text("utf-8"))
    dead = {one["trigger"]: one["compose"].items() for one in found["dead_keys"] or []}
    pairs = {
        ACCENTS[one]: sorted(pair for pair in made if all(map(is_one, pair)))
        for one, made in dead.items()
    }
    rows = [[""] * len(hosts.KEYS) for _ in LEVELS]
    for key in found["keys"]:
        if key["sc"] in SCAN_CODES:
            column = SCAN_CODES.index(key["sc"])
            for row, legend in zip(rows, LEGENDS):
                text = key["legends"][legend] or ""
                if key["dead"] and text in dead:
                    row[column] = DEAD + ACCENTS[text]
                elif is_one(text):
                    row[column] = text
    rows[0][hosts.KEYS.index(0x2C)] = " "
    return rows, pairs


def is_one(text):
    """Return whether a text is one visible character."""
    return len(text) == 1 and unicodedata.category(text)[0] != "C"


def line_of_row(texts):
    """Return a row as a line of the file."""
    words = [token(text) for text in texts]
    while words and words[-1] == hosts.NOTHING:
        words.pop()
    return " ".join(words) or hosts.NOTHING


def is_typed(strokes, text, keyboard, code_of):
    """Return whether keys that are pressed one after the other type a text."""
    typed = ""
    for modifiers, usage in strokes:
        down = [ALT_GR] * (modifiers >> 6 & 1) + [SHIFT] * (modifiers >> 1 & 1) + [code_of[usage]]
        typed += "".join(keyboard.key(code, True) for code in down)
        for code in reversed(down):
            keyboard.key(code, False)
    return typed == text


def block(name, code_of, rows, windows, sequences):
    """Return the lines of a layout; `windows` has rows and the numbers of `accent` lines."""
    xkb, language = LAYOUTS[name]
    lines = [f"host {name} {xkb} {language}", *map(line_of_row, rows)]
    if windows:
        lines.append(" ".join(map(str, ("windows", *windows[1]))))
        linux = [*lines[1:], *[hosts.NOTHING] * (len(LEVELS) - len(rows))]
        for line, row in zip(linux, map(line_of_row, windows[0])):
            lines.append(hosts.SAME if row == line else row)
    tables, known = hosts.read([*sequences, *lines])
    host = hosts.Host(tables[0], known, hosts.LINUX)
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


def main(folder):
    """Write the file; `folder` is ``data/layouts`` of WorldAlphabets."""
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
    windows, accents = {}, []
    for name in LAYOUTS:
        each = on_windows(name, folder)
        if each:
            own = [
                f"accent {dead} {' '.join(map(token, sum(pairs, ())))}"
                for dead, pairs in each[1].items()
            ]
            accents += [line for line in own if line not in accents]
            windows[name] = each[0], [accents.index(line) for line in own]
    lines = ["# Written by tools/host_layouts.py from facts of these packages:"]
    for package in PACKAGES:
        version = subprocess.check_output(["dpkg-query", "-Wf", "${Version}", package], text=True)
        lines.append(f"# {package} {version}")
    lines += [
        f"# Windows: {SOURCE}.",
        "# All have the licence MIT, X11's or its own.",
        "# A dead key, and pairs of the next character and what it becomes: on Linux, and in lines",
        "# 'accent', numbered from 0, on Windows. Then the hosts: name, name in XKB, locale; rows",
        "# of characters, see `hosts.Table`; numbers of the accents of Windows, and its rows.",
        *dead_lines,
        *accents,
    ]
    for name in LAYOUTS:
        lines += block(name, code_of, found[name], windows.get(name), dead_lines + accents)
    hosts.FILE.write_text("\n".join(lines) + "\n", "utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
