"""A simulated typist: converts text to touches of a strip; also converts key events to text."""

from __future__ import annotations

from collections import deque

import numpy as np

from spots.errors import SettingError
from spots.keyboard.hosts import ALT_GR, KEYS, SHIFT, Host, Stroke
from spots.keyboard.key_layout import KeyLayout, PlacedKey, parts_of
from spots.outputs.usages import KEYBOARD, USAGES, name_of, on_caps, usage_of
from spots_device.keys import layout as lines_of

from ..strip.files import Finger, ScenarioFile
from .hands import USUAL, Hands
from .times import PEOPLE, at_speed

_LEVELS = 0x62  # bits of shift and AltGr
_SHIFT = 0x22  # bits of the left and the right shift key
_SHIFTED = dict(zip("1234567890-=[]\\;'`,./", '!@#$%^&*()_+{}|:"~<>?'))
_CHARACTERS = {" ": "SPACEBAR", "\n": "ENTER"}
_RISE_S, _FIRM_MN = 0.02, 7000.0
_HELD_S = (0.07, 0.14)  # shortest and longest touch
# A palm that rests at the far end: distance from this end, width, and durations. All *assumed*.
_PALM_OFF_MM, _PALM_WIDE_MM, _PALM_RAMP_S, _SETTLED_S = 6.0, 12.0, 0.1, 1.0


class TypedText:
    """Converts key events to the text that a computer would show.

    A key without a character appears as its name in angle brackets. `down` has HID usage page and
    usage of each pressed key. Without a host, the computer is American.
    """

    def __init__(self, host: Host | None = None):
        self.text = ""
        self._host = host
        self._dead: tuple[Stroke, ...] = ()  # dead keys that wait for the next key
        self.down: set[tuple[int, int]] = set()
        self.presses = 0

    def key(self, page: int, usage: int, modifiers: int, pressed: bool) -> None:
        if not pressed:
            self.down.discard((page, usage))
            return
        self.down.add((page, usage))
        self.presses += 1
        name = name_of(page, usage)
        if name == "BACKSPACE":
            self.text = self.text[:-1]
        elif self._host is None or page != KEYBOARD or usage not in KEYS or modifiers & ~_LEVELS:
            self.text += _character(page, usage, modifiers) or f"<{on_caps(modifiers)}{name}>"
        else:
            self.text += self._on_host(self._host, usage, modifiers)

    def _on_host(self, host: Host, usage: int, modifiers: int) -> str:
        bits = SHIFT * bool(modifiers & _SHIFT) | modifiers & ALT_GR
        stroke = Stroke(bits, usage)
        typed = host.typed(stroke)
        made = host.made((*self._dead, stroke)) if self._dead else ""
        if len(typed) > 1 and not made:
            self._dead = (*self._dead, stroke)
            return ""
        self._dead = ()
        return made or typed or f"<{on_caps(modifiers)}{name_of(KEYBOARD, usage)}>"


def _character(page: int, usage: int, modifiers: int) -> str | None:
    by_name = {name: character for character, name in _CHARACTERS.items()}
    known = USAGES.get((page, usage))
    if known is None or modifiers & ~_SHIFT:
        return None
    if known.name in by_name:
        return by_name[known.name]
    character = known.pynput
    if page != KEYBOARD or character is None or len(character) != 1:
        return None
    if not modifiers:
        return character
    return _SHIFTED.get(character, character.upper())


