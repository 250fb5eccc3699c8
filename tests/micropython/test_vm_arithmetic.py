"""The firmware's arithmetic in a real MicroPython: same integers as in CPython, no allocation.

A trial is a function of scripts/trials.py that computes many cases. It runs while the heap is
locked. In the 32-bit build, an integer of more than 31 bits then raises MemoryError. The arguments
include the smallest and largest values that calibration and chip allow.
"""

import itertools
import math
import random
from functools import partial
from unittest.mock import Mock

import pytest

from spots_device.board.settings import LIMITS
from spots_device.fingers import pair, tracker
from spots_device.fingers import state as contact_state
from spots_device.fingers.state import (
    FADED,
    FOUND,
    LIFTED,
    MOVED,
    REMAINS,
    SAME,
)
from spots_device.keys.layout import (
    BEHAVIOUR,
    CAPS_WORD,
    CONSUMER,
    HOLD_TAP,
    KEY_REPEAT,
    KEYBOARD,
    MOD_MORPH,
    MOMENTARY,
    STICKY,
    TAP_DANCE,
    TO,
    TOGGLE,
    action,
    default_lines,
    parse,
)
from spots_device.reading import decode
from spots_device.reading.calibration import Calibration
from spots_device.reading.calibration_lines import (
    KNOTS_MAX,
    ONE_Q13,
    WEIGHT_SUM_MAX,
    CalibrationError,
)
from spots_device.reading.decode import (
    CRC_SIZE,
    DARK_SUBTRACTED,
    HEADER_SIZE,
    LED_OFF,
    MISFIT,
    SATURATED,
    TOUCH_SIZE,
)
from spots_device.reading.frame import TEXT_MAX
from spots_device.reading.log2 import LIMIT, ONE

pytestmark = pytest.mark.board

CHANNELS = 6
LOG_MAX = 24 * ONE
SMALL_MIN, SMALL_MAX = -(1 << 30), (1 << 30) - 1
TICKS = 1 << 30
# Largest absolute value of contrast and brightness: weights whose absolute values add up to 8,
# times the largest logarithm, minus the logarithm of 64 * 4 samples.
READING_MAX = 5 * LOG_MAX


@pytest.fixture
def rng():
    return random.Random(7341)


@pytest.fixture
def compare(machine, cpython):
    """Return a function that runs a trial on both interpreters; their results must be equal."""

    def run(trial, cases, width=1):
        given = {"trial": trial, "cases": cases, "width": width}
        expected = cpython.run("compute", given)
        assert len(expected) == len(cases)
        assert machine.run("compute", given) == expected

    return run


def test_log2(compare, rng):
    edges = {(1 << bits) + near for bits in range(25) for near in (-1, 0, 1)}
    edges |= {LIMIT + 2, SMALL_MAX}
    drawn = {rng.randint(1, LIMIT) for _ in range(950)}
    drawn |= {int(2 ** rng.uniform(0, 24)) for _ in range(950)}
    cases = sorted((edges | drawn) - {0})
    for some in (cases[::2], cases[1::2]):  # a longer list may need a larger block than is free
        compare("log2", some)


def weights_of(rng, total):
    """Return six random weights that add up to `total`, with the largest valid absolute sum."""
    positive = (WEIGHT_SUM_MAX + total) // 2
    signs = rng.sample([1, 1, 1, -1, -1, -1], CHANNELS)
    weights = [0] * CHANNELS
    for sign, left in ((1, positive), (-1, WEIGHT_SUM_MAX - positive)):
        places = [i for i in range(CHANNELS) if signs[i] == sign]
        cuts = sorted(rng.randint(0, left) for _ in places[1:])
        for place, (a, b) in zip(places, itertools.pairwise([0, *cuts, left])):
            weights[place] = sign * (b - a)
    assert sum(weights) == total
    assert sum(map(abs, weights)) == WEIGHT_SUM_MAX
    return weights


