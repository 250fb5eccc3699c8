"""The whole loop in a real MicroPython, from registers to framed bytes, while the heap is locked.

An allocation raises MemoryError. The sent bytes must be the same as in CPython for the same scenes.
A scene is the light on the sensor and the state of the board for some time, see `scene`.
"""

import pytest

from spots.link.decoder import Decoder
from spots.link.frames import Contact, Key, Spectrum, Touch
from spots_device.fingers.contacts import (
    CONFIRMED,
    DOWN,
    PROVISIONAL,
    UP,
)
from spots_device.keys.layout import BEHAVIOUR, TEXT, action
from spots_device.reading.calibration import Calibration
from spots_device.reading.calibration_lines import CalibrationError
from spots_device.reading.dark import _DARK_EVERY_US, IDLE_US
from spots_device.reading.decode import (
    DARK_SUBTRACTED,
    DROPPED,
    LED_OFF,
    MISFIT,
    NOT_CALIBRATED,
    SATURATED,
    TOO_DARK,
    TOUCHING,
)
from spots_device.sensor.exposure import MAX_US
from spots_device.usb.usages import KEYBOARD

pytestmark = pytest.mark.board

# Counts of presses at the two ends of the default sensor's strip, and of more and less light.
NEAR, FAR = [1372, 1392, 1751, 2027, 2449, 1275], [251, 260, 381, 698, 1382, 881]
FEEBLE = [81, 84, 125, 229, 458, 291]  # about a third of `FAR`: beyond the far end
FAINT = [count // 24 for count in NEAR]
TWO_FINGERS = [(near + far) // 2 for near, far in zip(NEAR, FAR)]
DARK = [1, 2, 1, 2, 2, 2]  # so few that no hand shades them
ROOM, LAMP, SHADED = [3, 4, 3, 5, 4, 4], [8] * 6, [4] * 6
NONE, FULL = [0] * 6, [65_535] * 6
UNEVEN = [65_535, 1] * 3

UNCALIBRATED, REAL, LEAST, LARGEST, SOFT = range(5)
DARK_WINDOW_MS = 150  # longer than a dark window, at 10 ms a sample
ALIEN_MS = 160  # light that no presses cause requests a dark window
DARK_FRAME_MS = 750  # longer than a dark frame of 16 windows


def scene(flags, lit, calibration=REAL, lasts_ms=60, average=1, **other):
    """Return a scene for the script, and the flags that its last reading must have.

    Parameters
    ----------
    flags : int
        These flags.
    lit : list of int
        Six counts with the LED on.
    calibration : int
        Index of the calibration to use.
    lasts_ms : int
        Duration in ms of the board's clock.
    average : int
        Samples in a reading.
    other
        Other items of the scene, see `play` in scripts/sample_path.py.
    """
    usual = {"dark": DARK, "request_dark": False, "saturated": False}
    usual |= {"port_takes": True, "stall_us": 0}
    made = {"lit": lit, "calibration": calibration, "lasts_ms": lasts_ms, "average": average}
    return {**usual, **made, **other}, flags


SCENES = {
    "no calibration": scene(NOT_CALIBRATED, NEAR, UNCALIBRATED, lasts_ms=1500),
    "a dark frame on request": scene(TOUCHING, NEAR, request_dark=True, lasts_ms=DARK_FRAME_MS),
    "a finger near the sensor": scene(TOUCHING, NEAR),
    "a finger at the far end": scene(TOUCHING, FAR),
    "less than a tenth of its light": scene(TOO_DARK, FAINT),
    "a finger, averaged": scene(TOUCHING, NEAR, average=64, lasts_ms=1500),
    "two fingers": scene(TOUCHING | MISFIT, TWO_FINGERS),
    "analog saturation": scene(TOUCHING | SATURATED, NEAR, saturated=True),
    "as much light as fits": scene(TOUCHING | SATURATED | MISFIT, FULL, lasts_ms=ALIEN_MS),
    "nobody": scene(TOO_DARK, DARK),
    "less light than in the dark": scene(TOO_DARK, NONE),
    "a channel without light": scene(TOO_DARK, [*NEAR[:5], 0]),
    "a feeble touch": scene(TOUCHING | TOO_DARK, FEEBLE),  # beyond the far end
    "a port that takes nothing": scene(None, NEAR, port_takes=False),
    "a port that takes again": scene(TOUCHING, NEAR),
    "a stall of three samples": scene(TOUCHING, FAR, stall_us=30_000),
    "a stall of minutes": scene(TOUCHING, FAR, stall_us=1 << 28),
    "a stall of minutes again": scene(TOUCHING, FAR, stall_us=1 << 28),
    "a finger that never left meanwhile": scene(TOUCHING, FAR, stall_us=1 << 28),
    "a finger for a long time": scene(
        TOUCHING, NEAR, average=64, lasts_ms=_DARK_EVERY_US // 1000 + 1000
    ),
    "the dark window when it lifts": scene(
        # With the lit samples after the window, which end the baseline of an object.
        TOO_DARK,
        DARK,
        lasts_ms=IDLE_US // 1000 + DARK_WINDOW_MS + 80,
    ),
    "a finger after that": scene(TOUCHING, NEAR),
    "nobody after that": scene(
        TOO_DARK, DARK, dark=NONE, request_dark=True, lasts_ms=DARK_FRAME_MS
    ),
    "the least table": scene(TOUCHING | SATURATED | MISFIT, UNEVEN, LEAST, dark=NONE, lasts_ms=300),
    "the largest table": scene(
        TOUCHING | SATURATED | MISFIT, UNEVEN[::-1], LARGEST, dark=NONE, lasts_ms=ALIEN_MS
    ),
    "the largest table, averaged": scene(
        TOUCHING | SATURATED | MISFIT, UNEVEN, LARGEST, average=64, lasts_ms=1500, dark=NONE
    ),
    "creep of a held finger": scene(TOUCHING, NEAR, SOFT, lasts_ms=100),
    "hysteresis of a weaker finger": scene(TOUCHING, [n * 3 // 4 for n in NEAR], SOFT),
    "a dark frame of a lamp": scene(
        TOO_DARK, LAMP, dark=LAMP, request_dark=True, lasts_ms=DARK_FRAME_MS
    ),
    "a hand that shades the lamp": scene(TOUCHING, NEAR, dark=SHADED, average=8, lasts_ms=2700),
}
WITH_DARK_WINDOW = {
    "a dark frame of a lamp",
    "a hand that shades the lamp",
    "a dark frame on request",
    "as much light as fits",
    "the dark window when it lifts",
    "nobody after that",
    "the least table",
    "the largest table",
    "the largest table, averaged",
    "nobody for long",
}
AFTER_A_GAP = {
    "a port that takes again",
    "a stall of minutes",
    "a stall of minutes again",
    "a finger that never left meanwhile",
    "nobody for long",  # the first scene of its run, which also starts the sensor
}

# A layout with all kinds of actions, so that the scenes run each path of the key engine.
LAYOUT = [
    "stuck_ms 5000",
    "text 516 1280 5",  # a capital, a pause and a letter
    "behaviour 0 %d 0 3" % TEXT,
    "layer %d %d" % (action(KEYBOARD, 4), action(KEYBOARD, 5)),
    "key 0 400 %d 0 %d 0 0 0" % (action(KEYBOARD, 30), action(BEHAVIOUR, 0)),
    "key 400 700 %d %d 0 %d 0 0" % tuple(action(KEYBOARD, usage) for usage in (7, 8, 9)),
    "key 700 1000 %d 0 0 0 %d %d" % tuple(action(KEYBOARD, usage) for usage in (10, 11, 12)),
]

# Scenes for the longest exposure and the largest average.
LONG_SCENES = {
    "nobody for long": scene(TOO_DARK, ROOM, dark=ROOM, lasts_ms=125_000),
    "a finger for longer": scene(TOUCHING, NEAR, dark=ROOM, average=64, lasts_ms=75_000),
}


# Gain; half widths and weights of play operators; time constants and shares of creep.
# The tables change with the temperature; in the long scenes, the board has time for it.
THERMAL = ["temperature 20000 10000 30000", "warm 42500 9000 4000 0 -3000 -6000 -4000"]
SILICONE = "silicone 4200 300 1000 3000 500 100 80 40 400 40000 200 80 20"


def farthest(calibration, largest):
    """Return a calibration with the largest valid weights and numbers.

    If `largest` is true, the arguments of its tables are as large as possible, and it has a
    cross-sensitivity; else they are as small as possible.
    """
    kept = [line for line in calibration if line.split()[0] in ("board", "plan", "made", "touch")]
    kept += ["coarse 32768 -32768 0 0 0 0", "fit -32768 32768 0 0 0 0"]
    kept += ["segment 32768 -32768 0 0 0 0 36864 -28672 0 0 0 0"]
    for bits in range(30, 20, -1):
        ends = [-(1 << bits), 9 - (1 << bits)]
        tables = ["f %d 1 9" % ends[0], "f %d 65535 9" % ends[1], "strain 0"]
        if largest:
            ends = [~ends[1], ~ends[0]]
        tables += ["from %d" % ends[0]]
        tables += ["x %d %d %d %d" % (end, end, ~end, -abs(end)) for end in ends]
        if largest:
            cross = {"f ": " -4096", "x ": " -131072 131072"}
            tables = [line + cross.get(line[:2], "") for line in tables]
        try:
            Calibration(kept + tables)
        except CalibrationError:
            continue
        return kept + tables
    raise AssertionError("no calibration of this form is allowed")


@pytest.fixture(scope="module")
def given(calibration):
    calibrations = [None, calibration, farthest(calibration, False), farthest(calibration, True)]
    calibrations.append([*calibration, SILICONE])
    return {
        "settings": ["exposure_us=10000"],
        "calibrations": calibrations,
        "scenes": [played for played, _ in SCENES.values()],
        "port_bytes": 74_000,
        "contacts": False,
        "uses": [],
        "layout": [],
        "lock": True,
    }


@pytest.fixture(scope="module")
def given_long(given):
    settings = ["exposure_us=%d" % MAX_US, "average=64"]
    scenes = [played for played, _ in LONG_SCENES.values()]
    calibrations = [lines + THERMAL if lines else lines for lines in given["calibrations"]]
    return {**given, "settings": settings, "scenes": scenes, "calibrations": calibrations}


def frames_of(lines, scenes):
    """Return the TOUCH and the SPECTRUM frames of each scene, as a dict by name of the scene.

    `lines` has the sent bytes of each scene in hexadecimal.
    """
    decoder = Decoder()
    frames = {name: decoder.feed(bytes.fromhex(line)) for name, line in zip(scenes, lines)}
    assert decoder.stats.bad_crc == 0
    return {
        name: tuple([f for f in found if isinstance(f, kind)] for kind in (Touch, Spectrum))
        for name, found in frames.items()
    }


@pytest.fixture(scope="module")
def expected(cpython, given):
    return cpython.run("sample_path", given)


@pytest.fixture(scope="module")
def expected_long(cpython, given_long):
    return cpython.run("sample_path", given_long)


@pytest.fixture(scope="module")
def given_uses(given):
    return {**given, "uses": ["keys=1", "gamepad=1"], "layout": LAYOUT}


@pytest.fixture(scope="module")
def expected_uses(cpython, given_uses):
    return cpython.run("sample_path", given_uses)


@pytest.fixture(scope="module")
def given_contacts(given):
    return {**given, "contacts": True}


@pytest.fixture(scope="module")
def expected_contacts(cpython, given_contacts):
    return cpython.run("sample_path", given_contacts)


@pytest.fixture(scope="module")
def frames(expected, expected_long):
    return {**frames_of(expected, SCENES), **frames_of(expected_long, LONG_SCENES)}


def test_the_loop_allocates_nothing_and_sends_the_bytes_of_cpython(machine, given, expected):
    assert machine.run("sample_path", given) == expected


def test_nor_does_it_at_the_longest_exposure_and_average(machine, given_long, expected_long):
    assert machine.run("sample_path", given_long) == expected_long


def test_nor_does_it_as_a_keyboard_and_gamepad(machine, given_uses, expected_uses):
    assert machine.run("sample_path", given_uses) == expected_uses


def test_nor_does_it_with_contacts(machine, given_contacts, expected_contacts):
    assert machine.run("sample_path", given_contacts) == expected_contacts


def test_nor_with_contacts_and_keys(machine, cpython, given_uses):
    given = {**given_uses, "contacts": True}
    assert machine.run("sample_path", given) == cpython.run("sample_path", given)


def test_fingers_come_and_go_in_these_scenes(expected_contacts):
    frames = Decoder().feed(bytes.fromhex("".join(expected_contacts[:-2])))
    contacts = [f for f in frames if isinstance(f, Contact)]
    assert {contact.state for contact in contacts} >= {DOWN, PROVISIONAL, CONFIRMED, UP}
    assert not any(isinstance(f, Key) for f in frames)


def test_keys_and_axes_move_in_these_scenes(expected_uses):
    frames = Decoder().feed(bytes.fromhex("".join(expected_uses[:-2])))
    keys = [f for f in frames if isinstance(f, Key)]
    assert len(keys) > 3
    kept = bytes.fromhex(expected_uses[-2])
    reports = [kept[i : i + 8] for i in range(0, len(kept), 8)]
    assert {f.usage for f in keys if f.pressed} <= {report[2] for report in reports}
    assert any(report[6:] == b"\1\0" for report in reports)


def test_no_byte_more_is_allocated_when_the_heap_is_open(machine, given):
    assert machine.run("sample_path", {**given, "lock": False})[-1] == "0"


def test_nor_with_contacts(machine, given_contacts):
    assert machine.run("sample_path", {**given_contacts, "lock": False})[-1] == "0"


def test_nor_as_a_keyboard_and_gamepad(machine, given_uses):
    assert machine.run("sample_path", {**given_uses, "lock": False})[-1] == "0"


@pytest.mark.parametrize("name", [*SCENES, *LONG_SCENES])
def test_every_scene_is_what_its_name_says(frames, name):
    played, flags = {**SCENES, **LONG_SCENES}[name]
    readings, spectra = frames[name]
    assert len(readings) == len(spectra)
    assert bool(readings) == played["port_takes"]
    if not readings:
        return
    lit = [reading for reading in readings if not reading.flags & LED_OFF]
    assert lit[-1].flags & ~DARK_SUBTRACTED == flags
    assert list(spectra[-1].counts) == played["lit"]
    assert any(reading.flags & LED_OFF for reading in readings) == (name in WITH_DARK_WINDOW)
    assert bool(readings[0].flags & DROPPED) == (name in AFTER_A_GAP)


# A defect for the tests: the results are the same, but the loop allocates memory.
DETOUR = """
_process = process
def process(work, flags):
    size = _process(work, flags)
    if size:
        state = work[0]
        state[0] = %s
    return size
"""
SLIPS = {
    "a float": DETOUR % "int(state[0] * 1.0)",
    "a list": DETOUR % "[state[0]][0]",
    "a tuple": DETOUR % "(state[0],)[0]",
}
PRODUCT_OF_MORE_THAN_31_BITS = """
def _dots(tables, first, state):
    for row in range(2):
        total = 0
        for i in range(CHANNELS):
            total += tables[first + CHANNELS * row + i] * state[d.LOGS + i]
        state[d.FOUND + row] = total >> 13
"""


@pytest.mark.parametrize("slip", SLIPS)
def test_what_allocates_is_found(machine, given, slip):
    machine.slip("reading/strip", SLIPS[slip])
    with pytest.raises(RuntimeError, match="MemoryError"):
        machine.run("sample_path", given)


def test_what_leaves_a_small_integer_is_found_by_the_machine_of_32_bits(
    machine, machine_bits, given, expected
):
    machine.slip("reading/kernel", PRODUCT_OF_MORE_THAN_31_BITS)
    if machine_bits == 32:
        with pytest.raises(RuntimeError, match="MemoryError"):
            machine.run("sample_path", given)
    else:
        assert machine.run("sample_path", given) == expected


def test_what_stays_allocated_is_counted(machine, given):
    machine.slip("reading/strip", SLIPS["a list"])
    assert int(machine.run("sample_path", {**given, "lock": False})[-1]) > 0
