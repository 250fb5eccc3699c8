"""Finds the keys and actions of a layout that can never be typed."""

from collections.abc import Iterator
from typing import Any

from spots_device.keys import layout as lines_of
from spots_device.usb.usages import MODIFIERS_FROM

_FINGERS_MAX = 2  # all but one of them can hold a layer
_STICKY = -1  # not the number of a kind of actions


def causes(action: int, behaviours: list) -> Iterator[int]:
    """Yield an action, and all actions that its behaviours may cause; 0 causes nothing.

    Actions are encoded by `spots_device.keys.layout.action`.
    """
    if not action:
        return
    yield action
    if action >> 20 == lines_of.BEHAVIOUR:
        for inner in behaviours[action & 0xFFF].actions:
            yield from causes(inner, behaviours)


def problems(
    layers: dict[str, list], swipes: dict[str, dict], behaviours: list, tuning: dict
) -> list[str]:
    """Return a sentence for each key or action that can never be typed.

    For keys whose layer is never on, all combinations of layers that one finger can reach are
    tried: what it switches, what is sticky, and what another finger holds. `swipes` and `tuning`
    have actions and `spots_device.keys.layout.LIMITS` by name.
    """
    off = _layers_off(layers, swipes, behaviours)
    found = []
    for name, keys in layers.items():
        for i, key in enumerate(keys, 1):
            label = f" ({key.label})" if key.label else ""
            where = f"layer '{name}', key {i}{label}"
            if name in off:
                found.append(
                    f"{where} can never be typed: a later layer stays on, or no key that can be "
                    "typed leads here"
                )
            else:
                of_key = _of_key(key.actions, any(swipes[name].values()), behaviours, tuning)
                found += [f"{where}: {what} can never be typed: {why}" for what, why in of_key]
    return found + list(_of_morphs(layers, swipes, behaviours))


def _of_key(
    actions: dict[str, int], has_swipes: bool, behaviours: list, tuning: dict
) -> Iterator[tuple[str, str]]:
    """Yield what can never be typed of a key that can be touched, and why."""
    term_ms, idle_ms = tuning["tapping_term_ms"], tuning["require_prior_idle_ms"]
    flavor = tuning["flavor"]
    hold, tap = _behaviour(actions["hold"], behaviours), _behaviour(actions["tap"], behaviours)
    if hold and hold[0] == lines_of.HOLD_TAP:
        flavor, term_ms, _, idle_ms = hold[1:5]
    waits = actions["hold"] or actions["double"]
    if has_swipes and waits and term_ms <= tuning["swipe_ms"]:
        for slot in ("slide_minus", "slide_plus"):
            if actions[slot]:
                yield (
                    slot,
                    f"the key is decided after tapping_term_ms ({term_ms} ms), and until swipe_ms "
                    f"({tuning['swipe_ms']} ms) a movement is a swipe: increase tapping_term_ms",
                )
    if actions["firm"] and 0 < tuning["firm_mN"] <= tuning["press_mN"]:
        for slot in ("tap", "double", "hold"):
            if actions[slot]:
                yield slot, "each touch is firm: set firm_mN to more than press_mN"
    if not tap or tap[0] != lines_of.TAP_DANCE:
        return
    if actions["double"] and tap[1] <= tuning["double_ms"]:
        yield (
            "what its tap_dance does after two taps",
            f"a second tap within double_ms ({tuning['double_ms']} ms) is the double tap: increase "
            "the tapping_term_ms of the dance, or remove the double tap",
        )
    held = tap[3 + tap[2] :]
    always_holds = flavor & ~lines_of.RETRO_TAP != lines_of.TAP_UNLESS_INTERRUPTED
    if actions["hold"] and always_holds and not idle_ms and held and held[0]:
        yield "the first of holds of its tap_dance", "a long touch is the hold of the key"


def _of_morphs(layers: dict[str, list], swipes: dict[str, dict], behaviours: list) -> Iterator[str]:
    """Yield a sentence for each mod-morph whose modifiers no key presses."""
    actions = [one for own in swipes.values() for one in own.values()]
    actions += [one for keys in layers.values() for key in keys for one in key.actions.values()]
    down = 0
    for each in (inner for one in actions for inner in causes(one, behaviours)):
        if each >> 20 == lines_of.KEYBOARD:
            usage = (each & 0xFFF) - MODIFIERS_FROM
            down |= each >> 12 & 0xFF | (1 << usage if 0 <= usage < 8 else 0)
    for one in behaviours:
        if one.numbers[0] == lines_of.MOD_MORPH and not one.numbers[1] & down:
            yield f"{one.text}: morphed can never be typed: no key of this layout presses its mods"


def _behaviour(action: int, behaviours: list) -> tuple[int, ...]:
    is_one = action >> 20 == lines_of.BEHAVIOUR
    return behaviours[action & 0xFFF].numbers if is_one else ()


def _layers_off(layers: dict[str, list], swipes: dict[str, dict], behaviours: list) -> set[str]:
    """Return the names of the layers that are never the last one that is on."""
    names = list(layers)
    offered: list[set[int]] = []
    for name in names:
        actions = [action for key in layers[name] for action in key.actions.values()]
        actions += swipes[name].values()
        offered.append({each for one in actions for each in _ways(one, behaviours)})
    seen, todo = set(), [(0, frozenset(), frozenset())]
    on_top = set()
    while todo:
        state = todo.pop()
        if state in seen:
            continue
        seen.add(state)
        on, held, sticky = state
        top = max([bit for bit in range(len(names)) if on >> bit & 1] + [0, *held, *sticky])
        on_top.add(top)
        todo += [(on, held - {layer}, sticky) for layer in held]
        todo.append((on, held, frozenset()))
        for kind, layer in offered[top]:
            if kind == lines_of.TOGGLE:
                todo.append((on ^ 1 << layer, held, sticky))
            elif kind == lines_of.TO:
                todo.append((1 << layer, frozenset(), frozenset()))
            elif kind == _STICKY:
                todo.append((on, held, sticky | {layer}))
            elif len(held) + 1 < _FINGERS_MAX:
                todo.append((on, held | {layer}, sticky))
    return {name for number, name in enumerate(names) if number not in on_top}


def _ways(action: int, behaviours: list) -> Iterator[tuple[int, int]]:
    # Yields (kind, layer) of the ways to a layer that an action has.
    kind, number = action >> 20, action & 0xFFF
    if kind == lines_of.BEHAVIOUR:
        one: Any = behaviours[number]
        for inner in one.actions:
            is_sticky = one.numbers[0] == lines_of.STICKY and inner >> 20 == lines_of.MOMENTARY
            yield from [(_STICKY, inner & 0xFFF)] if is_sticky else _ways(inner, behaviours)
    elif kind in (lines_of.MOMENTARY, lines_of.TOGGLE, lines_of.TO):
        yield kind, number