def a_table(rng, knots):
    """Return random knots and values of a table, with the largest valid steps."""
    at = [-rng.randint(0, 1 << 26)]
    values = [rng.randint(-(1 << 20), 1 << 20)]
    direction = rng.choice((1, -1))
    for _ in range(knots - 1):
        step = int(2 ** rng.uniform(0, 27 - knots.bit_length()))
        values.append(values[-1] + direction * min(SMALL_MAX // step - 1, 1 << 22))
        at.append(at[-1] + step)
    return at, values


LIMIT_TABLES = {
    "the longest step": ([-(1 << 28), (1 << 28) - 1], [1, 0]),
    "the steepest step": ([0, 1], [-(1 << 29), (1 << 29) - 2]),
    "the largest square": ([0, 32767], [32767, 0]),
    "knots that begin at the least integer": ([SMALL_MIN, SMALL_MIN + 1000], [0, 1000]),
    "knots that end at the largest integer": ([SMALL_MAX - 1000, SMALL_MAX], [0, 1000]),
    "values that begin at the least integer": ([0, 1000], [SMALL_MIN, SMALL_MIN + 1000]),
    "values that end at the largest integer": ([0, 1000], [SMALL_MAX, SMALL_MAX - 1000]),
}


def accepted(calibration, knots, values):
    """Return whether a calibration is valid with a table of these knots and values."""
    tables = ("segment ", "strain ", "from ", "x ")
    lines = [line for line in calibration if not line.startswith(tables)]
    lines += ["segment 0 0 0 0 0 0 8192 0 0 0 0 0", "strain 0", "from 0"]
    lines += ["x %d %d %d %d" % (knot, value, value, value) for knot, value in zip(knots, values)]
    try:
        Calibration(lines)
    except CalibrationError:
        return False
    return True


def readings(rng, knots):
    """Return arguments for a look-up in a table: at its knots, next to, between and beyond them."""
    some = rng.sample(knots, min(len(knots), 5))
    found = [knot + near for knot in some for near in (-1, 0, 1)]
    found += [rng.randint(knots[0], knots[-1]) for _ in range(20 - len(found))]
    found += [-READING_MAX, READING_MAX]
    return [min(max(at, -READING_MAX), READING_MAX) for at in found]


def test_tables(compare, calibration, rng):
    tables = [a_table(rng, knots) for knots in [2] * 10 + [3] * 10 + [33] * 3 + [KNOTS_MAX]]
    assert all(accepted(calibration, *table) for table in tables)
    cases = [(*table, readings(rng, table[0])) for table in tables]
    compare("table", cases, width=len(cases[0][2]))


@pytest.mark.parametrize("name", LIMIT_TABLES)
def test_a_table_at_the_limit_works_if_a_calibration_may_hold_it(compare, calibration, rng, name):
    knots, values = LIMIT_TABLES[name]
    if accepted(calibration, knots, values):
        at = readings(rng, knots)
        compare("table", [(knots, values, at)], width=len(at))


FULL = 65_535


def a_column(rng, at, least, most):
    """Return random values at the knots `at`, from `least` to `most`, with large valid steps."""
    values = [rng.randint(least, most)]
    for a, b in itertools.pairwise(at):
        farthest = SMALL_MAX // (b - a) - 1
        jump = rng.randint(-farthest, farthest)
        values.append(min(max(values[-1] + jump, least), most))
    return values


def a_calibration(rng):
    """Return random weights, bounds and tables that are valid, with the largest possible weights.

    The five results are the arguments of `calibration.pack`.
    """
    weights, tables = [], []
    cross = rng.randint(0, 1)
    largest = rng.choice((100, 1 << 17))  # of the sizes of the cross-sensitivity
    for knots in rng.sample(range(2, 40), rng.randint(1, 5)):
        contrasts, positions = a_table(rng, knots)
        columns = [a_column(rng, contrasts, -5000, 5000) for _ in range(2)]
        columns += [a_column(rng, contrasts, -largest, largest) for _ in range(2 * cross)]
        weights.append(weights_of(rng, 0) + weights_of(rng, ONE_Q13))
        tables.append(list(zip(contrasts, positions, *columns)))
    brightnesses, forces = a_table(rng, rng.randint(2, 40))
    forces = [force - min(forces) for force in forces]
    tolerances = a_column(rng, brightnesses, 0, rng.choice((1 << 10, 1 << 27)))
    shares = [a_column(rng, brightnesses, -(1 << 12), 1 << 12) for _ in range(cross)]
    bounds = sorted(rng.sample(range(-(1 << 26), 1 << 26), len(weights)))
    whole = weights_of(rng, 0) + weights_of(rng, 0)
    return whole, bounds, weights, tables, list(zip(brightnesses, forces, tolerances, *shares))


def some_limits(rng, tables):
    """Return random limits: forces at which a touch begins and ends, and largest drift (Q12)."""
    off, on = sorted(rng.sample(range(1, max(3, *(knot[1] for knot in tables[-1]))), 2))
    return on, off, rng.choice((0, 1 << 12, 1 << 27))


def a_reading(rng):
    """Return a random reading: number of samples, sums of counts, dark sums, and flags.

    Some readings are too dark.
    """
    samples = rng.choice((1, 1, 2, 63, 64))
    brightest = int(2 ** rng.uniform(1, 16))
    lit = [rng.choice((rng.randint(1, brightest), brightest, FULL)) for _ in range(CHANNELS)]
    dark = [rng.choice((0, 0, 0, rng.randint(0, 4), 4 * FULL)) for _ in range(CHANNELS)]
    if rng.random() < 0.8:
        dark = [min(d, 4 * count - 1) for d, count in zip(dark, lit)]
    flags = rng.choice((0, DARK_SUBTRACTED, SATURATED, DARK_SUBTRACTED, DARK_SUBTRACTED | LED_OFF))
    return samples, [samples * count for count in lit], dark, flags


def test_estimate(compare, rng):
    cases = []
    for i in range(6):
        tables = a_calibration(rng)
        held = a_reading(rng)  # repeated often, so that the drift is computed from it
        readings = [rng.choice((held, held, a_reading(rng))) for _ in range(30)]
        # With small limits, light that fits no press is checked before it begins a touch.
        limits = some_limits(rng, tables) if i < 3 else (2, 1, 0)
        checked = rng.choice((0, 1)), rng.choice((0, 10_000))
        if i > 3:
            checked = 1, 10_000
        cases.append((tables, limits, checked, readings))
    width = (decode.SLOPE + 1 + decode.STATE_SIZE - decode.STICK) * 30
    for case in cases:  # the heap has no room for all cases
        compare("estimate", [case], width=width)


def a_sticking_strip(rng):
    """Return a random state of a strip whose light may stick, flags, and duration of a reading."""
    state = [0] * decode.STATE_SIZE
    samples = rng.choice((1, 1, 2, 64))
    brightest = int(2 ** rng.uniform(0, 16)) if rng.random() < 0.8 else 4 * FULL
    state[decode.SAMPLES] = samples
    state[decode.SHIFT] = rng.randint(6, 10)
    state[decode.BRIGHTNESS] = rng.randint(-ONE, 18 * ONE)
    state[decode.PEAK] = rng.choice((0, state[decode.BRIGHTNESS], rng.randint(-ONE, 18 * ONE)))
    state[decode.PEAK_LIGHT] = rng.choice((0, 100, 1000, CHANNELS * FULL))
    state[decode.FADE] = rng.randint(decode.FADE_MIN, decode.FADE_MAX)
    state[decode.AGREE] = rng.choice((-1, 0, 1, 2, 3, 8, decode.AGREE_MAX))
    for i in range(CHANNELS):
        stick = min(rng.randint(0, brightest << 12), decode.STICK_MAX)
        state[decode.STICK + i] = stick
        state[decode.STUCK] += stick >> 4
        state[decode.DARK + i] = rng.choice((0, rng.randint(0, 4 << 12), FULL << 12))
        state[decode.BASELINE + i] = rng.choice((0, 0, rng.randint(0, 40 << 12)))
        light = (state[decode.DARK + i] + state[decode.BASELINE + i] + stick >> 12) * samples
        light += rng.choice((0, rng.randint(-9, 9), rng.randint(-brightest, brightest))) * samples
        state[decode.SUMS + i] = min(max(light, 0), samples * FULL)
    state[decode.LIGHT] = sum(state[decode.SUMS : decode.SUMS + CHANNELS])
    return state, rng.choice((0, 0, 0, 4, 16, 1)), rng.choice((1000, 10_000, 182_000, 40_000_000))


def test_unstick(compare, rng):
    width = decode.STATE_SIZE - decode.FLOOR
    for _ in range(5):  # the heap has no room for all cases
        compare("unstick", [a_sticking_strip(rng) for _ in range(30)], width=width)


def test_unpack(compare, rng):
    cases = [[rng.choice((0, 255, rng.randint(0, 255))) for _ in range(14)] for _ in range(50)]
    compare("unpack", cases, width=1 + CHANNELS)


def test_accumulate(compare, rng):
    cases = []
    for samples in (0, 1, 63):
        for count in (0, 1, 32_768, FULL):
            cases.append(([samples * FULL] * CHANNELS, [count, FULL, 0, 1, 2, 3], samples))
    compare("accumulate", cases, width=CHANNELS)


def test_power(compare, rng):
    drawn = [rng.randint(-17 * ONE, 18 * ONE) for _ in range(500)]
    compare("power", [*drawn, *(n * ONE + near for n in range(-9, 19) for near in (-1, 0))])


def two_fingers(rng):
    """Return a random reading of two fingers, which may be impossible.

    It consists of four elements of a tracker's state, and the other arguments of `locate.estimate`.
    """
    length_um = rng.choice((30_000, 85_000, 600_000))
    decay = rng.choice((1, 150, 289, 600, 1000))
    x1_um, x_um = rng.randint(0, length_um), rng.randint(0, length_um)
    if rng.random() < 0.1:
        x_um = rng.choice((-(1 << 28), 1 << 28, x1_um))
    first = rng.randint(4 * ONE, 17 * ONE)
    more = rng.choice((rng.randint(0, 2 * ONE), rng.randint(-ONE, 18 * ONE - first)))
    known = [rng.choice((0, length_um, length_um)), decay, rng.randint(1, 4_000_000)]
    drifts = rng.choice((0, 0, MISFIT))
    return [*known, drifts, x1_um, first, x_um, first + more, rng.randint(-1, 1)]


def test_estimate_of_a_second_finger(compare, rng):
    for _ in range(2):  # the heap has no room for the results of all cases
        compare("second_finger", [two_fingers(rng) for _ in range(300)], width=4)


def one_of(rng, share, often, seldom):
    return seldom if rng.random() < share else often


def test_a_finger_that_rests(compare, rng):
    cases = []
    for _ in range(120):
        s = [rng.randint(-(1 << 24), 1 << 24) for _ in range(contact_state.SIZE)]
        x_um, force_mN, t = (
            rng.randint(*ends) for ends in ((-2000, 85_000), (300, 5000), (0, TICKS))
        )
        # With most values the finger rests; with a few values it does not.
        near = partial(one_of, rng, rng.choice((0, 0.1, 0.2, 0.3)))

        s[contact_state.X_UM] = x_um + near(rng.randint(-449, 449), rng.choice((-450, 450, 9000)))
        s[contact_state.LOW_UM] = x_um - near(rng.choice((0, 2000)), -1)
        s[contact_state.HIGH_UM] = x_um + near(rng.choice((0, 2000)), -1)
        s[contact_state.LOW_MN] = force_mN - near(rng.choice((0, 300)), -1)
        s[contact_state.HIGH_MN] = force_mN + near(rng.choice((0, 300)), -1)
        s[contact_state.RELEASE_MN] = force_mN - near(rng.choice((0, 300)), -1)
        s[contact_state.FIRM_MN] = force_mN + near(rng.choice((1, 1 << 28)), 0)
        s[contact_state.STUCK_T] = stuck_t = rng.choice((0, 0, 10_000))
        since = t - near(rng.choice((0, stuck_t - 1)), stuck_t)
        s[contact_state.STILL] = since % contact_state.TICKS
        s[contact_state.LEAVING] = near(0, 1)
        s[contact_state.X_NOW_UM] = x_um
        s[contact_state.FORCE_NOW_MN] = force_mN
        s[contact_state.T_NOW] = t % contact_state.TICKS
        flags = near(rng.choice((1, 9, 21, 29, 33)), rng.choice((0, 3, 5, 17, 65, 129, 255)))
        cases.append([flags, *s])
    for some in (cases[::2], cases[1::2]):  # the heap has no room for the results of all cases
        compare("still", some, width=1 + contact_state.SIZE)


def a_finger(rng):
    """Return readings of random taps, holds, slides, firm presses and touches of two fingers."""
    t = rng.randint(0, contact_state.TICKS - 1)
    readings = []

    def read(flags, x_um, force_mN):
        nonlocal t
        t = (t + 10) % contact_state.TICKS
        readings.append((flags, x_um, force_mN, (force_mN.bit_length() << 20) + 1000 * force_mN, t))

    for _ in range(9):
        x_um = rng.randint(-500, 85_500)
        drift_um = rng.choice((0, 0, rng.randint(-40, 40), rng.randint(-3000, 3000)))
        force_mN = rng.choice((500, 1500, 5000))
        for _ in range(rng.choice((1, 4, 8, 30, 60))):
            doubt = rng.choice((0, 0, 0, 0, 0, 16, 128))
            read(1 | doubt, x_um, force_mN)
            x_um += drift_um
        for _ in range(rng.choice((0, 1, 4, 8, 60))):
            read(4, 0, 0)
    return readings


def some_fingers(rng, length_um, decay, seconds=9):
    """Return readings of random fingers that overlap; see the model in second.py."""
    lanes = rng.choice((2, 3))
    touches = []
    for lane in range(lanes):
        now_s = rng.uniform(0.05, 0.6)
        while now_s < seconds - 1:
            # Fingers are apart.
            places = [length_um * (lane + rng.uniform(0.15, 0.85)) / lanes for _ in range(2)]
            if rng.random() < 0.6:
                places[1] = places[0]  # does not slide
            rise_s, fall_s = rng.choice((0.015, 0.1)), rng.choice((0.015, 0.05, 0.15))
            held_s = rng.choice((0.06, 0.1, 0.2, 0.6, 1.0))
            light = 2 ** rng.uniform(7.5, 11.5)
            more = rng.choice((1, 1, rng.uniform(0.6, 1.5)))
            ends_s = now_s + rise_s + held_s + fall_s
            touches.append((now_s, rise_s, fall_s, ends_s, places, light, more))
            now_s = ends_s + rng.choice((0.03, 0.2, 0.6)) * rng.uniform(1, 1 + lane)
    readings = []
    start = rng.randint(0, contact_state.TICKS - 1)
    for i in range(100 * seconds):
        now_s = 0.01 * i
        found = []
        for from_s, rise_s, fall_s, ends_s, places, light, more in touches:
            if from_s < now_s < ends_s:
                past = (now_s - from_s) / (ends_s - from_s)
                ramp = min(1, (now_s - from_s) / rise_s, (ends_s - now_s) / fall_s)
                x_um = places[0] + (places[1] - places[0]) * past
                found.append((x_um, light * ramp * (1 + (more - 1) * past)))
        light = sum(one for _, one in found)
        t = (start + i * 10_000 // 1024) % contact_state.TICKS
        if light < 20:
            readings += [4, 0, 0, 0, t]
            continue
        per_um = math.log(2) * decay / 2**24
        shares = [one * math.exp(-per_um * x_um) for x_um, one in found]
        mean_um = sum(share * x_um for share, (x_um, _) in zip(shares, found)) / sum(shares)
        lost = sum(share * (x_um - mean_um) ** 2 for share, (x_um, _) in zip(shares, found))
        lost = 0.39 * per_um**2 * lost / sum(shares) / math.log(2)
        x_um = round(mean_um + rng.gauss(0, 90_000 / light))
        b = round((math.log2(light) - lost + rng.gauss(0, 0.01)) * (1 << 20))
        flags = 1 | (rng.choice((MISFIT, MISFIT, MISFIT | 4)) if lost > 0.03 else 0)
        if rng.random() < 0.003:
            flags |= rng.choice((SATURATED, LED_OFF, MISFIT))
        readings += [flags, max(0, min(x_um, length_um)), round(2.5 * light), b, t]
    return readings


def test_fingers_that_overlap(machine, cpython, rng, monkeypatch):
    cases = []
    for _ in range(7):
        length_um, decay = rng.choice(((85_000, 289), (85_000, 289), (200_000, 120)))
        limits = rng.choice(([], ["stuck_ms 600"], ["detect 1", "release_ms 0"]))
        slopes = [rng.randint(-(1 << 18), 1 << 18) for _ in range(2)]
        cross = rng.choice((None, [-1100, -900, 11_600_000], [*slopes, rng.randint(0, 24 << 20)]))
        readings = some_fingers(rng, length_um, decay)
        cases.append([[*limits, *default_lines()], length_um, decay, cross, *readings])
    kinds = {-1, 0, REMAINS, FOUND, MOVED, LIFTED, SAME, FADED}
    seen = results_of_watch(cases, monkeypatch)
    assert seen >= kinds
    expected = cpython.run("contacts", cases)
    assert len(expected) == sum((len(case) - 4) // 5 for case in cases)
    assert machine.run("contacts", cases) == expected


def results_of_watch(cases, monkeypatch):
    """Return the results of `pair.watch` for readings; of those with a length, only the kind."""
    seen = set()

    def watch(*arguments):
        what = pair.watch(*arguments)
        seen.add(what if what < 0 else what & 0xFF)
        return what

    monkeypatch.setattr(tracker, "watch", watch)
    for lines, length_um, decay, cross, *readings in cases:
        fingers = tracker.ContactTracker(Mock(**{"second.return_value": True}))
        fingers.set_layout(parse(lines), length_um, decay, cross)
        for i in range(0, len(readings), 5):
            fingers.take(*readings[i : i + 5])
    return seen


RICH = [
    "stuck_ms 500",
    "slide_um 2000",
    f"behaviour 0 {STICKY} 0 {action(MOMENTARY, 1)}",
    f"behaviour 1 {HOLD_TAP} 3 100 150 50 {action(BEHAVIOUR, 0)}",
    f"behaviour 2 {TAP_DANCE} 200 2 {action(KEYBOARD, 16)} {action(KEYBOARD, 17)}",
    f"behaviour 3 {MOD_MORPH} 2 0 {action(KEYBOARD, 18)} {action(KEYBOARD, 19)}",
    f"behaviour 4 {KEY_REPEAT}",
    f"behaviour 5 {CAPS_WORD}" + " 131586" * 19,
    f"behaviour 6 {STICKY} 500 {action(KEYBOARD, 0xE1)}",
    f"layer {action(CONSUMER, 0xE9)} {action(CONSUMER, 0xEA)}",
    *(f"key {low} {low + 100} {action(KEYBOARD, 4 + low // 100, 2)} 0 0 0 0 0" for low in (0, 100)),
    f"key 200 400 {action(KEYBOARD, 7)} 0 {action(KEYBOARD, 8)} 0 0 0",
    f"key 420 500 {action(KEYBOARD, 9)} {action(KEYBOARD, 10)} 0 {action(KEYBOARD, 11)} 0 0",
    f"key 500 700 {action(KEYBOARD, 12)} 0 0 0 {action(KEYBOARD, 13)} {action(KEYBOARD, 14)}",
    f"key 700 800 {action(BEHAVIOUR, 0)} 0 {action(TOGGLE, 1)} 0 0 0",
    f"key 800 900 {action(BEHAVIOUR, 2)} 0 0 0 0 0",
    f"key 900 1000 {action(BEHAVIOUR, 3)} 0 {action(BEHAVIOUR, 1)} {action(BEHAVIOUR, 6)} 0 0",
    "layer 0 0",
    f"key 0 300 {action(KEYBOARD, 15)} 0 {action(MOMENTARY, 2)} 0 0 0",
    f"key 300 500 {action(BEHAVIOUR, 5)} 0 0 0 0 0",
    f"key 500 1000 {action(TOGGLE, 1)} {action(BEHAVIOUR, 4)} 0 0 0 0",
    "layer 0 0",
    f"key 0 1000 {action(TO, 0)} 0 0 {action(BEHAVIOUR, 4)} 0 0",
]


def test_keypad(compare, rng):
    layouts = [default_lines(), *([f"flavor {flavor}", *RICH] for flavor in range(4))]
    cases = [(rng.choice(layouts), 85_000, a_finger(rng)) for _ in range(3)]
    for case in cases:  # the heap has no room for the arrays of all cases
        compare("keypad", [case], width=3 * 150)


# Results of a case: next sequence number, size, and the longest frame. COBS adds one byte, and one
# more for each 254 bytes; a zero byte ends the frame.
WIDTH = 2 + HEADER_SIZE + TEXT_MAX + CRC_SIZE + 5


def messages(rng):
    """Yield frame bodies with critical lengths: without zero bytes, and with many zero bytes."""
    ends = [0, 1, 2, 24, 253, 254, 255, 256, 508]
    for length in [end - HEADER_SIZE - CRC_SIZE for end in ends[3:]] + ends[:3] + [TEXT_MAX]:
        yield [rng.randint(1, 255) for _ in range(length)]
        yield [rng.choice((0, 0, 255)) for _ in range(length)]


def test_frame(compare, rng):
    every = list(messages(rng))
    for part in range(5):  # the heap has no room for the results of all cases
        compare("frame", every[part::5], width=WIDTH)


def test_touch(compare, rng):
    fields = (
        (0, 255),
        (-(1 << 29), 1 << 29),
        (-(1 << 29), 1 << 29),
        (-(1 << 29), 1 << 29),
        (0, FULL),
    )
    cases = [[rng.choice((0, *ends, rng.randint(*ends))) for ends in fields] for _ in range(50)]
    compare("touch", cases, width=1 + TOUCH_SIZE + CRC_SIZE + 2)


def test_board_time(compare, rng):
    longest_us = 1 << 28
    steps = [longest_us] * 40 + [-longest_us] * 5 + [1, -1, 0]
    steps += [rng.choice((10_000, -5000, rng.randint(0, longest_us))) for _ in range(500)]
    ticks = [step % TICKS for step in itertools.accumulate(steps)]
    compare("time32", ticks, width=2)


STALLS_US = [500, 2000, 9000, 200_000, 1_100_000, 1 << 28]


@pytest.mark.parametrize(
    ("exposures_us", "polls", "stalls_us"),
    [
        ((1000, 2780, 10_000, LIMITS["exposure_us"][1]), 100, STALLS_US),
        ((10_000,), 300, []),
        ((LIMITS["exposure_us"][1],), 300, []),
    ],
    ids=["stalls", "a steady board", "a steady board, longest exposure"],
)
def test_pacing(compare, rng, exposures_us, polls, stalls_us):
    cases = []
    for nominal_us, error_percent in itertools.product(exposures_us, (-6, 0, 6)):
        true_us = nominal_us * (100 + error_percent) // 100
        begins = (TICKS - rng.randint(0, 40 * nominal_us)) % TICKS
        punctual_us = [rng.randint(0, 300) for _ in range(40)]
        late_us = [rng.choice(punctual_us + stalls_us) for _ in range(polls)]
        cases.append((nominal_us, true_us, begins, late_us))
    compare("pacing", cases, width=4 * polls)


def test_a_float_on_the_way_to_the_same_integer_is_found(machine):
    machine.slip(
        "reading/log2", "\n_log2 = log2_q20\ndef log2_q20(n):\n    return int(_log2(n) * 1.0)\n"
    )
    with pytest.raises(RuntimeError, match="MemoryError"):
        machine.run("compute", {"trial": "log2", "cases": [1000], "width": 1})