class Typist:
    """Converts text to a scenario of fingers with random position, force and duration.

    `pause_s` is the shortest and longest pause after a touch.
    """

    def __init__(
        self,
        layout: KeyLayout,
        length_mm: float,
        rng,
        pause_s: tuple[float, float] = (0.12, 0.3),
        start_s: float = 0.5,
    ):
        self._layout = layout
        self._length_mm = length_mm
        self._rng = rng
        self._pause_s = pause_s
        self._rows = list(layout.layers.values())
        # A compiled layout has one line for each of its limits.
        said = (line.split() for line in layout.lines)
        self._limits = {words[0]: int(words[1]) for words in said if words[0] in lines_of.LIMITS}
        self.touches: list[Finger] = []
        self.seconds = start_s

    def type(self, text: str) -> None:
        """Add to the scenario the touches that type a text.

        SpotsError if the layout has no key for a character.
        """
        for character in text:
            for layer, key, slot in self._way(character):
                self.do(self._rows[layer][key], slot)

    def do(self, key: PlacedKey, slot: str = "tap") -> None:
        """Add a touch that triggers an action of a key, at a random position on the key.

        The action `slot` is ``tap``, ``hold``, ``firm`` or ``double``.
        """
        margin = 0.1 * (key.high - key.low)
        share = self._rng.uniform(key.low + margin, key.high - margin)
        limits = self._limits
        held_s = self._rng.uniform(*_HELD_S)
        force_mN = self._rng.uniform(1000, 2500)
        if slot == "firm":
            force_mN = _FIRM_MN
        elif slot == "hold":
            held_s = limits["tapping_term_ms"] / 1000 + 0.1
        self.press(share, held_s, force_mN)
        if slot == "double":
            self.seconds += self._rng.uniform(0.06, 0.12)
            self.press(share, held_s, force_mN)
        pause_s = self._rng.uniform(*self._pause_s)
        if key.actions["hold"]:
            pause_s = max(pause_s, limits["quick_tap_ms"] / 1000 - _HELD_S[0] + 0.04)
        if key.actions["double"]:
            pause_s = max(pause_s, limits["double_ms"] / 1000 + 0.05)
        self.seconds += pause_s

    def press(self, share: float, held_s: float, force_mN: float) -> None:
        """Add a touch of one finger to the scenario, at a share of the length, 0 at the sensor.

        During `held_s`, the force is above half of its maximum `force_mN`.
        """
        start_s = self.seconds
        x_mm = share * self._length_mm
        times = (0, _RISE_S, held_s, held_s + _RISE_S)
        forces = (0, force_mN, force_mN, 0)
        points = [(start_s + after_s, x_mm, force) for after_s, force in zip(times, forces)]
        self.touches.append(Finger(points=points))
        self.seconds = points[-1][0]

    def scenario(self) -> ScenarioFile:
        """Return all touches as a scenario that ends half a second after the last pause."""
        return ScenarioFile(seconds=self.seconds + 0.5, touch=self.touches)

    def _way(self, character: str) -> list[tuple[int, int, str]]:
        """Return the keys to press for a character: keys that change the layer come first.

        Each key is a tuple: layer, index of the key in the layer, and `slot` as in `do`.
        """
        wanted = _action_of(character)
        waiting = deque([(0, [])])
        seen = {0}
        while waiting:
            layer, way = waiting.popleft()
            for i, key in enumerate(self._rows[layer]):
                for slot, action in key.actions.items():
                    if action == wanted:
                        return [*way, (layer, i, slot)]
                    there = self._sticky_layer(action)
                    if there is not None and there not in seen:
                        seen.add(there)
                        waiting.append((there, [*way, (layer, i, slot)]))
        raise SettingError(f"the layout '{self._layout.name}' has no key for '{character}'")

    def _sticky_layer(self, action: int) -> int | None:
        kind, number, _ = parts_of(action)
        if kind != lines_of.BEHAVIOUR:
            return None
        one = self._layout.behaviours[number]
        kind, layer, _ = parts_of(one.actions[-1]) if one.actions else (0, 0, 0)
        is_sticky = one.numbers[0] == lines_of.STICKY and kind == lines_of.MOMENTARY
        return layer if is_sticky else None


def _action_of(character: str) -> int:
    unshifted = {shifted: plain for plain, shifted in _SHIFTED.items()}
    modifiers = 0
    if character in unshifted:
        character, modifiers = unshifted[character], 2
    page, usage = usage_of(_CHARACTERS.get(character, character))
    return lines_of.action(page, usage, modifiers)


