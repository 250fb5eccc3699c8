"""USB reports: the host gets each report at most one time and in order; no key stays pressed."""

import importlib
import sys
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from spots_device.keys.layout import action
from spots_device.keys.merge import Merger
from spots_device.usb.descriptors import (
    GAMEPAD_DESCRIPTOR,
    KEYBOARD_DESCRIPTOR,
    REPORT_SIZE,
    with_report_id,
)
from spots_device.usb.gamepad import GamepadReports
from spots_device.usb.reports import WAITING_MAX, KeyboardReports, OneKeyReports, Outbox
from spots_device.usb.usages import KEYBOARD, KEYS_MAX

UP = bytes(REPORT_SIZE)
A, B = 4, 5
SHIFT, ALT = 2, 4


class Host:
    """A USB host that refuses reports when the test says so, and stores the accepted reports."""

    def __init__(self, takes=True):
        self.takes = takes
        self.got = []

    def send(self, report):
        if self.takes:
            self.got.append(bytes(report))
        return self.takes


def drain(outbox, most=100):
    for _ in range(most):
        if outbox.pump():
            return
    raise AssertionError("the line does not end")


def still():
    return 0


class Keys(KeyboardReports):
    """Keyboard reports of key events, merged as on a board."""

    def __init__(self, send, ticks):
        super().__init__(send, ticks)
        self.merger = Merger()

    def event(self, usage, modifiers, pressed):
        change = self.merger.press if pressed else self.merger.release
        sink = SimpleNamespace(
            usage=lambda page, *rest: self.key(*rest), key=lambda *_: self.flush()
        )
        change(sink, action(KEYBOARD, usage, modifiers))


def keyboard(takes=True, ticks=still):
    host = Host(takes)
    return Keys(host.send, ticks), host


def report(*usages, modifiers=0):
    return bytes((modifiers, 0, *usages, *[0] * (KEYS_MAX - len(usages))))


def pressed(reports):
    """Return the set of pressed keys in each keyboard report."""
    return [frozenset(one[2:]) - {0} for one in reports]


def test_a_press_and_a_release_are_two_reports():
    keys, host = keyboard()
    keys.event(A, SHIFT, True)
    keys.event(A, SHIFT, False)
    drain(keys.outbox)
    assert host.got == [report(modifiers=SHIFT), report(A, modifiers=SHIFT), UP]


def test_a_pump_offers_once_and_a_refusal_costs_nothing():
    keys, host = keyboard(takes=False)
    keys.event(A, 0, True)
    keys.event(A, 0, False)
    for _ in range(1000):
        assert not keys.outbox.pump()
    host.takes = True
    assert not keys.outbox.pump()
    assert keys.outbox.pump()
    assert keys.outbox.pump()
    assert host.got == [report(A), UP]
    assert keys.outbox.dropped == 0


def test_a_modifier_is_a_key_too():
    keys, host = keyboard()
    keys.event(0xE1, 0, True)
    keys.event(A, ALT, True)
    keys.event(0xE1, 0, False)
    keys.event(A, ALT, False)
    drain(keys.outbox)
    assert host.got == [
        report(modifiers=SHIFT),
        report(modifiers=SHIFT | ALT),
        report(A, modifiers=SHIFT | ALT),
        report(A, modifiers=ALT),
        UP,
    ]


def test_the_last_media_key_counts():
    host = Host()
    keys = OneKeyReports(host.send, still)
    for usage, pressed in (
        (0xE9, True),
        (0x1B5, True),
        (0xE9, False),  # this key is released already
        (0x1B5, False),
    ):
        keys.key(usage, 0, pressed)
        keys.flush()
    drain(keys.outbox)
    assert host.got == [b"\xe9\0", b"\xb5\x01", b"\0\0"]


def test_the_modifiers_of_a_key_end_with_it():
    keys, host = keyboard()
    keys.event(A, SHIFT, True)
    keys.event(B, SHIFT | ALT, True)
    keys.event(B, SHIFT | ALT, False)
    keys.event(A, SHIFT, False)
    drain(keys.outbox)
    assert [one[0] for one in host.got] == [SHIFT, SHIFT, SHIFT | ALT, SHIFT | ALT, 0, 0]


