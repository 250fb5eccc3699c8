"""A layout of keys as the board stores it: text lines with integers, validated before use.

Each line is one statement. The statements of `LIMITS`, such as ``detect``, are optional::

    detect 2                     number of consecutive readings that begin a press
    behaviour 0 2 0 1048577      behaviour 0: `STICKY`, without a time limit, of layer 1
    layer 0 0                    start of a layer: actions for a swipe to the sensor and away
    key 0 100 7340036 0 0 0 0 0

The first two numbers of a key are its bounds in thousandths of the strip, from the sensor's end.
Six actions follow: tap, double tap, hold, firm press, slide to the sensor, slide away from it. In
the example, a tap presses the key A: 7 * 2**20 + 4. The action of a slide is repeated each time the
finger has moved by ``slide_um``.

An action is one integer. Bits 20 and higher are its kind. Kind 0 does nothing. The kinds `KEYBOARD`
and `CONSUMER` press a usage of this HID usage page; then bits 12 to 19 are the modifiers and bits 0
to 11 the usage. `SYSTEM` presses a usage of page 1. `MOUSE` presses a button, 1 to 8, or turns a
wheel: `WHEEL` turns it up, the numbers after it down, left and right. A slide turns a wheel
smoothly, by a notch for ``slide_um``. The kinds `MOMENTARY`, `TOGGLE` and `TO` switch layers: while
the key is held, until the action is repeated, or with all other layers off. Then bits 0 to 11 are
the number of the layer. With the kind `BEHAVIOUR` they are the number of a ``behaviour`` line,
which stands before the lines that use it. After its number and kind, it has these numbers:

============  ======================================================================================
`HOLD_TAP`    flavor (plus `RETRO_TAP`), three times in ms (tapping term, quick tap, prior idle),
              action of the hold; only as the hold of a key
`STICKY`      time in ms after which it ends (0: never), action: a key or `MOMENTARY`
`TAP_DANCE`   longest time between two taps in ms, most taps, action of one tap, of two taps, …;
              then, if the key may also be held after these taps, the actions of the holds
`MOD_MORPH`   bits of modifiers, bits of those that stay down, action without them, action with one
`KEY_REPEAT`  none
`CAPS_WORD`   how it changes each key of the computer, see caps.py
`TEXT`        first step and number of steps
============  ======================================================================================

Lines ``text STEP …`` contain the steps of all texts, numbered from 0. A step is modifiers * 256 +
usage of a key, which is pressed and released. With the usage 0, the upper byte is a pause in units
of 10 ms. With a usage from `MEDIA_FROM` on, it is the lower byte of a usage of the consumer page,
of which usage - `MEDIA_FROM` are the upper bits. With `NEXT_BITS`, it is the modifiers of the media
key in the next step. With `PRESS`, the upper byte is the usage of a key that is pressed and stays
down, until `RELEASE` with this usage or the end of the text.

The keys of a layer are in ascending order and do not overlap. A press between two keys has no
action until the finger reaches a key. Of the layers that are on, the last one counts.
"""

from array import array

from ..usb.usages import CONSUMER, KEYBOARD, MOUSE, SYSTEM, WHEEL
from .keymap import KeyMap

# Kinds of actions beside those of `usages`, which press something.
MOMENTARY = 2  # the layer is on while the key is held
TOGGLE = 3  # switches the layer on or off
TO = 4  # switches the layer on and all others off
BEHAVIOUR = 5

# Kinds of behaviours.
HOLD_TAP, STICKY, TAP_DANCE, MOD_MORPH, KEY_REPEAT, CAPS_WORD, TEXT = range(1, 8)

# In steps of texts: these usages are not in use on HID's keyboard page.
MEDIA_FROM = 0xE8
NEXT_BITS = 0xEC
PRESS = 0xED
RELEASE = 0xEE

HOLD_PREFERRED = 0
BALANCED = 1
TAP_PREFERRED = 2
TAP_UNLESS_INTERRUPTED = 3
RETRO_TAP = 4  # added to the flavor of a `HOLD_TAP`