def fast_typing(
    layout: KeyLayout,
    words_per_min: float | None,
    touches: int,
    length_mm: float,
    seed: int = 0,
    start_s: float = 3.0,
    hands: Hands = USUAL,
) -> ScenarioFile:
    """Return the scenario of a person who types random keys with the times of real people.

    Many touches overlap the next one, see `times`. A touch that overlaps others is on one of the
    keys that another finger can reach. Only keys of the first layer are typed, and each with a tap.
    A word has five keys; with `words_per_min` None, one of the ten people in `times.PEOPLE` types
    at the own speed: number `seed` modulo 10. A random delay of up to 10 ms (one exposure) is added
    to `start_s`. The scenario ends half a second after the last touch.
    """
    rng = np.random.default_rng(seed)
    habits = np.random.default_rng((seed, 1))
    times = at_speed(words_per_min) if words_per_min else PEOPLE[seed % len(PEOPLE)]
    now_s = start_s + rng.uniform(0.0, 0.01)
    fingers: list[Finger] = []
    palm_mm, palm_s = length_mm - _PALM_OFF_MM, now_s
    taken = []  # positions with the times until which no other finger can be there
    if hands.palm_mN:
        taken.append((palm_mm, np.inf))
        now_s += _SETTLED_S
    for _ in range(touches):
        x_mm, now_s = _free_place(layout, length_mm, hands.apart_mm, taken, now_s, rng)
        held_s = times.held_s(rng)
        points = _tap(now_s, x_mm, held_s, hands, rng)
        fingers.append(_finger(points, length_mm, hands, habits))
        end_s, rolled_mm, _ = points[-1]
        taken.append((rolled_mm, end_s + hands.same_s))
        now_s += times.interval_s(rng)
    end_s = max(finger.points[-1][0] for finger in fingers) + 0.5
    if hands.palm_mN:
        times_s = palm_s, palm_s + _PALM_RAMP_S, end_s, end_s + _PALM_RAMP_S
        forces_mN = 0.0, hands.palm_mN, hands.palm_mN, 0.0
        points = [(time_s, palm_mm, force_mN) for time_s, force_mN in zip(times_s, forces_mN)]
        wobble = hands.palm_wobble_percent
        fingers.insert(0, Finger(points=points, width_mm=_PALM_WIDE_MM, tremor_percent=wobble))
        end_s += 0.5
    return ScenarioFile(seconds=end_s, touch=fingers)


def _free_place(layout: KeyLayout, length_mm: float, apart_mm: float, taken, now_s: float, rng):
    # Returns a random position on a random key that no finger is near, and the time of the touch in
    # s: `now_s`, or later if fingers are near all keys.
    keys = [key for key in next(iter(layout.layers.values())) if key.actions["tap"]]
    while True:
        taken[:] = [one for one in taken if one[1] > now_s]
        for i in rng.permutation(len(keys)):
            middle, half = (keys[i].low + keys[i].high) / 2, 0.4 * (keys[i].high - keys[i].low)
            x_mm = length_mm * (middle + half * np.clip(rng.normal(0, 0.5), -1, 1))
            if all(abs(other_mm - x_mm) >= apart_mm for other_mm, _ in taken):
                return x_mm, now_s
        now_s = min(until_s for _, until_s in taken)


def two_fingers(
    layout: KeyLayout, touches: int, length_mm: float, seed: int = 0, start_s: float = 3.0
) -> ScenarioFile:
    """Return the scenario of a person who touches two keys with two fingers at the same time.

    The fingers of a pair are 9 to 60 mm apart. The second finger touches 30 to 150 ms after the
    first one, and both rest for 60 to 200 ms. Then one of them lifts, and the other one 60 to 200
    ms later. All values are random, and all but the force are *assumed*. Only keys of the first
    layer are touched, and each with a tap. A random delay of up to 10 ms is added to `start_s`.
    """
    rng = np.random.default_rng(seed)
    hands = USUAL
    now_s = start_s + rng.uniform(0.0, 0.01)
    fingers: list[Finger] = []
    while len(fingers) < touches:
        first_mm, second_mm = (length_mm * _place(layout, rng) for _ in range(2))
        if not 9 <= abs(second_mm - first_mm) <= 60:
            continue
        both_s = now_s + rng.uniform(0.03, 0.15)
        ends_s = both_s + np.cumsum(rng.uniform(0.06, 0.2, 2))
        for x_mm, began_s, end_s in zip(
            (first_mm, second_mm), (now_s, both_s), rng.permutation(ends_s)
        ):
            rise_s, fall_s = rng.uniform(*hands.rise_s), rng.uniform(*hands.lift_s)
            force_mN = hands.force_mN * np.exp(hands.force_spread * rng.normal())
            points = [
                (began_s, x_mm, 0.0),
                (began_s + rise_s, x_mm, force_mN),
                (end_s, x_mm, force_mN),
                (end_s + fall_s, x_mm, 0.0),
            ]
            fingers.append(_finger(points, length_mm, hands, rng))
        now_s = ends_s[-1] + rng.uniform(0.3, 0.4)
    return ScenarioFile(seconds=float(now_s) + 1.0, touch=fingers)


