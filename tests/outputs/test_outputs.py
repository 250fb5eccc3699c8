"""Virtual keyboards and gamepads: each pressed key is released, on every exit path."""

import os
import sys
import time

import pytest
from support.refusals import refusal

from spots import SpotsError
from spots.errors import RequirementError, SettingError
from spots.outputs import devices as outputs
from spots.outputs import uinput
from spots.outputs.desktop import DesktopKeyboard
from spots.outputs.devices import PrintedGamepad, PrintedKeyboard
from spots.outputs.open import open_gamepad, open_keyboard
from spots.outputs.uinput import UInputGamepad, UInputKeyboard
from spots.outputs.usages import CONSUMER, KEYBOARD, USAGES, usage_of

A, B, ENTER, F5, PLAY = map(usage_of, ("A", "B", "ENTER", "F5", "PLAY_PAUSE"))
SHIFT = 1 << 1
ENDS = [KeyboardInterrupt, RuntimeError, SpotsError, SystemExit]


@pytest.fixture
def lines(monkeypatch):
    found = []
    monkeypatch.setattr(outputs, "print", lambda line, flush: found.append(line), raising=False)
    return found


@pytest.fixture
def printed(lines):
    return PrintedKeyboard()


SHIFT_KEY = usage_of("LEFT_SHIFT")


def down(*key):
    return (*key, 0, True)


def up(*key):
    return (*key, 0, False)


def press(device):
    if isinstance(device, outputs.Keyboard):
        device.usage(*SHIFT_KEY)
        device.usage(*A)
    else:
        device.update(1, 2, 3, 4)


def ended(device, end):
    """Press a key or button of a device, then raise the exception `end` in its `with` block."""
    try:
        with device:
            press(device)
            raise end("it ends")
    except end:
        pass


# Behaviour of all keyboards, tested with `PrintedKeyboard`.


def test_a_line_tells_the_name_of_a_key_that_goes_down_or_up(printed, lines):
    printed.usage(*down(*PLAY))
    printed.usage(*up(*PLAY))
    assert lines == ["down  PLAY_PAUSE", "up    PLAY_PAUSE"]


def test_a_click_presses_modifiers_before_their_key_and_releases_them_after_it(
    printed, lines, monkeypatch
):
    held = []
    monkeypatch.setattr(outputs.time, "sleep", lambda time_s: held.append((time_s, len(lines))))
    printed.click(*A, SHIFT | 1)
    assert held == [(0.02, 3)]  # as long as a tapped key, while all are down
    names = [line.split() for line in lines]
    assert names[:3] == [["down", "LEFT_CONTROL"], ["down", "LEFT_SHIFT"], ["down", "A"]]
    assert names[3:] == [["up", "A"], ["up", "LEFT_SHIFT"], ["up", "LEFT_CONTROL"]]


def test_a_key_that_is_down_does_not_go_down_again_nor_one_that_is_up_up(printed, lines):
    printed.usage(*up(*A))
    printed.usage(*down(*A))
    printed.usage(*down(*A))
    assert lines == ["down  A"]


def test_release_lets_go_of_all_and_no_more_than_all(printed, lines):
    press(printed)
    printed.usage(*down(*ENTER))
    printed.release()
    printed.release()
    assert sorted(lines[3:]) == ["up    A", "up    ENTER", "up    LEFT_SHIFT"]


def test_a_key_that_no_keyboard_has_presses_nothing_not_even_its_modifiers(printed, lines):
    with refusal(SettingError):
        printed.click(KEYBOARD, 0xA5, SHIFT)
    printed.release()
    assert lines == []


def test_the_block_lets_go_whatever_ends_it(lines):
    for end in ENDS:
        ended(PrintedKeyboard(), end)
        assert lines == ["down  LEFT_SHIFT", "down  A", "up    A", "up    LEFT_SHIFT"]
        lines.clear()


# Linux.


def names(evdev, device):
    return [(evdev.NAMES.get(code, code), value) for _, code, value in device.history]


