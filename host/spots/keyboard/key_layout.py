"""A key layout: which key does what, and the lines that a board stores for it."""

from dataclasses import dataclass

from spots_device.keys import layout as lines_of

from ..outputs.usages import ON_BOARDS, USAGES
from .hosts import KEYS, Host

SWIPES = ("swipe_minus", "swipe_plus")  # of a layer
SLOTS = ("tap", "double", "hold", "firm", "slide_minus", "slide_plus")
# Rules that decide between tap and hold, see docs/type/tap-hold.md; the index is the number that
# the firmware has for a rule.
FLAVORS = ("hold-preferred", "balanced", "tap-preferred", "tap-unless-interrupted")
LAYER_VERBS = {
    "momentary": lines_of.MOMENTARY,
    "toggle": lines_of.TOGGLE,
    "to": lines_of.TO,
}


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
class Behaviour:
    """A behaviour, to which actions refer by its number.

    Attributes
    ----------
    text : str
        The action in a layout file, such as ``sticky LEFT_SHIFT``.
    numbers : tuple of int
        Kind and numbers as in a ``behaviour`` line, see `spots_device.keys.layout`.
    """

    text: str
    numbers: tuple[int, ...]

    @property
    def actions(self) -> tuple[int, ...]:
        """The actions that this behaviour may cause."""
        # Hold-taps and tap dances have more numbers before their actions; texts and caps word have
        # no actions.
        first = {
            lines_of.HOLD_TAP: 5,
            lines_of.STICKY: 2,
            lines_of.CAPS_WORD: 1 + lines_of.CAPS_SIZE,
        }
        return self.numbers[first.get(self.numbers[0], 3) :]


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
    behaviours : list of Behaviour
        Behaviours that actions of the kind `spots_device.keys.layout.BEHAVIOUR` refer to.
    problems : list of str
        What can never be typed: a sentence for each key.
    text : str
        Text of the layout file.
    characters : dict of int to str
        Characters of the computer's layout by the actions that type them.
    texts : dict of str to tuple of int
        Steps of the texts and macros, see `spots_device.keys.layout`, by their notation in a layout
        file.
    content : dict
        Parsed content of the file, without the TOML keys whose values are the defaults.
    """

    name: str
    layers: dict[str, list[PlacedKey]]
    swipes: dict[str, dict[str, int]]
    lines: list[str]
    typed: frozenset[int]
    behaviours: list["Behaviour"]
    problems: list[str]
    text: str
    characters: dict[int, str]
    texts: dict[str, tuple[int, ...]]
    content: dict

    @property
    def on_board(self) -> list[str]:
        """Names of the actions that only a board can press, see `usages.ON_BOARDS`."""
        placed = [key.actions for row in self.layers.values() for key in row]
        used = {one for by_slot in (*placed, *self.swipes.values()) for one in by_slot.values()}
        used.update(one for behaviour in self.behaviours for one in behaviour.actions)
        actions = {parts_of(one)[:2] for one in used}
        return [name for name, action in ON_BOARDS.items() if action in actions]


def flavor_name(flavor: int) -> str:
    """Return the name of a flavor, given as in a ``behaviour`` line of the board."""
    retro = ", retro_tap" if flavor & lines_of.RETRO_TAP else ""
    return FLAVORS[flavor & ~lines_of.RETRO_TAP] + retro


def parts_of(action: int) -> tuple[int, int, int]:
    """Return kind, number and modifiers: the arguments of `spots_device.keys.layout.action`."""
    return action >> 20, action & 0xFFF, action >> 12 & 0xFF


def typed(page: int, usage: int, host: Host | None = None) -> str:
    """Return the character on the cap of a key, as upper case; empty if it types none.

    Without a host, the keyboard is American.
    """
    if host is not None and page == lines_of.KEYBOARD and usage in KEYS:
        return host.cap(usage)
    known = USAGES.get((page, usage))
    character = (known and known.pynput) or ""
    return character.upper() if len(character) == 1 else ""
