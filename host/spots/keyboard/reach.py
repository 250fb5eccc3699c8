"""Finds the keys of a layout that can never be typed."""

from collections.abc import Iterator
from typing import Any

from spots_device.keys import layout as lines_of

_FINGERS_MAX = 2  # all but one of them can hold a layer
_STICKY = -1  # not the number of a kind of actions


def causes(action: int, behaviours: list) -> Iterator[int]:
    """Yield an action, and all actions that its behaviours may cause.

    Parameters
    ----------
    action : int
        Action as encoded by `spots_device.keys.layout.action`; 0 causes nothing.
    behaviours : list of layout.Behaviour
        Behaviours of the layout.

    Yields
    ------
    int
    """
    if not action:
        return
    yield action
    if action >> 20 == lines_of.BEHAVIOUR:
        for inner in behaviours[action & 0xFFF].actions:
            yield from causes(inner, behaviours)


def problems(layers: dict[str, list], swipes: dict[str, dict], behaviours: list) -> list[str]:
    """Return a sentence for each key that can never be typed, because its layer is never on.

    All combinations of layers that one finger can reach are tried: what it switches, what is
    sticky, and what another finger holds.

    Parameters
    ----------
    layers : dict of str to list of layout.PlacedKey
        Keys of each layer.
    swipes : dict of str to dict of str to int
        Actions of the swipes of each layer.
    behaviours : list of layout.Behaviour
        Behaviours of the layout.

    Returns
    -------
    list of str
    """
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
    found = []
    for number, name in enumerate(names):
        if number not in on_top:
            for i, key in enumerate(layers[name], 1):
                label = f" ({key.label})" if key.label else ""
                found.append(
                    f"layer '{name}', key {i}{label} can never be typed: a later layer stays on, "
                    "or no key that can be typed leads here"
                )
    return found


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