LOW, HIGH, TAP, DOUBLE, HOLD, FIRM, SLIDE_MINUS, SLIDE_PLUS = range(8)
KEY_SIZE = 8
FULL = 1000  # bound at the far end of the strip
LAYERS_MAX = 8
KEYS_MAX = 128
BEHAVIOURS_MAX = 64
STEPS_MAX = 1024  # of all texts
CAPS_SIZE = 19  # integers of a `CAPS_WORD`

# Name of a statement: minimum, maximum, default. docs/type/layouts.md explains the statements.
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
    "tapping_term_ms": (10, 60_000, 200),
    "quick_tap_ms": (0, 60_000, 200),
    "require_prior_idle_ms": (0, 60_000, 0),
    "double_ms": (10, 60_000, 250),
    "firm_ms": (10, 60_000, 80),
    "swipe_ms": (10, 60_000, 250),
    "tap_ms": (0, 1_000, 20),  # least time that a tapped key of the computer is down
    "caps_lock_ms": (0, 1_000, 0),  # the same for caps lock, if it is longer
    "text_ms": (0, 1_000, 8),  # the same for a key of a text, and for its modifiers before it
    "stuck_ms": (0, 3_600_000, 30_000),  # 0: a touch without motion is a finger for any duration
    "flavor": (HOLD_PREFERRED, TAP_UNLESS_INTERRUPTED, BALANCED),
}
_LEAST = ("tap_ms", "caps_lock_ms", "text_ms")
_USAGES = {KEYBOARD: (1, 0xE7), SYSTEM: (0x81, 0x83), MOUSE: (1, WHEEL + 3), CONSUMER: (1, 0xFFF)}
_LAYER_ACTIONS = (MOMENTARY, TOGGLE, TO)
# Kind of a behaviour: least and largest count of its numbers, and how many are no actions.
_SHAPES = {
    HOLD_TAP: (5, 5, 4),
    STICKY: (2, 2, 1),
    TAP_DANCE: (4, 18, 2),
    MOD_MORPH: (4, 4, 2),
    KEY_REPEAT: (0, 0, 0),
    CAPS_WORD: (CAPS_SIZE, CAPS_SIZE, CAPS_SIZE),
    TEXT: (2, 2, 2),
}


class LayoutError(ValueError):
    """Error for an invalid layout; its message says why."""


def action(kind, number, modifiers=0):
    """Return the integer of an action; `number` is a HID usage, button, layer or behaviour."""
    return kind << 20 | modifiers << 12 | number


def parse(lines):
    """Return the `keymap.KeyMap` of a layout's lines; LayoutError if they are no valid layout."""
    values = {name: limits[2] for name, limits in LIMITS.items()}
    keys = []
    firsts = []
    swipes = []
    behaviours = []
    steps = array("H")
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
        elif name == "behaviour":
            behaviours.append(_behaviour(line, len(behaviours)))
        elif name == "text":
            _add_steps(steps, line)
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
        raise LayoutError("a layout needs 1 to %d keys, 1 to %d layers" % (KEYS_MAX, LAYERS_MAX))
    layout = KeyMap()
    layout.layers = len(firsts)
    layout.keys = array("i", keys)
    layout._firsts = array("i", firsts + [len(keys)])
    layout._swipes = array("i", swipes)
    pages = set()
    layout.steps = steps
    layout._begins = array("i")
    layout.behaviours = array("i")
    for number, values_of in enumerate(behaviours):
        layout._begins.append(len(layout.behaviours))
        kind = values_of[0]
        for each in values_of[1 + _SHAPES[kind][2] :]:
            _check(layout, each, pages, behaviours[:number])
            if kind == STICKY and each >> 20 not in (KEYBOARD, MOMENTARY):
                raise LayoutError("the action %d is not sticky" % each)
        if kind == TEXT:
            _check_text(steps, values_of[1], values_of[2], pages)
        if kind == TAP_DANCE:
            values_of += [0] * (3 + 2 * values_of[2] - len(values_of))
        layout.behaviours.extend(array("i", values_of))
    layout.kinds = tuple(sorted({values_of[0] for values_of in behaviours}))
    for row in range(0, len(keys), KEY_SIZE):
        for slot in range(TAP, KEY_SIZE):
            _check(layout, keys[row + slot], pages, behaviours, slot == HOLD)
    for each in swipes:
        _check(layout, each, pages, behaviours)
    layout.moves = any(swipes) or any(
        any(keys[i + SLIDE_MINUS : i + KEY_SIZE]) for i in range(0, len(keys), KEY_SIZE)
    )
    layout.pages = tuple(sorted(pages))
    for name, value in values.items():
        if name in _LEAST:
            setattr(layout, name[:-2] + "t", -_ticks(-value))  # rounded up
        elif name.endswith("_ms"):
            setattr(layout, name[:-2] + "t", _ticks(value))
        else:
            setattr(layout, name, value)
    return layout