def test_what_is_no_change_is_no_report():
    keys, host = keyboard()
    keys.event(A, 0, False)
    keys.event(A, 0, True)
    keys.key(A, 0, True)
    keys.flush()
    drain(keys.outbox)
    assert host.got == [report(A)]


def test_the_same_key_again_is_released_first_and_ends_with_the_last_finger():
    keys, host = keyboard()
    for pressed in (True, True, False, False):
        keys.event(A, 0, pressed)
    drain(keys.outbox)
    assert host.got == [report(A), UP, report(A), UP]


def test_a_seventh_key_is_not_taken():
    keys, host = keyboard()
    for usage in range(A, A + 7):
        keys.event(usage, 0, True)
    keys.event(A + 6, 0, False)
    drain(keys.outbox)
    assert host.got[-1] == report(*range(A, A + 6))
    assert len(host.got) == 6


def test_a_full_line_refuses_and_the_last_state_follows():
    keys, host = keyboard(takes=False)
    for _ in range(WAITING_MAX // 2):
        keys.event(B, 0, True)
        assert keys.outbox.has_room() == (keys.outbox.count <= 10)
        keys.event(B, 0, False)
    assert not keys.unsent
    keys.event(A, 0, True)
    assert keys.unsent
    host.takes = True
    drain(keys.outbox)
    keys.flush()
    drain(keys.outbox)
    assert keys.outbox.dropped == 0
    assert host.got == [report(B), UP] * (WAITING_MAX // 2) + [report(A)]


def test_release_drops_what_waits_and_lets_go():
    keys, host = keyboard()
    keys.event(A, SHIFT, True)
    drain(keys.outbox)
    keys.event(B, SHIFT, True)
    keys.release()
    drain(keys.outbox)
    assert host.got == [report(modifiers=SHIFT), report(A, modifiers=SHIFT), UP]
    assert keys.outbox.dropped == 1
    keys.event(B, 0, True)
    drain(keys.outbox)
    assert host.got[-1] == report(B)


def test_release_says_nothing_to_a_host_that_knows_of_nothing():
    keys, host = keyboard()
    keys.release()
    keys.event(A, 0, True)
    keys.release()
    drain(keys.outbox)
    assert host.got == []


def test_an_exception_after_the_host_took_a_press_does_not_hide_the_key():
    class Interrupted(Host):
        def send(self, report):
            super().send(report)
            raise KeyboardInterrupt

    host = Interrupted()
    outbox = Outbox(host.send, still)
    outbox.put(report(A))
    with pytest.raises(KeyboardInterrupt):
        outbox.pump()
    outbox._send = Host.send.__get__(host)
    outbox.release()
    drain(outbox)
    assert host.got == [report(A), UP]


EVENTS = st.lists(
    st.tuples(st.integers(A, A + 8), st.integers(0, 255), st.booleans(), st.integers(0, 3)),
    max_size=60,
)


def alternating(events):
    """Yield the events that change a key; a release has the modifiers of its press."""
    pressed = {}
    for usage, modifiers, down, pumps in events:
        if down != (usage in pressed):
            if down:
                pressed[usage] = modifiers
            yield usage, pressed.pop(usage) if not down else modifiers, down, pumps


@given(events=EVENTS, takes=st.lists(st.booleans(), max_size=200))
def test_whatever_is_refused_the_host_gets_every_report_in_order(events, takes):
    ideal, all_of_it = keyboard()
    keys, host = keyboard()
    answers = iter(takes)
    refused = False
    for usage, modifiers, down, pumps in alternating(events):
        ideal.event(usage, modifiers, down)
        drain(ideal.outbox)
        keys.event(usage, modifiers, down)
        refused |= keys.unsent
        for _ in range(pumps):
            host.takes = next(answers, True)
            keys.outbox.pump()
    host.takes = True
    if not refused:
        drain(keys.outbox)
        assert host.got == all_of_it.got
    keys.release()
    drain(keys.outbox)
    assert not host.got or host.got[-1] == UP


class Sleeper:
    """A keyboard that is pumped each ms, like the loop of `outputs.Outputs`, and its host."""

    def __init__(self, start_ms=0):
        self.ms = start_ms
        self.keys, self.host = keyboard(ticks=lambda: self.ms * 1000 // 1024 & 0x3FFFFF)

    def run(self, ms):
        for _ in range(ms):
            self.ms += 1
            if self.keys.outbox.count:
                if self.keys.outbox.expire():
                    self.keys.release()
                self.keys.outbox.pump()

    def tap(self, usage, ms=50):
        self.keys.event(usage, 0, True)
        self.run(ms)
        self.keys.event(usage, 0, False)


@pytest.mark.parametrize("hours", [0.0002, 0.01, 1.19, 1.2, 30.0])
def test_a_host_that_wakes_gets_only_keys_of_the_last_half_second(hours):
    desk = Sleeper()
    desk.host.takes = False
    desk.tap(A)
    desk.run(int(hours * 3_600_000) if hours < 0.1 else 1_000)
    desk.ms += int(hours * 3_600_000)
    desk.tap(B)
    desk.run(200)
    desk.host.takes = True
    desk.run(10)
    # The first report releases all keys, because a refused report may have been delivered.
    assert pressed(desk.host.got) == [frozenset(), {B}, frozenset()]
    assert desk.keys.outbox.dropped == 1  # the press; its release is sent


def test_of_several_taps_only_the_stale_ones_are_dropped():
    desk = Sleeper()
    desk.host.takes = False
    for usage in range(A, A + 6):
        desk.tap(usage, 100)
        desk.run(100)
    desk.host.takes = True
    desk.run(20)
    assert pressed(desk.host.got) == [
        frozenset(),
        {A + 4},
        frozenset(),
        {A + 5},
        frozenset(),
    ]


def test_a_release_never_becomes_stale():
    desk = Sleeper()
    desk.keys.event(A, SHIFT, True)
    desk.run(10)
    desk.host.takes = False
    desk.keys.event(A, SHIFT, False)
    desk.run(2_000)
    desk.tap(B)
    desk.run(2_000)
    desk.host.takes = True
    desk.run(10)
    assert desk.host.got == [report(modifiers=SHIFT), report(A, modifiers=SHIFT), UP]


def test_a_key_that_is_still_down_when_the_host_wakes_is_not_pressed():
    desk = Sleeper()
    desk.host.takes = False
    desk.keys.event(A, 0, True)
    desk.run(1_000)
    desk.host.takes = True
    desk.run(10)
    desk.keys.event(B, 0, True)
    desk.keys.event(A, 0, False)
    desk.run(10)
    assert pressed(desk.host.got) == [frozenset(), {B}]


@pytest.mark.board
@given(
    events=st.lists(
        st.tuples(st.integers(A, A + 4), st.integers(1, 400), st.booleans()), max_size=40
    ),
    start=st.integers(0, 5_000_000),
)
def test_whenever_the_host_sleeps_no_press_is_late_and_no_key_stays(events, start):
    desk = Sleeper(start)
    down, when, got = set(), {}, 0
    for usage, ms, takes in events:
        desk.host.takes = takes
        (down.remove if usage in down else down.add)(usage)
        desk.keys.event(usage, 0, usage in down)
        when[usage] = desk.ms
        for _ in range(ms):
            before = (pressed(desk.host.got) or [frozenset()])[-1]
            desk.run(1)
            for keys in pressed(desk.host.got)[got:]:
                assert all(desk.ms - when[key] <= 502 for key in keys - before)
                before = keys
            got = len(desk.host.got)
    desk.host.takes = True
    desk.run(20)
    assert (pressed(desk.host.got) or [frozenset()])[-1] <= down


@given(events=EVENTS, takes=st.lists(st.booleans(), max_size=200))
def test_whatever_is_dropped_no_key_stays_that_was_let_go(events, takes):
    keys, host = keyboard()
    answers = iter(takes)
    down_now = set()
    for usage, _, down, pumps in alternating(events):
        keys.event(usage, 0, down)
        (down_now.add if down else down_now.discard)(usage)
        for _ in range(pumps):
            host.takes = next(answers, False)
            keys.outbox.pump()
    host.takes = True
    drain(keys.outbox)
    keys.flush()
    drain(keys.outbox)
    assert all(one != two for one, two in zip(host.got, host.got[1:]))
    assert (pressed(host.got) or [frozenset()])[-1] <= down_now


def test_a_gamepad_sends_the_latest_of_its_axes_and_every_change_of_its_buttons():
    host = Host(takes=False)
    pad = GamepadReports(host.send, still)
    for x in range(50):
        pad.update(x, 0, 2 * x, 1)
        pad.outbox.pump()
    pad.update(0, 0, 0, 0)
    pad.update(-1, 0, 7, 1)
    pad.update(-32_767, 0, 32_767, 1)
    host.takes = True
    drain(pad.outbox)
    assert [one.hex() for one in host.got] == [
        "3100000062000100",
        "0000000000000000",
        "01800000ff7f0100",
    ]


def test_a_gamepad_that_rests_sends_nothing():
    host = Host()
    pad = GamepadReports(host.send, still)
    for _ in range(3):
        pad.update(0, 0, 0, 0)
        drain(pad.outbox)
    pad.update(5, 0, 5, 1)
    drain(pad.outbox)
    pad.update(5, 0, 5, 1)
    drain(pad.outbox)
    assert len(host.got) == 1


def test_a_gamepad_lets_go_and_begins_again():
    host = Host()
    pad = GamepadReports(host.send, still)
    pad.update(5, 0, 5, 1)
    drain(pad.outbox)
    pad.release()
    drain(pad.outbox)
    assert host.got[-1] == UP
    pad.update(5, 0, 5, 1)
    drain(pad.outbox)
    assert len(host.got) == 3


def items(descriptor):
    """Return the short items of a report descriptor as (type and tag, value)."""
    found, at = [], 0
    while at < len(descriptor):
        size = (0, 1, 2, 4)[descriptor[at] & 3]
        data = descriptor[at + 1 : at + 1 + size]
        assert len(data) == size
        found.append((descriptor[at] & 0xFC, int.from_bytes(data, "little")))
        at += 1 + size
    return found


def bits(descriptor, wanted):
    """Return the number of bits in the reports of a descriptor.

    `wanted` is 0x80 for input reports, 0x90 for output reports.
    """
    size = count = total = 0
    for tag, value in items(descriptor):
        size = value if tag == 0x74 else size
        count = value if tag == 0x94 else count
        total += size * count if tag == wanted else 0
    return total


@pytest.mark.parametrize("descriptor", [KEYBOARD_DESCRIPTOR, GAMEPAD_DESCRIPTOR])
def test_a_descriptor_describes_reports_of_eight_bytes(descriptor):
    assert bits(descriptor, 0x80) == 8 * REPORT_SIZE
    assert bits(descriptor, 0x90) == (8 if descriptor is KEYBOARD_DESCRIPTOR else 0)
    tags = [tag for tag, _ in items(descriptor)]
    assert tags.count(0xA0) == tags.count(0xC0) == 1
    assert tags[-1] == 0xC0


def test_a_report_id_stands_inside_the_collection():
    tags = items(with_report_id(GAMEPAD_DESCRIPTOR, 4))
    assert tags[:4] == [(0x04, 1), (0x08, 5), (0xA0, 1), (0x84, 4)]
    assert [pair for pair in tags if pair[0] != 0x84] == items(GAMEPAD_DESCRIPTOR)


@pytest.fixture
def adafruit_keyboard(monkeypatch):
    """Module `adafruit_hid.keyboard`, whose reports are known to work with computers."""
    usb_hid = SimpleNamespace(Device=None)
    monkeypatch.setitem(sys.modules, "usb_hid", usb_hid)
    return importlib.import_module("adafruit_hid.keyboard")


def test_a_keyboard_reports_what_adafruits_does(adafruit_keyboard):
    theirs = []
    device = SimpleNamespace(
        usage_page=1, usage=6, send_report=lambda report: theirs.append(bytes(report))
    )
    peer = adafruit_keyboard.Keyboard([device])
    theirs.clear()  # Adafruit's keyboard sends a release report at its start
    keys, host = keyboard()
    shift = adafruit_keyboard.Keycode.LEFT_SHIFT
    peer.press(A)
    peer.press(shift)  # with B, it would be one report
    peer.press(B)
    keys.event(A, 0, True)
    keys.event(B, SHIFT, True)
    peer.release(A)
    keys.event(A, 0, False)
    peer.release(shift, B)
    keys.event(B, SHIFT, False)
    drain(keys.outbox)
    assert [one[:2] for one in host.got] == [one[:2] for one in theirs]
    assert pressed(host.got) == pressed(theirs) == [{A}, {A}, {A, B}, {B}, set()]