def test_a_uinput_keyboard_tells_the_kernel_what_its_usb_sister_would(evdev):
    with UInputKeyboard() as keyboard:
        device = evdev.UInput.made[-1]
        keyboard.click(*A, SHIFT)
        assert names(evdev, device) == [
            ("KEY_LEFTSHIFT", 1), ("KEY_A", 1), ("KEY_A", 0), ("KEY_LEFTSHIFT", 0)
        ]  # fmt: skip
        keyboard.usage(*down(*PLAY))
    assert names(evdev, device)[4:] == [("KEY_PLAYPAUSE", 1), ("KEY_PLAYPAUSE", 0)]
    assert device.closed
    keyboard.close()


def test_a_uinput_keyboard_is_able_to_send_every_key(evdev):
    with UInputKeyboard():
        able = evdev.UInput.made[-1].capabilities
    wanted = {evdev.ecodes.ecodes[one.linux] for one in USAGES.values()}
    assert set(able[evdev.ecodes.EV_KEY]) == wanted
    assert evdev.ecodes.EV_REP in able


def test_a_uinput_gamepad_has_the_ranges_of_a_boards_own_and_centres_at_the_end(evdev):
    ecodes = evdev.ecodes
    with UInputGamepad() as gamepad:
        device = evdev.UInput.made[-1]
        ranges = {code: (info.min, info.max) for code, info in device.capabilities[ecodes.EV_ABS]}
        assert ranges == {0: (-32767, 32767), 1: (-32767, 32767), 2: (0, 32767)}
        assert len(device.capabilities[ecodes.EV_KEY]) == 16
        gamepad.update(-32767, 5, 32767, 0b1000_0000_0000_0001)
        assert device.known[ecodes.EV_ABS, ecodes.ABS_X] == -32767
        assert device.known[ecodes.EV_ABS, ecodes.ABS_Y] == 5
        assert device.known[ecodes.EV_ABS, ecodes.ABS_Z] == 32767
        assert device.known[ecodes.EV_KEY, ecodes.BTN_GAMEPAD] == 1
        assert device.known[ecodes.EV_KEY, ecodes.BTN_GAMEPAD + 15] == 1
        assert len(device.held()) == 5
    assert device.held() == []
    assert device.closed


@pytest.mark.parametrize("kind", [UInputKeyboard, UInputGamepad])
@pytest.mark.parametrize("end", ENDS)
def test_a_uinput_device_lets_go_and_is_closed_whatever_ends_the_block(evdev, kind, end):
    ended(kind(), end)
    assert evdev.UInput.made[-1].history
    assert evdev.UInput.made[-1].held() == []
    assert evdev.UInput.made[-1].closed


@pytest.mark.parametrize("kind", [UInputKeyboard, UInputGamepad])
def test_a_uinput_device_that_is_gone_is_told_in_a_sentence_and_still_closed(evdev, kind):
    device = kind()
    press(device)
    evdev.UInput.made[-1].gone = True
    with refusal(RequirementError):
        device.close()
    device.close()
    assert evdev.UInput.made[-1].closed


@pytest.mark.parametrize("kind", [UInputKeyboard, UInputGamepad])
@pytest.mark.parametrize(
    ("refusal", "node", "is_writable", "remedy"),
    [
        ("UInputError", "/none", True, "sudo modprobe uinput"),
        (FileNotFoundError(2, "No such file"), os.devnull, True, "sudo modprobe uinput"),
        (OSError(19, "No such device"), os.devnull, True, "sudo modprobe uinput"),
        ("UInputError", os.devnull, False, "uaccess"),
        (PermissionError(13, "Permission denied"), os.devnull, True, "uaccess"),
        ("UInputError", os.devnull, True, "--dry-run"),
    ],
)
def test_the_reason_why_uinput_does_not_open_is_found_without_reading_its_text(
    evdev, monkeypatch, kind, refusal, node, is_writable, remedy
):
    error = evdev.UInputError("any text") if refusal == "UInputError" else refusal
    monkeypatch.setattr(evdev.UInput, "fails", error)
    monkeypatch.setattr(uinput, "_NODE", node)
    monkeypatch.setattr(os, "access", lambda path, mode: is_writable)
    with pytest.raises(RequirementError) as refused:
        kind()
    assert remedy in str(refused.value)


def test_without_evdev_a_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "evdev", None)
    with refusal(RequirementError):
        UInputKeyboard()