def _check(layout, action, pages, behaviours, is_hold=False):
    kind = action >> 20
    number = action & 0xFFF
    if kind in _USAGES:
        low, high = _USAGES[kind]
        pages.add(kind)
        if action >> 12 & 0xFF:
            pages.add(KEYBOARD)
        if low <= number <= high:
            return
    elif kind == BEHAVIOUR:
        if number < len(behaviours) and (is_hold or behaviours[number][0] != HOLD_TAP):
            return
    elif (kind in _LAYER_ACTIONS and number < layout.layers) or action == 0:
        return
    raise LayoutError("the action %d is invalid" % action)


def _ticks(ms):
    return ms * 125 >> 7


def _behaviour(line, number):
    # Returns kind and numbers of a behaviour, with times in ticks.
    values = _integers(line, len(line.split()) - 1)
    low, high, _ = _SHAPES.get(values[1] if len(values) > 1 else 0, (1, 0, 0))
    if values[0] != number or not low <= len(values) - 2 <= high or number >= BEHAVIOURS_MAX:
        raise LayoutError("'%s': its number must be %d, with a known kind" % (line, number))
    kind = values[1]
    times = range(3, 6) if kind == HOLD_TAP else (2,) if kind in (STICKY, TAP_DANCE) else ()
    for i in times:
        values[i] = _ticks(values[i])
    if kind == TAP_DANCE and not (values[3] > 1 and len(values) - 4 in (values[3], 2 * values[3])):
        raise LayoutError("'%s': the count of actions is wrong" % line)
    if kind == HOLD_TAP and values[2] > TAP_UNLESS_INTERRUPTED + RETRO_TAP:
        raise LayoutError("'%s': there is no such flavor" % line)
    return values[1:]


def _add_steps(steps, line):
    values = _integers(line, len(line.split()) - 1)
    if max(values) > 0xFFFF or len(steps) + len(values) > STEPS_MAX:
        raise LayoutError("'%s': texts have at most %d steps of 16 bits" % (line, STEPS_MAX))
    steps.extend(array("H", values))


def _check_text(steps, first, count, pages):
    if not 0 < count <= len(steps) - first:
        raise LayoutError("a text has the steps %d to %d" % (first, first + count - 1))
    pages.add(KEYBOARD)
    for i in range(first, first + count):
        if steps[i] & 0xFF > RELEASE:
            raise LayoutError("the step %d is invalid" % steps[i])
        if MEDIA_FROM <= steps[i] & 0xFF < NEXT_BITS:
            pages.add(CONSUMER)


def _integers(line, count):
    try:
        values = list(map(int, line.split()[1:]))
    except ValueError:
        values = []
    if not values or len(values) != count or min(values) < 0 or max(values) >> 24:
        raise LayoutError("'%s' needs %d whole numbers" % (line, count))
    return values


def default_lines():
    """Return the lines of the default layout: ten keys in a row, 1 to 9 and 0."""
    lines = ["layer 0 0"]
    for i in range(10):
        lines.append("key %d %d %d 0 0 0 0 0" % (100 * i, 100 * i + 100, action(KEYBOARD, 30 + i)))
    return lines
