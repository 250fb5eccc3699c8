"""Compiles the tables of a layout file to the lines that a board stores."""

import re
from pathlib import Path
from typing import NoReturn

import msgspec

from spots_device.keys import layout as lines_of
from spots_device.keys.layout import FULL, LIMITS

from ..errors import FileError, SpotsError
from ..outputs.usages import CONSUMER, KEYBOARD, MODIFIERS_FROM, is_modifier, name_of, on_caps
from . import foreign, hosts, reach
from .key_layout import (
    FLAVORS,
    LAYER_VERBS,
    SLOTS,
    SWIPES,
    Behaviour,
    KeyLayout,
    PlacedKey,
    parts_of,
    typed,
)
from .layout_format import (
    CAPS_WORD,
    HOLD_TERMS,
    MACRO,
    NAMED,
    STICKY,
    TEXT,
    WORDS,
    KeyEntry,
    LayerEntry,
    LayoutFile,
    line_of,
)
from .writing import Writing

_LABEL_MAX = 12  # characters of a text on its key
_CAPS_LOCK_MS = 100  # a Mac ignores shorter presses
_STEPS_A_LINE = 40  # a line of a board has at most 255 characters


class Compiler:
    """Compiles one file; refuses with the line of the text that is wrong."""

    def __init__(self, path: Path, text: str, file: LayoutFile):
        self._path = path
        self._text = text
        self._file = file
        self._names = [layer.name for layer in file.layer]
        self._behaviours: list[Behaviour] = []
        self._open: set[str] = set()  # behaviours whose actions are being read
        self._texts: dict[str, tuple[int, ...]] = {}
        self._steps: list[int] = []  # of all texts

    def layout(self) -> KeyLayout:
        twice = {name for name in self._names if self._names.count(name) > 1}
        if twice:
            self._refuse(min(twice), f"two layers are called '{min(twice)}': rename one of them")
        tuning = msgspec.structs.asdict(self._file.tuning)
        tuning["flavor"] = FLAVORS.index(tuning["flavor"])
        if self._file.os == hosts.MAC:
            tuning["caps_lock_ms"] = tuning["caps_lock_ms"] or _CAPS_LOCK_MS
        self._tuning = tuning
        try:
            self._writing = Writing(self._file.host, self._file.os)
        except SpotsError as error:
            self._refuse(self._file.host, str(error))
        lines = [f"{name} {tuning[name]}" for name in LIMITS]
        layers, swipes, used, rest = {}, {}, set(), []
        for layer in self._file.layer:
            own = swipes[layer.name] = {
                name: self._action(getattr(layer, name), layer.name, name) for name in SWIPES
            }
            keys = layers[layer.name] = self._keys(layer)
            used.update(own.values(), *(key.actions.values() for key in keys))
            rest.append("layer {} {}".format(*own.values()))
            for i, key in enumerate(keys, 1):
                bounds = round(FULL * key.low), round(FULL * key.high)
                if not bounds[0] < bounds[1]:
                    self._refuse(
                        layer.name,
                        f"in layer '{layer.name}', key {i}: too narrow: increase its width, or "
                        "reduce gap_percent",
                    )
                rest.append("key " + " ".join(map(str, (*bounds, *key.actions.values()))))
        self._check_steps()
        for i in range(0, len(self._steps), _STEPS_A_LINE):
            lines.append(" ".join(map(str, ("text", *self._steps[i : i + _STEPS_A_LINE]))))
        for i, one in enumerate(self._behaviours):
            lines.append(" ".join(map(str, ("behaviour", i, *one.numbers))))
            used.update(one.actions)
        lines += rest
        self._check_ways(layers, used)
        try:
            lines_of.parse(lines)
        except lines_of.LayoutError as error:
            raise FileError(f"layout {self._path}: {error}", self._path) from None
        content = msgspec.to_builtins(self._file)
        typed = frozenset(one for one in used if parts_of(one)[0] in (KEYBOARD, CONSUMER))
        parts = self._file.name, layers, swipes, lines, typed, self._behaviours
        problems = reach.problems(layers, swipes, self._behaviours, tuning) + [
            f"[{verb}.{name}] can never be typed: no key uses it"
            for verb in NAMED
            for name in getattr(self._file, verb)
            if all(one.text != f"{verb} {name}" for one in self._behaviours)
        ]
        return KeyLayout(*parts, problems, self._text, self._writing.shown, self._texts, content)

    def _keys(self, layer: LayerEntry) -> list[PlacedKey]:
        keys = [
            self._entry(key, f"in layer '{layer.name}', key {i}")
            for i, key in enumerate(layer.keys, 1)
        ]
        whole = sum(key.width for key in keys)
        placed, begin = [], 0.0
        for i, key in enumerate(keys):
            end = begin + key.width
            gap = layer.gap_percent / 200
            where = f"key {i + 1}"
            actions = {slot: self._action(getattr(key, slot), layer.name, where) for slot in SLOTS}
            actions["tap"] = self._tap(key, actions["tap"], layer.name, where)
            actions["hold"] = self._hold(key, actions["hold"], layer.name, where)
            # There is no gap at the ends of the strip.
            low, high = begin + (gap if i else 0), end - (gap if i + 1 < len(keys) else 0)
            label = self._label(actions) if key.label is None else key.label
            placed.append(PlacedKey(low / whole, high / whole, label, actions))
            begin = end
        return placed

    def _entry(self, key: str | KeyEntry, at: str) -> KeyEntry:
        if isinstance(key, KeyEntry):
            return key
        found = self._foreign(key, at)
        return KeyEntry(tap=found.tap, hold=found.hold) if found else KeyEntry(tap=key)

    def _foreign(self, text: str, at: str) -> foreign.Foreign | None:
        try:
            return foreign.translated(text, self._names)
        except SpotsError as error:
            self._refuse(text, f"{at}: {error}")

    def _tap(self, key: KeyEntry, action: int, layer: str, where: str) -> int:
        if bool(key.tap) + bool(key.text) + bool(key.macro) > 1:
            self._refuse(
                key.tap or key.text, f"in layer '{layer}', {where}: use one of tap, text and macro"
            )
        at = f"in layer '{layer}', {where}"
        if key.text:
            steps_of = self._writing.text
            return self._typed(f"{TEXT} {key.text}", key.text, steps_of, key.text, at)
        if key.macro:
            return self._macro(f"{MACRO} [{', '.join(key.macro)}]", key.macro, at)
        return action

    def _hold(self, key: KeyEntry, action: int, layer: str, where: str) -> int:
        terms = [getattr(key, name) for name in HOLD_TERMS]
        if key.flavor is None and not key.retro_tap and terms == [None] * len(terms):
            return action
        if not action:
            self._refuse(
                layer, f"in layer '{layer}', {where}: flavor and terms are those of a hold: add one"
            )
        tuning = self._tuning
        flavor = tuning["flavor"] if key.flavor is None else FLAVORS.index(key.flavor)
        flavor += lines_of.RETRO_TAP * key.retro_tap
        terms = [tuning[name] if term is None else term for name, term in zip(HOLD_TERMS, terms)]
        return self._behave(key.hold, lines_of.HOLD_TAP, flavor, *terms, action)

    def _action(self, text: str, layer: str, where: str) -> int:
        if not text:
            return 0
        at = f"in layer '{layer}', {where}" if layer else where
        found = self._foreign(text, at)
        if found and found.hold:
            self._refuse(
                text,
                f"{at}: '{text}' is a whole key: write tap = '{found.tap}', hold = '{found.hold}'",
            )
        if found:
            return self._action(found.tap, layer, where)
        verb, _, name = text.partition(" ")
        if text in WORDS:
            table = self._writing.caps_word() if text == CAPS_WORD else ()
            return self._behave(text, WORDS[text], *table)
        if verb in LAYER_VERBS:
            return self._layer_action(verb, name, text, at)
        if verb == STICKY:
            after_ms = self._tuning["release_after_ms"]
            if name in self._names:
                action = self._layer_action("momentary", name, text, at)
            else:
                action = self._chord(name, text, at, f" and no layer; layers are {self._known}")
            return self._behave(text, lines_of.STICKY, after_ms, action)
        if verb in NAMED:
            return self._named(verb, name, text, at)
        if verb == TEXT and name:
            return self._typed(text, text, self._writing.text, name, at)
        if verb == MACRO:
            if name not in self._file.macro:
                self._refuse(text, f"{at}: [macro] has no '{name}': add it, or change the name")
            return self._macro(text, self._file.macro[name], f"in [macro], '{name}'")
        try:
            actions = self._writing.actions(text)
        except SpotsError as error:
            self._refuse(text, f"{at}: {error}")
        if len(actions) == 1:
            return actions[0]
        return self._typed(f"{TEXT} {text}", text, self._writing.text, text, at)

    def _macro(self, text: str, parts: list[str], at: str) -> int:
        wrong = next((part for part in parts if self._is_behaviour(part)), None)
        if wrong:
            self._refuse(
                wrong, f"{at}: '{wrong}' is no key: a macro has keys, text, wait, press and release"
            )
        parts = [found.tap if (found := self._foreign(part, at)) else part for part in parts]
        shown = text if text.endswith("]") else f"{text} [{', '.join(parts)}]"
        return self._typed(shown, parts[0], self._writing.macro, parts, at)

    def _is_behaviour(self, part: str) -> bool:
        verb = part.partition(" ")[0]
        return part in WORDS or verb in (*LAYER_VERBS, STICKY, *NAMED, MACRO)

    def _typed(self, text: str, value: str, steps_of, content, at: str) -> int:
        text = escaped(text)
        try:
            steps = tuple(steps_of(content))
        except SpotsError as error:
            self._refuse(escaped(value), f"{at}: {error}")
        if text not in self._texts:
            self._texts[text] = steps
            self._behaviours.append(Behaviour(text, (lines_of.TEXT, len(self._steps), len(steps))))
            self._steps += steps
        known = [one.text for one in self._behaviours]
        return lines_of.action(lines_of.BEHAVIOUR, known.index(text))

    def _check_steps(self) -> None:
        most = lines_of.STEPS_MAX
        if len(self._steps) > most:
            longest = max(self._texts, key=lambda text: len(self._texts[text]))
            self._refuse(
                longest.partition(" ")[2],
                f"the texts press {len(self._steps)} keys, and a board has room for {most}: "
                f"shorten them, for example '{longest[:30]}'",
            )

    @property
    def _known(self) -> str:
        return ", ".join(self._names)

    def _layer_action(self, verb: str, name: str, text: str, at: str) -> int:
        if name not in self._names:
            self._refuse(text, f"{at}: no layer is called '{name}'; valid names are {self._known}")
        number = self._names.index(name)
        if verb != "to" and number == 0:
            self._refuse(text, f"{at}: the first layer is always on: use 'to {name}'")
        return lines_of.action(LAYER_VERBS[verb], number)

    def _chord(self, name: str, text: str, at: str, also: str = "") -> int:
        try:
            actions = self._writing.actions(name)
        except SpotsError as error:
            self._refuse(text, f"{at}: {error}{also}")
        if len(actions) > 1:
            self._refuse(text, f"{at}: '{name}' needs several keys: use another character")
        return actions[0]

    def _named(self, verb: str, name: str, text: str, at: str) -> int:
        table = getattr(self._file, verb)
        if name not in table or text in self._open:
            why = "refers to itself" if text in self._open else "does not exist"
            self._refuse(text, f"{at}: [{verb}.{name}] {why}: add this table, or change the name")
        self._open.add(text)
        one, where = table[name], f"in [{verb}.{name}]"
        if verb == "tap_dance":
            term_ms = one.tapping_term_ms or self._tuning["tapping_term_ms"]
            many = len(one.actions)
            if len(one.holds) > many:
                self._refuse(text, f"{where}: there are more holds than actions: remove some")
            holds = [*one.holds, *[""] * (many - len(one.holds))] if one.holds else []
            actions = [self._action(action, "", where) for action in (*one.actions, *holds)]
            found = self._behave(text, lines_of.TAP_DANCE, term_ms, many, *actions)
        else:
            mods, kept = (self._bits(names, where) for names in (one.mods, one.keep_mods))
            actions = [self._action(action, "", where) for action in (one.action, one.morphed)]
            found = self._behave(text, lines_of.MOD_MORPH, mods, kept, *actions)
        self._open.discard(text)
        return found

    def _bits(self, names: list[str], where: str) -> int:
        bits = 0
        for name in names:
            page, usage, chord = parts_of(self._chord(name, name, where))
            if not is_modifier(page, usage):
                self._refuse(name, f"{where}: '{name}' is no modifier: use one such as LEFT_SHIFT")
            bits |= chord | 1 << usage - MODIFIERS_FROM
        return bits

    def _behave(self, text: str, *numbers: int) -> int:
        one = Behaviour(text, numbers)
        if one not in self._behaviours:
            self._behaviours.append(one)
        return lines_of.action(lines_of.BEHAVIOUR, self._behaviours.index(one))

    def _label(self, actions: dict[str, int]) -> str:
        """Return the label of a key: the characters that its actions type, or its first action."""
        shown = actions["tap"], actions["firm"], actions["hold"]
        written = [self._written(action) for action in shown if action]
        characters = [text for text in written if len(text) == 1]
        return " ".join(characters) if len(characters) > 1 else written[0] if written else ""

    def _written(self, action: int) -> str:
        kind, number, modifiers = parts_of(action)
        if kind == lines_of.BEHAVIOUR:
            one = self._behaviours[number]
            if one.numbers[0] in (lines_of.HOLD_TAP, lines_of.STICKY):
                return self._written(one.actions[-1])
            if one.numbers[0] == lines_of.TEXT:
                words = one.text.partition(" ")[2].split()
                return " ".join(words)[:_LABEL_MAX] or one.text
            return one.text.rpartition(" ")[2].replace("_", " ")
        if kind in LAYER_VERBS.values():
            return self._names[number]
        shown = self._writing.shown
        if action in shown:
            return shown[action]
        key = shown.get(lines_of.action(kind, number)) or typed(kind, number, self._writing.host)
        return on_caps(modifiers) + (key or name_of(kind, number))

    def _check_ways(self, layers: dict[str, list[PlacedKey]], used: set[int]) -> None:
        verbs = LAYER_VERBS.values()
        reached = {0} | {number for kind, number, _ in map(parts_of, used) if kind in verbs}
        leaves = {lines_of.TOGGLE, lines_of.TO}
        for number, name in enumerate(self._names):
            if number not in reached:
                self._refuse(name, f"no key leads to layer '{name}': add 'toggle {name}' to a key")
        for number, name in enumerate(self._names[1:], 1):
            there = {
                parts_of(one)[0]
                for key in layers[name]
                for slot in key.actions.values()
                for one in reach.causes(slot, self._behaviours)
            }
            comes = {lines_of.action(verb, number) for verb in leaves}
            if comes & used and not leaves & there:
                first = self._names[0]
                self._refuse(
                    name,
                    f"no key leaves layer '{name}': add 'toggle {name}' or 'to {first}' to one of "
                    "its keys",
                )

    def _refuse(self, value: str, why: str) -> NoReturn:
        line = line_of(self._text, rf"""(["']){re.escape(value)}\1""")
        raise FileError(f"layout {self._path}{line}: {why}", self._path, line[2:]) from None


def escaped(text: str) -> str:
    """Return a text with the escapes of TOML for line feeds, tabs and no-break spaces."""
    return "".join(one if one.isprintable() else repr(one)[1:-1] for one in text)
