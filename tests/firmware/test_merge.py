"""Actions of several keys at once: a computer types what each key means, on board and host."""

from types import SimpleNamespace

import pytest
from support.computer import Computer, text_of

from spots.outputs.usages import chord_of
from spots_device.keys.layout import action
from spots_device.keys.merge import Merger
from spots_device.usb.reports import KeyboardReports
from spots_device.usb.usages import KEYS_MAX

A = action(7, 4)


class Both:
    """A keyboard of a board and one of a computer, which get the same actions."""

    def __init__(self):
        self.reports = []
        self.board = KeyboardReports(lambda report: not self.reports.append(bytes(report)), int)
        self.computer = Computer()
        self.merger = Merger()
        self.keys = []

    def usage(self, page, usage, modifiers, pressed):
        if page == 7:
            self.board.key(usage, modifiers, pressed)
        self.computer.usage(page, usage, modifiers, pressed)

    def key(self, *event):
        self.keys.append(event)
        self.board.flush()
        while not self.board.outbox.pump():
            pass

    def press(self, text):
        return self.merger.press(self, action(*chord_of(text)))

    def release(self, text):
        self.merger.release(self, action(*chord_of(text)))


def text(first, second, how):
    """Return what both keyboards type if two keys are pressed: rolled or nested."""
    both = Both()
    both.press(first)
    both.press(second)
    for name in (first, second) if how == "rolled" else (second, first):
        both.release(name)
    assert not both.computer.down
    assert not any(both.reports[-1])
    assert text_of(both.reports) == both.computer.text
    return both.computer.text


@pytest.mark.parametrize("how", ["rolled", "nested"])
@pytest.mark.parametrize(
    ("first", "second", "wanted"),
    [
        ("A", "B", "ab"),
        ("LEFT_SHIFT+1", "=", "!="),
        ("LEFT_SHIFT+BACKSLASH", "/", "|/"),
        ("LEFT_SHIFT+=", "=", "+="),
        ("=", "LEFT_SHIFT+=", "=+"),
        ("A", "LEFT_SHIFT+B", "aB"),
        ("A", "A", "aa"),
        ("LEFT_SHIFT+A", "LEFT_SHIFT+A", "AA"),
        ("LEFT_CONTROL+C", "V", "<01 C>v"),  # must not paste
        ("LEFT_SHIFT", "A", "A"),
        ("RIGHT_SHIFT", "LEFT_SHIFT+1", "!"),
        ("LEFT_SHIFT+1", "LEFT_SHIFT", "!"),
        ("LEFT_ALT+LEFT_SHIFT", "TAB", "<06 TAB>"),
        ("LEFT_CONTROL+LEFT_SHIFT+LEFT_ALT+LEFT_GUI", "A", "<0f A>"),
    ],
)
def test_two_keys_at_once_type_what_each_of_them_means(first, second, wanted, how):
    assert text(first, second, how) == wanted


def test_a_chord_of_modifiers_is_all_of_them():
    both = Both()
    both.press("LEFT_ALT+LEFT_SHIFT")
    assert both.reports[-1][0] == 6
    assert both.keys == [(7, 0xE1, 6, True)]
    both.release("LEFT_ALT+LEFT_SHIFT")
    assert both.reports == [bytes((6, *bytes(7))), bytes(8)]


def test_a_modifier_is_a_report_before_its_key_and_no_event():
    both = Both()
    both.press("LEFT_SHIFT+1")
    both.release("LEFT_SHIFT+1")
    assert [report[:3] for report in both.reports] == [b"\2\0\0", b"\2\0\x1e", b"\0\0\0"]
    assert both.keys == [(7, 30, 2, True), (7, 30, 0, False)]


def test_a_modifier_that_two_fingers_hold_ends_with_the_second():
    both = Both()
    for name in ("LEFT_SHIFT", "LEFT_SHIFT"):
        both.press(name)
    both.release("LEFT_SHIFT")
    assert both.computer.down == ["LEFT_SHIFT"]
    both.release("LEFT_SHIFT")
    assert not both.computer.down


def test_a_seventh_key_is_refused_and_its_release_changes_nothing():
    both = Both()
    names = "ABCDEFG"
    assert [both.press(name) for name in names] == [True] * KEYS_MAX + [False]
    both.release("G")
    assert len(both.computer.down) == KEYS_MAX
    for name in names:
        both.release(name)
    assert not both.computer.down


@pytest.mark.parametrize("how", ["rolled", "nested"])
@pytest.mark.parametrize(
    ("first", "second"), [("A", "A"), ("LEFT_SHIFT+1", "="), ("=", "LEFT_SHIFT+=")]
)
def test_two_strips_are_one_keyboard(first, second, how):
    """Each strip sends its own events; the keyboard and its modifiers are shared."""
    both = Both()
    strips = [
        SimpleNamespace(usage=both.usage, key=lambda *event, i=i: both.key(i, *event))
        for i in range(2)
    ]
    actions = [action(*chord_of(name)) for name in (first, second)]
    for i in range(2):
        both.merger.press(strips[i], actions[i])
    for i in (0, 1) if how == "rolled" else (1, 0):
        both.merger.release(strips[i], actions[i])
    assert text_of(both.reports) == both.computer.text == text(first, second, how)
    for i in range(2):
        assert [event[-1] for event in both.keys if event[0] == i] == [True, False]


@pytest.mark.parametrize("at", range(4))
def test_an_interrupt_does_not_hide_a_key_that_is_down(at):
    both, calls = Both(), []

    def interrupted(*event):
        calls.append(event)
        if len(calls) == at + 1:
            raise KeyboardInterrupt
        Both.usage(both, *event)

    both.press("LEFT_SHIFT")
    both.press("LEFT_CONTROL+A")
    both.usage = interrupted
    for name in ("LEFT_CONTROL+A", "LEFT_SHIFT"):
        for _ in range(2):  # who was interrupted repeats it
            try:
                both.release(name)
                break
            except KeyboardInterrupt:
                pass
    assert not both.computer.down
