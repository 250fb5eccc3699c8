"""Ctrl-C at any moment, even two times: no key stays pressed, and Ctrl-C works afterwards."""

import sys

import pytest
from bench import canned

from spots_device.board import app as app_module
from spots_device.board.interfaces import KeyEvents

A = 4
KEYBOARD_PAGE = 7
DOWN, UP = bytes((0, 0, A, 0, 0, 0, 0, 0)), bytes(8)
REFUSALS = 3


class Usb:
    """Substitute for a USB keyboard: refuses a number of release reports, stores other reports."""

    def __init__(self):
        self.got = []
        self.refusals = 0

    def open(self, names):
        return dict.fromkeys(names, self.send)

    def send(self, report):
        if bytes(report) == UP and self.refusals:
            self.refusals -= 1
            return False
        self.got.append(bytes(report))
        return True


class Interrupts:
    """Raises KeyboardInterrupt at events of the firmware's code with given numbers.

    Events are counted after the call of `arm`. An event is an executed line; in functions that
    protect other functions from interrupts, it is an executed bytecode.
    """

    GUARDS = ("run", "__exit__", "_leave", "_allow")

    def __init__(self, *at):
        self._at = at
        self._count = -1
        self.character = 3

    def interrupt_at(self, character):
        self.character = character

    def arm(self):
        self._count = 0

    def __call__(self, frame, event, arg):
        if "spots_device" not in frame.f_code.co_filename:
            return None
        guards = frame.f_code.co_name in self.GUARDS
        frame.f_trace_opcodes = guards
        if event == ("opcode" if guards else "line") and self._count >= 0:
            self._count += 1
            if self._count - 1 in self._at:
                raise KeyboardInterrupt
        return self

    @property
    def all_came(self):
        return self._count > max(self._at)


@pytest.fixture(autouse=True)
def _no_collection(monkeypatch):
    """Skip the garbage collection at a start, which would take most of the time of these tests."""
    monkeypatch.setattr(app_module.gc, "collect", lambda: None)


def leave(tmp_path, monkeypatch, *at, error=KeyboardInterrupt):
    """End the loop of a board by an error while a key is pressed, and interrupt its exit.

    `at` are the numbers of events at which the exit is interrupted. Returns the `Usb` and the
    `Interrupts`.
    """
    monkeypatch.chdir(tmp_path)
    app_module.Store().save([("settings", ["keys=1"])])
    usb, interrupts = Usb(), Interrupts(*at)
    app, _, _, _ = canned.app((), usb=usb)
    events = KeyEvents(0, app.framer, app.interfaces, None)
    app.interrupt_at = interrupts.interrupt_at
    events.usage(KEYBOARD_PAGE, A, 0, True)
    events.key(KEYBOARD_PAGE, A, 0, True)
    app.interfaces.pump()
    assert usb.got == [DOWN]
    usb.refusals = REFUSALS

    def interrupted():
        interrupts.arm()
        raise error

    app._pass = interrupted
    sys.settrace(interrupts)
    try:
        app.run()
    except (KeyboardInterrupt, ValueError):
        pass
    finally:
        sys.settrace(None)
    return app, usb, interrupts


@pytest.mark.board
@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_an_interrupt_at_any_point_of_the_end_leaves_no_key_down(tmp_path, monkeypatch, error):
    came = 0
    while True:
        app, usb, interrupts = leave(tmp_path, monkeypatch, came, error=error)
        assert usb.got[-1] == UP, came
        assert not app.strips[0].sensor.led_on, came
        assert interrupts.character == 3, came
        if not interrupts.all_came:
            break
        came += 1
    assert came > 100


@pytest.mark.parametrize("apart", [1, 2, 5, 20, 60, 150])
def test_one_more_that_was_on_its_way_neither(tmp_path, monkeypatch, apart):
    for first in range(0, 200, 7):
        _, usb, interrupts = leave(tmp_path, monkeypatch, first, first + apart)
        assert usb.got[-1] == UP, first
        assert interrupts.character == 3, first


def test_a_host_that_takes_nothing_is_waited_for_once(tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules[__name__], "REFUSALS", 1 << 30)
    app, usb, interrupts = leave(tmp_path, monkeypatch, 150)
    assert usb.got == [DOWN]
    assert interrupts.character == 3
    began = app.clock.now
    app._leave()
    assert app.clock.now == began
