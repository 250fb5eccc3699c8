"""A layout of keys as the board stores it: text lines with integers, validated before use.

Each line is one statement. The statements of `LIMITS`, such as ``detect``, are optional::

    detect 2                   number of consecutive readings that begin a press
    layer 0 0                  start of a layer: actions for a swipe to the sensor and away from it
    key 0 100 7340036 0 0 0 0 0

The first two numbers of a key are its bounds in thousandths of the strip, from the sensor's end.
Six actions follow: tap, double tap, hold, firm press, slide to the sensor, slide away from it. In
the example, a tap presses the key A: 7 * 2**20 + 4. The action of a slide is repeated each time the
finger has moved by ``slide_um``.

An action is one integer. Bits 20 and higher are its kind. Kind 0 does nothing. Kinds 7 (keyboard)
and 12 (consumer) are HID usage pages; then bits 12 to 19 are the modifiers and bits 0 to 11 the
usage. The kinds `MOMENTARY`, `TOGGLE` and `ONCE` switch a layer on: while the key is held, until
the action is repeated, or for the next key. Then bits 0 to 11 are the number of the layer.

The keys of a layer are in ascending order and do not overlap. A press between two keys has no
action until the finger reaches a key.
"""

from array import array

# Kinds of actions: HID usage pages.
KEYBOARD = 7
CONSUMER = 12
# Kinds of actions: layers.
MOMENTARY = 1  # the layer is on while the key is held
TOGGLE = 2  # switches the layer on or off
ONCE = 3  # the layer is on for the next key

HOLD_PREFERRED = 0
BALANCED = 1
TAP_PREFERRED = 2

LOW, HIGH, TAP, DOUBLE, HOLD, FIRM, SLIDE_MINUS, SLIDE_PLUS = range(8)
KEY_SIZE = 8
FULL = 1000  # bound at the far end of the strip
LAYERS_MAX = 8
KEYS_MAX = 128

# Name of a statement: minimum, maximum, default. docs/keyboard.md explains the statements.
LIMITS = {
    "detect": (1, 8, 2),
    "press_mN": (0, 65_535, 0),  # 0: the force at which a touch begins in the calibration
    "release_mN": (0, 65_535, 0),
    "firm_mN": (1, 65_535, 4_000),
    "jump_um": (500, 1_000_000, 5_000),  # largest movement of a finger between two readings
    "slack_um": (0, 100_000, 500),  # a quick second tap may miss its key by this distance
    "slide_um": (200, 1_000_000, 4_000),
    "swipe_um": (1_000, 1_000_000, 20_000),
    "release_ms": (0, 1_000, 15),
    "tapping_ms": (10, 60_000, 200),
    "quick_ms": (0, 60_000, 150),
    "double_ms": (10, 60_000, 250),
    "firm_ms": (10, 60_000, 80),
    "swipe_ms": (10, 60_000, 250),
    "stuck_ms": (0, 3_600_000, 30_000),  # 0: a touch without motion is a finger for any duration
    "flavour": (HOLD_PREFERRED, TAP_PREFERRED, BALANCED),
}
_USAGES = {KEYBOARD: (1, 0xE7), CONSUMER: (1, 0xFFF)}
_LAYER_ACTIONS = (MOMENTARY, TOGGLE, ONCE)


class LayoutError(ValueError):
    """Error for an invalid layout; its message says why."""


def action(kind, number, modifiers=0):
    """Return the integer of an action.

    Parameters
    ----------
    kind : int
        `KEYBOARD`, `CONSUMER`, `MOMENTARY`, `TOGGLE` or `ONCE`.
    number : int
        HID usage, or number of a layer.
    modifiers : int
        Bits of the modifier keys.
    """
    return kind << 20 | modifiers << 12 | number