def together(
    layout: KeyLayout,
    touches: int,
    length_mm: float,
    seed: int = 0,
    apart_mm: tuple[float, float] = (20.0, 45.0),
    alone: bool = False,
    start_s: float = 3.0,
) -> ScenarioFile:
    """Return the scenario of a person whose fingers touch two keys together, again and again.

    The distance of the two fingers is within `apart_mm`; the second one touches 0 to 15 ms after
    the first one. A touch of one finger follows each pair and comes before the first one, except
    with `alone`. Each touch lasts as long as one of a random person of `times.PEOPLE`; pauses are
    120 to 250 ms (*assumed*). Only keys of the first layer are touched, and each with a tap.
    """
    rng = np.random.default_rng((seed, 2))
    now_s = start_s + rng.uniform(0.0, 0.01)
    fingers: list[Finger] = []
    places_mm = [] if alone else [length_mm * _place(layout, rng)]
    while len(fingers) < touches:
        ends_s = []
        for x_mm in places_mm:
            held_s = PEOPLE[rng.integers(len(PEOPLE))].held_s(rng)
            began_s = now_s + (rng.uniform(0.0, 0.015) if ends_s else 0.0)
            points = _tap(began_s, x_mm, held_s, USUAL, rng)
            fingers.append(_finger(points, length_mm, USUAL, rng))
            ends_s.append(points[-1][0])
        now_s = max(ends_s, default=now_s) + rng.uniform(0.12, 0.25)
        if len(places_mm) == 2 and not alone:
            places_mm = [length_mm * _place(layout, rng)]
            continue
        while True:
            places_mm = [length_mm * _place(layout, rng) for _ in range(2)]
            if apart_mm[0] <= abs(places_mm[1] - places_mm[0]) <= apart_mm[1]:
                break
    return ScenarioFile(seconds=float(now_s) + 1.0, touch=fingers)


def _tap(began_s: float, x_mm: float, held_s: float, hands: Hands, rng) -> list[tuple]:
    # Returns the path of a finger that taps: times in s, positions in mm, forces in mN.
    rise_s, fall_s = (
        min(rng.uniform(*limits), hands.ramp_share * held_s)
        for limits in (hands.rise_s, hands.lift_s)
    )
    force_mN = hands.force_mN * np.exp(hands.force_spread * rng.normal())
    force_mN = float(np.clip(force_mN, 800, 6000))
    rolled_mm = x_mm + rng.normal(0, hands.roll_mm)
    end_s = began_s + held_s
    return [
        (began_s, x_mm, 0.0),
        (began_s + rise_s, x_mm, force_mN),
        (end_s - fall_s, rolled_mm, force_mN),
        (end_s, rolled_mm, 0.0),
    ]


def _place(layout: KeyLayout, rng) -> float:
    # Returns a random position within the inner 80 % of a key, as a share of the length.
    keys = [key for key in next(iter(layout.layers.values())) if key.actions["tap"]]
    key = keys[rng.integers(len(keys))]
    return (key.low + key.high) / 2 + rng.uniform(-0.4, 0.4) * (key.high - key.low)


def _finger(points, length_mm: float, hands: Hands, rng) -> Finger:
    # Returns the finger with this path and with random movements of these hands.
    roll_mm, slide_mm, tremor_percent, width_mm = (
        float(rng.uniform(*limits))
        for limits in (hands.rolls_mm, hands.slides_mm, hands.tremor_percent, hands.width_mm)
    )
    # The direction is random, but the finger does not leave the strip.
    farthest_mm = roll_mm + slide_mm
    direction = -1 if rng.random() < 0.5 else 1
    if not 0 <= points[-1][1] + direction * farthest_mm <= length_mm:
        direction = -direction
    return Finger(
        points=[tuple(map(float, point)) for point in points],
        width_mm=width_mm,
        roll_mm=direction * roll_mm,
        slide_mm=direction * slide_mm,
        tremor_percent=tremor_percent,
    )


def typing(
    layout: KeyLayout, text: str, length_mm: float, seed: int = 0, start_s: float = 0.5
) -> ScenarioFile:
    """Return the scenario of a person who types a text.

    SpotsError if the layout has no key for a character.
    """
    typist = Typist(layout, length_mm, np.random.default_rng(seed), start_s=start_s)
    typist.type(text)
    return typist.scenario()
