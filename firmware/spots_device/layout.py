"""A layout of keys as the board stores it: lines of integers, validated before they are used.

One statement a line; what `LIMITS` names may be left out::

    detect 2                   readings in a row that make a press
    layer 0 0                  a layer begins: its actions for a swipe to the sensor and away
    key 0 100 7340036 0 0 0 0 0

A key has its bounds in thousandths of the strip from the sensor's end on, then what a tap, a double
tap, a hold and a firm press do, and a slide to the sensor and away, at every step. Of an action the
bits from 20 on are its kind: 0 nothing; a HID usage page, 7 keyboard or 12 consumer, with modifiers
from bit 12 on and the usage below; or `MOMENTARY`, `TOGGLE`, `ONCE` with a layer below. Keys of a
layer ascend and do not overlap; what lies between them is no key.
"""

from array import array

# Kinds of actions from here on are HID usage pages.
KEYBOARD = 7
CONSUMER = 12
MOMENTARY = 1  # the layer is on while the key is held
TOGGLE = 2
ONCE = 3  # for the next key

HOLD_PREFERRED = 0
BALANCED = 1
TAP_PREFERRED = 2

LOW, HIGH, TAP, DOUBLE, HOLD, FIRM, SLIDE_MINUS, SLIDE_PLUS = range(8)
KEY_SIZE = 8
FULL = 1000  # the strip in bounds
LAYERS_MAX = 8
KEYS_MAX = 128

# name: smallest, largest, default
LIMITS = {
    "detect": (1, 8, 2),
    "press_mN": (0, 65_535, 0),  # 0: where the calibration lets a touch begin
    "release_mN": (0, 65_535, 0),
    "firm_mN": (1, 65_535, 4_000),
    "jump_um": (500, 1_000_000, 5_000),  # farther from one reading to the next goes no finger
    "slack_um": (0, 100_000, 500),  # a quick second tap may miss its key by so much
    "slide_um": (200, 1_000_000, 4_000),
    "swipe_um": (1_000, 1_000_000, 20_000),
    "release_ms": (0, 1_000, 15),
    "tapping_ms": (10, 60_000, 200),
    "quick_ms": (0, 60_000, 150),
    "double_ms": (10, 60_000, 250),
    "firm_ms": (10, 60_000, 80),
    "swipe_ms": (10, 60_000, 250),
    "stuck_ms": (0, 3_600_000, 0),  # 0: what rests is a finger, however long
    "flavour": (HOLD_PREFERRED, TAP_PREFERRED, BALANCED),
}
_USAGES = {KEYBOARD: (1, 0xE7), CONSUMER: (1, 0xFFF)}
_LAYER_ACTIONS = (MOMENTARY, TOGGLE, ONCE)


class LayoutError(ValueError):
    """A layout that must not be used; the text says why."""


def action(kind, number, modifiers=0):
    """Return an action as lines hold it."""
    return kind << 20 | modifiers << 12 | number


class Layout:
    """A checked layout.

    Parameters
    ----------
    lines : iterable of str
        The statements.

    Attributes
    ----------
    keys : array of int
        `KEY_SIZE` for each key; a row is where one begins.
    pages : tuple of int
        The HID usage pages that its actions use.

    The names of `LIMITS` are attributes too, those in ms as ticks (see contact.py) by names that
    end in ``_t``.

    Raises
    ------
    LayoutError
        If a statement is unknown or out of range, or there is no key.
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
                    raise LayoutError("'%s': keys follow each other in a layer, to 1000" % line)
                keys.extend(row)
            else:
                raise LayoutError("no statement is called '%s'" % name)
        if not keys or len(firsts) > LAYERS_MAX or len(keys) > KEYS_MAX * KEY_SIZE:
            raise LayoutError("a layout has 1 to %d keys in %d layers" % (KEYS_MAX, LAYERS_MAX))
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
        """Return the row of a layer's first key, or where the last layer ends."""
        return self._firsts[layer]

    def is_on(self, layer, row):
        """Return whether a row belongs to a layer."""
        return self._firsts[layer] <= row < self._firsts[layer + 1]

    def swipe(self, layer, plus):
        """Return a layer's action for a swipe, `plus` for one away from the sensor."""
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
        raise LayoutError("there is no action %d" % action)


def _integers(line, count):
    try:
        values = [int(word) for word in line.split()[1:]]
    except ValueError:
        values = []
    if len(values) != count or any(not 0 <= value < 1 << 24 for value in values):
        raise LayoutError("'%s' needs %d whole numbers" % (line, count))
    return values


def default_lines():
    """Return the lines of ten keys, 1 to 9 and 0, for a board without a layout."""
    lines = ["layer 0 0"]
    for i in range(10):
        lines.append("key %d %d %d 0 0 0 0 0" % (100 * i, 100 * i + 100, action(KEYBOARD, 30 + i)))
    return lines