class Layout:
    """A validated layout.

    Each statement of `LIMITS` is an attribute. Durations are in ticks (see tracker.py), and the
    names of their attributes end in ``_t`` instead of ``_ms``.

    Parameters
    ----------
    lines : iterable of str
        Text lines such as ``key 0 100 7340036 0 0 0 0 0``; see the module docstring.

    Attributes
    ----------
    keys : array of int
        `KEY_SIZE` integers for each key. The row of a key is the index of its first integer.
    pages : tuple of int
        HID usage pages of all actions.

    Raises
    ------
    LayoutError
        If a statement is unknown or out of range, if keys overlap, or if there are no keys or too
        many keys or layers.
    """

    def __init__(self, lines):
        values = {name: limits[2] for name, limits in LIMITS.items()}
        keys = []
        firsts = []
        swipes = []
        for line in lines:
            words = line.split()
            if not words:
                continue
            name = words[0]
            if name in LIMITS:
                low, high, _ = LIMITS[name]
                (values[name],) = _integers(line, 1)
                if not low <= values[name] <= high:
                    raise LayoutError("'%s' must be from %d to %d" % (name, low, high))
            elif name == "layer":
                firsts.append(len(keys))
                swipes.extend(_integers(line, 2))
            elif name == "key":
                row = _integers(line, KEY_SIZE)
                after = keys[-KEY_SIZE + HIGH] if firsts and len(keys) > firsts[-1] else 0
                if not firsts or not after <= row[LOW] < row[HIGH] <= FULL:
                    raise LayoutError("'%s': after 'layer', keys must ascend up to 1000" % line)
                keys.extend(row)
            else:
                raise LayoutError("unknown statement '%s': remove it" % name)
        if not keys or len(firsts) > LAYERS_MAX or len(keys) > KEYS_MAX * KEY_SIZE:
            raise LayoutError(
                "a layout needs 1 to %d keys, 1 to %d layers" % (KEYS_MAX, LAYERS_MAX)
            )
        self.layers = len(firsts)
        self.keys = array("i", keys)
        self._firsts = array("i", firsts + [len(keys)])
        self._swipes = array("i", swipes)
        pages = set()
        for row in range(0, len(keys), KEY_SIZE):
            for slot in range(TAP, KEY_SIZE):
                self._check(keys[row + slot], pages)
        for each in swipes:
            self._check(each, pages)
        self.pages = tuple(sorted(pages))
        for name, value in values.items():
            if name.endswith("_ms"):
                setattr(self, name[:-2] + "t", value * 125 >> 7)
            else:
                setattr(self, name, value)

    def first(self, layer):
        """Return the row (index in `keys`) of a layer's first key.

        If ``layer == layers``, return the length of `keys`.
        """
        return self._firsts[layer]

    def is_on(self, layer, row):
        """Return whether the key whose first integer is ``keys[row]`` belongs to `layer`."""
        return self._firsts[layer] <= row < self._firsts[layer + 1]

    def swipe(self, layer, plus):
        """Return a layer's action for a swipe; `plus` is True for a swipe away from the sensor."""
        return self._swipes[2 * layer + (1 if plus else 0)]

    def _check(self, action, pages):
        kind = action >> 20
        number = action & 0xFFF
        if kind in _USAGES:
            low, high = _USAGES[kind]
            pages.add(kind)
            if low <= number <= high:
                return
        elif (kind in _LAYER_ACTIONS and number < self.layers) or action == 0:
            return
        raise LayoutError("the action %d is invalid" % action)


def _integers(line, count):
    try:
        values = list(map(int, line.split()[1:]))
    except ValueError:
        values = []
    if len(values) != count or min(values) < 0 or max(values) >> 24:
        raise LayoutError("'%s' needs %d whole numbers" % (line, count))
    return values


def default_lines():
    """Return the lines of the default layout: ten keys in a row, 1 to 9 and 0."""
    lines = ["layer 0 0"]
    for i in range(10):
        lines.append("key %d %d %d 0 0 0 0 0" % (100 * i, 100 * i + 100, action(KEYBOARD, 30 + i)))
    return lines