# Without /dev/uinput these tests do not exist, and the summary at the end of the run reports it.
if os.access("/dev/uinput", os.W_OK):

    def test_a_real_uinput_keyboard_is_read_back():
        with UInputKeyboard() as keyboard:
            device = keyboard._device.device
            assert device is not None, "its event device may not be read"
            keyboard.usage(*down(*A))
            keyboard.release()
            time.sleep(0.1)
            events = [(e.code, e.value) for e in device.read() if e.type == 1]
        assert events == [(30, 1), (30, 0)]


# macOS and Windows.


def test_a_desktop_keyboard_presses_characters_and_named_keys(pynput):
    with DesktopKeyboard() as keyboard:
        desktop = pynput.Controller.made[-1]
        keyboard.click(*A, SHIFT)
        keyboard.usage(*down(*PLAY))
    key = pynput.Key
    assert desktop.history[:2] == [(key.shift_l, True), ("a", True)]
    assert desktop.history[2:4] == [("a", False), (key.shift_l, False)]
    assert desktop.history[4:] == [(key.media_play_pause, True), (key.media_play_pause, False)]


def test_a_key_that_a_desktop_lacks_is_a_sentence_and_presses_nothing(pynput):
    with DesktopKeyboard() as keyboard:
        for name in ("AC_BACK", "NON_US_BACKSLASH", "F24"):
            with refusal(SettingError):
                keyboard.click(*usage_of(name), SHIFT)
    assert pynput.Controller.made[-1].history == []


def test_a_key_that_does_not_come_up_does_not_keep_the_others_down(pynput):
    keyboard = DesktopKeyboard()
    desktop = pynput.Controller.made[-1]
    for one in (A, B, ENTER):
        keyboard.usage(*down(*one))
    desktop.refuses = {("b", False)}
    with refusal(RequirementError):
        keyboard.release()
    assert desktop.down == ["b"]
    desktop.refuses = set()
    keyboard.close()
    assert desktop.down == []


def test_a_key_that_may_have_gone_down_is_let_go(pynput):
    keyboard = DesktopKeyboard()
    desktop = pynput.Controller.made[-1]
    real = desktop.press

    def interrupted(key):
        real(key)
        raise KeyboardInterrupt

    desktop.press = interrupted
    with pytest.raises(KeyboardInterrupt), keyboard:
        keyboard.usage(*down(*A))
    assert desktop.down == []


def test_without_pynput_a_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pynput", None)
    with refusal(RequirementError):
        DesktopKeyboard()


# Choice of the device.


def test_a_dry_run_prints_on_every_system(capsys):
    with open_keyboard(dry_run=True) as keyboard:
        keyboard.usage(*down(CONSUMER, 0xE9))
    with open_gamepad(dry_run=True) as gamepad:
        gamepad.update(-5, 0, 7, 0b101)
    told = capsys.readouterr().out.splitlines()
    assert told[:2] == ["down  VOLUME_INCREMENT", "up    VOLUME_INCREMENT"]
    assert told[2].split() == ["x", "-5", "y", "0", "z", "7", "buttons", "1", "3"]
    assert told[3].split() == ["x", "0", "y", "0", "z", "0", "buttons", "-"]
    assert len(told) == 4


def test_each_system_has_its_own(evdev, pynput, monkeypatch):
    monkeypatch.setattr(sys, "platform", "linux")
    assert isinstance(open_keyboard(False), UInputKeyboard)
    assert isinstance(open_gamepad(False), UInputGamepad)
    for other in ("darwin", "win32"):
        monkeypatch.setattr(sys, "platform", other)
        assert isinstance(open_keyboard(False), DesktopKeyboard)
        with refusal(RequirementError):
            open_gamepad(False)


def test_a_gamepad_sends_only_what_changes(lines):
    with PrintedGamepad() as gamepad:
        for _ in range(3):
            gamepad.update(0, 0, 0, 0)
        assert lines == []
        for _ in range(3):
            gamepad.update(1, 0, 0, 0)
    assert len(lines) == 2


def test_a_state_that_may_have_gone_out_is_taken_back(evdev):
    gamepad = UInputGamepad()
    device = evdev.UInput.made[-1]
    real = device.syn

    def interrupted():
        real()
        device.syn = real
        raise KeyboardInterrupt

    device.syn = interrupted
    with pytest.raises(KeyboardInterrupt), gamepad:
        gamepad.update(1, 2, 3, 4)
    assert device.history
    assert device.held() == []
