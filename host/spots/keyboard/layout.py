"""Layout files: validates these TOML files and compiles them to the lines that a board stores.

A file contains layers, and a layer contains keys. A key is either the action of a tap, or a table
of actions: ``tap``, ``double``, ``hold``, ``firm``, ``slide_minus`` (towards the sensor) and
``slide_plus`` (away from the sensor). A layer may also contain an action for a swipe (a quick
movement along the strip) in each direction.

An action either presses a key of the computer, or selects a layer. To press a key, the action is
the key's name with modifiers (``LEFT_SHIFT+A``); `outputs.usages` has all names. To select a layer,
the action is ``layer NAME`` (as long as a finger holds this key of the strip), ``toggle NAME``
(until the next toggle) or ``once NAME`` (for one key).
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, NoReturn, Optional, Union

import msgspec

from spots_device.keys import layout as lines_of
from spots_device.keys.layout import FULL, LIMITS

from .. import kinds, toml
from ..errors import SpotsError
from ..outputs.usages import CONSUMER, KEYBOARD, USAGES, chord_of, name_of

FOLDER = Path(__file__).parent / "layouts"
SWIPES = ("swipe_minus", "swipe_plus")  # of a layer
SLOTS = ("tap", "double", "hold", "firm", "slide_minus", "slide_plus")
# Rules that decide between tap and hold, see docs/keyboard.md; the index is the firmware's number.
FLAVOURS = ("hold-preferred", "balanced", "tap-preferred")
LAYER_VERBS = {"layer": lines_of.MOMENTARY, "toggle": lines_of.TOGGLE, "once": lines_of.ONCE}
_Positive = Annotated[float, msgspec.Meta(gt=0, le=1000)]


class _Key(toml.Strict, omit_defaults=True):
    tap: str = ""
    double: str = ""
    hold: str = ""
    firm: str = ""
    slide_minus: str = ""
    slide_plus: str = ""
    width: _Positive = 1.0
    label: Optional[str] = None


class _Layer(toml.Strict, omit_defaults=True):
    name: str
    keys: Annotated[list[Union[str, _Key]], msgspec.Meta(min_length=1)]
    gap_percent: Annotated[float, msgspec.Meta(ge=0, le=80)] = 0.0
    swipe_minus: str = ""
    swipe_plus: str = ""


_Tuning = msgspec.defstruct(
    "_Tuning",
    [
        (name, Annotated[int, msgspec.Meta(ge=low, le=high)], default)
        for name, (low, high, default) in LIMITS.items()
        if name != "flavour"
    ]
    + [("flavour", Literal[FLAVOURS], FLAVOURS[LIMITS["flavour"][2]])],
    bases=(toml.Strict,),
    omit_defaults=True,
)


class _File(toml.Strict, omit_defaults=True):
    name: str
    layer: Annotated[list[_Layer], msgspec.Meta(min_length=1, max_length=lines_of.LAYERS_MAX)]
    tuning: _Tuning = _Tuning()


@dataclass(frozen=True)
class PlacedKey:
    """A key with its zone on the strip.

    Attributes
    ----------
    low, high : float
        Start and end of the zone, as shares (0 to 1) of the strip's length from the sensor.
    label : str
        Text on the key.
    actions : dict of str to int
        Action for each name in `SLOTS`, as encoded by `spots_device.keys.layout.action`.
    """

    low: float
    high: float
    label: str
    actions: dict[str, int]


@dataclass(frozen=True)
class KeyLayout:
    """A validated layout.

    Attributes
    ----------
    name : str
        Name of the layout.
    layers : dict of str to list of PlacedKey
        Keys by the name of their layer; layers and keys are in the order of the file.
    swipes : dict of str to dict of str to int
        Action for each name in `SWIPES`, by the name of the layer.
    lines : list of str
        The layout as the board stores it, see `spots_device.keys.layout`.
    typed : frozenset of int
        All actions in the layout that press a key of the computer, as encoded by
        `spots_device.keys.layout.action`.
    text : str
        Text of the layout file.
    content : dict
        Parsed content of the file, without the TOML keys whose values are the defaults.
    """

    name: str
    layers: dict[str, list[PlacedKey]]
    swipes: dict[str, dict[str, int]]
    lines: list[str]
    typed: frozenset[int]
    text: str
    content: dict


def load(name: str | Path) -> KeyLayout:
    """Read a layout file.

    Parameters
    ----------
    name : str or Path
        Path of the file, or name of a layout in the package, such as ``mini``.

    Raises
    ------
    SpotsError
        If the file does not exist or is invalid; the message names the place and the remedy.
    """
    return compiled(*toml.find(name, FOLDER, "layout"))


def compiled(path: Path, text: str) -> KeyLayout:
    """Validate and compile the text of a layout file.

    Parameters
    ----------
    path : Path
        Path of the file, for error messages.
    text : str
        Content of the file.

    Returns
    -------
    KeyLayout

    Raises
    ------
    SpotsError
        If the text is invalid; the message names the place and the remedy.
    """
    try:
        file = toml.convert(toml.loads(text), _File)
    except msgspec.ValidationError as error:
        kinds.check(path, text, "a layout file")
        line = _line_of_key(text, getattr(error, "keys", []))
        raise SpotsError(f"layout {path}{line}: {error}") from None
    return _Compiler(path, text, file).layout()


class _Compiler:
    def __init__(self, path: Path, text: str, file: _File):
        self._path = path
        self._text = text
        self._file = file
        self._names = [layer.name for layer in file.layer]

    def layout(self) -> KeyLayout:
        twice = {name for name in self._names if self._names.count(name) > 1}
        if twice:
            self._refuse(min(twice), f"two layers are called '{min(twice)}': rename one of them")
        tuning = msgspec.structs.asdict(self._file.tuning)
        tuning["flavour"] = FLAVOURS.index(tuning["flavour"])
        lines = [f"{name} {tuning[name]}" for name in LIMITS]
        layers, swipes, used = {}, {}, set()
        for layer in self._file.layer:
            own = swipes[layer.name] = {
                name: self._action(getattr(layer, name), layer, name) for name in SWIPES
            }
            keys = layers[layer.name] = self._keys(layer)
            used.update(own.values(), *(key.actions.values() for key in keys))
            lines.append("layer {} {}".format(*own.values()))
            for i, key in enumerate(keys, 1):
                bounds = round(FULL * key.low), round(FULL * key.high)
                if not bounds[0] < bounds[1]:
                    self._refuse(
                        layer.name,
                        f"in layer '{layer.name}', key {i} is too narrow: increase its width, or "
                        "reduce gap_percent",
                    )
                lines.append("key " + " ".join(map(str, (*bounds, *key.actions.values()))))
        self._check_ways(layers, used)
        try:
            lines_of.Layout(lines)
        except lines_of.LayoutError as error:
            raise SpotsError(f"layout {self._path}: {error}") from None
        content = msgspec.to_builtins(self._file)
        typed = frozenset(one for one in used if parts_of(one)[0] in (KEYBOARD, CONSUMER))
        return KeyLayout(self._file.name, layers, swipes, lines, typed, self._text, content)

    def _keys(self, layer: _Layer) -> list[PlacedKey]:
        keys = [_Key(tap=key) if isinstance(key, str) else key for key in layer.keys]
        whole = sum(key.width for key in keys)
        placed, begin = [], 0.0
        for i, key in enumerate(keys):
            end = begin + key.width
            gap = layer.gap_percent / 200
            actions = {
                slot: self._action(getattr(key, slot), layer, f"key {i + 1}") for slot in SLOTS
            }
            # There is no gap at the ends of the strip.
            low, high = begin + (gap if i else 0), end - (gap if i + 1 < len(keys) else 0)
            label = self._label(actions) if key.label is None else key.label
            placed.append(PlacedKey(low / whole, high / whole, label, actions))
            begin = end
        return placed

    def _action(self, text: str, layer: _Layer, where: str) -> int:
        if not text:
            return 0
        where = f"in layer '{layer.name}', {where}"
        verb, _, name = text.partition(" ")
        if verb in LAYER_VERBS:
            if name not in self._names:
                known = ", ".join(self._names)
                why = f"{where}: no layer is called '{name}'; valid names are {known}"
                self._refuse(text, why)
            return lines_of.action(LAYER_VERBS[verb], self._names.index(name))
        try:
            return lines_of.action(*chord_of(text))
        except SpotsError as error:
            self._refuse(text, f"{where}: {error}")

    def _label(self, actions: dict[str, int]) -> str:
        """Return the label of a key: the characters that its actions type, or its first action."""
        shown = actions["tap"], actions["firm"], actions["hold"]
        written = [self._written(action) for action in shown if action]
        characters = [text for text in written if len(text) == 1]
        return " ".join(characters) if len(characters) > 1 else written[0] if written else ""

    def _written(self, action: int) -> str:
        kind, number, _ = parts_of(action)
        if kind in LAYER_VERBS.values():
            return self._names[number]
        return typed(kind, number) or name_of(kind, number)

    def _check_ways(self, layers: dict[str, list[PlacedKey]], used: set[int]) -> None:
        verbs = LAYER_VERBS.values()
        reached = {0} | {number for kind, number, _ in map(parts_of, used) if kind in verbs}
        for number, name in enumerate(self._names):
            if number not in reached:
                self._refuse(name, f"no key leads to layer '{name}': add 'toggle {name}' to a key")
        for number, name in enumerate(self._names[1:], 1):
            there = {parts_of(one)[0] for key in layers[name] for one in key.actions.values()}
            if lines_of.action(lines_of.TOGGLE, number) in used and lines_of.TOGGLE not in there:
                self._refuse(
                    name, f"no key leaves layer '{name}': add 'toggle {name}' to one of its keys"
                )

    def _refuse(self, value: str, why: str) -> NoReturn:
        line = _line_of(self._text, rf"""(["']){re.escape(value)}\1""")
        raise SpotsError(f"layout {self._path}{line}: {why}") from None


def parts_of(action: int) -> tuple[int, int, int]:
    """Return kind, number and modifiers of an action.

    Parameters
    ----------
    action : int
        Action as the board encodes it, see `spots_device.keys.layout.action`.

    Returns
    -------
    kind, number, modifiers : int
        The arguments of `spots_device.keys.layout.action`.
    """
    return action >> 20, action & 0xFFF, action >> 12 & 0xFF


def typed(page: int, usage: int) -> str:
    """Return the character on the cap of a key.

    Parameters
    ----------
    page, usage : int
        HID usage page and usage of the key.

    Returns
    -------
    str
        The character, with letters in upper case; empty if the key types no character.
    """
    known = USAGES.get((page, usage))
    character = (known and known.pynput) or ""
    return character.upper() if len(character) == 1 else ""


def _line_of(text: str, pattern: str) -> str:
    """Return ``, line 7`` if line 7 is the first that matches a pattern; empty without a match."""
    for number, line in enumerate(text.splitlines(), 1):
        if re.search(pattern, line):
            return f", line {number}"
    return ""


def _line_of_key(text: str, keys: list[str]) -> str:
    """Return ``, line 7`` if line 7 sets one of the TOML keys `keys`; empty without such a line.

    If the text sets several of the keys, the first one in `keys` is used.
    """
    found = (_line_of(text, rf"(?<!\w){re.escape(key)}\s*=") for key in keys)
    return next(filter(None, found), "")
