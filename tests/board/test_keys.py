"""Touches become USB reports and KEY frames in a real MicroPython, also with a faulty USB host."""

import pytest
from support.boards import store
from support.refusals import refusal

from spots.errors import BoardError, PortError
from spots.keyboard.keys import push
from spots.keyboard.layout import load
from spots.link.frames import Key, Touch
from spots_device.reading.decode import DROPPED

pytestmark = pytest.mark.board

# Middles of the ten zones from the sensor's end, and the HID usages of their keys 1 to 9 and 0.
ZONES_MM = [85 * (i + 0.5) / 10 for i in range(10)]
USAGES = [*range(30, 40)]
ONE, FIVE, ZERO = USAGES[0], USAGES[4], USAGES[9]
UP = bytes(8)
KEYBOARD = 0
BOARDS = ["virtual", "virtual_circuitpython"]
# Not for CircuitPython: Ctrl-C arrives on another port there, and no USB library is necessary.
micropython = pytest.mark.parametrize("board", BOARDS[:1])


def report(usage):
    return bytes((0, 0, usage, 0, 0, 0, 0, 0))


def typed(*usages):
    """Return the keyboard reports that a host receives if keys are typed, one after the other."""
    return [one for usage in usages for one in (report(usage), UP)]


@pytest.fixture(params=BOARDS)
def board(request):
    """Name of a virtual board: each test runs with both runtimes, or with those that it chooses."""
    return request.param


@pytest.fixture
def plugged(rig, calibration, tmp_path, board):
    """Return a function that starts a calibrated `Rig` with stored settings, such as ``keys=1``."""

    def make(*settings):
        store(tmp_path, calibration=calibration, settings=list(settings))
        return rig(folder=tmp_path, board=board)

    return make


def reports(rig, interface=KEYBOARD):
    return [data for number, data in rig.link.usb.reports if number == interface]


def touch(rig, zone, seconds=0.1):
    rig.press(ZONES_MM[zone], 1500)
    rig.settle(seconds)
    rig.release()
    rig.settle(seconds)


def keys_of(frames):
    return [(frame.usage, frame.pressed) for frame in frames if isinstance(frame, Key)]


def test_ten_touches_are_the_ten_keys_as_reports_and_as_frames(plugged):
    made = plugged("keys=1")
    assert "note" not in made.board.command("set keys=1")
    made.settle(0.3)
    frames = []
    for zone in (*range(10), 4, 4):
        made.press(ZONES_MM[zone], 1500)
        frames += made.board.frames(0.08)
        made.release()
        frames += made.board.frames(0.08)
    golden = [*USAGES, FIVE, FIVE]
    assert reports(made) == typed(*golden)
    assert keys_of(frames) == [(usage, down) for usage in golden for down in (True, False)]
    assert made.board.command("get")["dropped_reports"] == 0


@micropython
def test_a_finger_that_slides_holds_its_first_key(plugged):
    made = plugged("keys=1")
    made.settle(0.3)
    for tenths_mm in range(200, 600, 10):
        made.press(tenths_mm / 10, 1500)
        made.settle(0.01)
    made.release()
    made.settle(0.3)
    assert reports(made) == typed(USAGES[2])


def test_a_host_that_accepts_nothing_for_a_while_costs_no_report_and_no_sample(plugged):
    made = plugged("keys=1", "exposure_us=10000")
    made.board.command("stream touch")
    made.settle(0.5)
    before = made.board.command("get")["missed"]
    made.link.usb.asks = False
    touches = []
    for zone in (0, 4, 9):
        made.press(ZONES_MM[zone], 1500)
        touches += [frame for frame in made.board.frames(0.07) if isinstance(frame, Touch)]
        made.release()
        touches += [frame for frame in made.board.frames(0.07) if isinstance(frame, Touch)]
    assert reports(made) == []
    assert len(touches) >= 40
    assert not any(frame.flags & DROPPED for frame in touches)
    times_us = [frame.t_us for frame in touches]
    assert all(9_900 < b - a < 10_500 for a, b in zip(times_us, times_us[1:]))
    made.link.usb.asks = True
    made.settle(0.3)
    assert reports(made) == typed(ONE, FIVE, ZERO)
    state = made.board.command("get")
    assert (state["missed"], state["dropped_reports"]) == (before, 0)


@micropython
def test_a_host_that_sleeps_too_long_finds_no_key_down(plugged):
    made = plugged("keys=1")
    made.settle(0.3)
    made.press(ZONES_MM[0], 1500)
    made.settle(0.3)
    assert reports(made) == [report(ONE)]
    made.link.usb.asks = False
    made.release()
    made.settle(0.3)
    for _ in range(10):
        touch(made, 4, 0.05)
    made.release()
    made.settle(0.3)
    dropped = made.board.command("get")["dropped_reports"]
    assert dropped > 0
    made.link.usb.asks = True
    made.settle(0.5)
    got = reports(made)
    # Of the ten touches, those that are less than 0.5 s old when they are sent.
    assert got in (typed(ONE, FIVE), typed(ONE, FIVE, FIVE))
    assert dropped >= 15
    touch(made, 9)
    assert reports(made)[-2:] == typed(ZERO)


def end_with_keys_off(made):
    made.board.command("set keys=0")


def end_with_reboot(made):
    made.board.command("reboot")


def end_with_another_gain(made):
    assert "calibration" in made.board.command("set gain=1")["note"]


def end_with_no_calibration(made):
    made.board.command("cal clear")


def end_with_auto(made):
    made.board.command("autoexpose")


def end_with_the_sensor(made):
    made.link.chip.write(bytes((0x80, 0x01)))  # the chip stops sampling


@micropython
@pytest.mark.parametrize(
    "end",
    [
        end_with_keys_off,
        end_with_reboot,
        end_with_another_gain,
        end_with_no_calibration,
        end_with_auto,
        end_with_the_sensor,
    ],
)
def test_no_key_outlives_what_held_it(plugged, end):
    made = plugged("keys=1")
    made.settle(0.3)
    made.press(ZONES_MM[4], 1500)
    made.settle(0.3)
    assert reports(made) == [report(FIVE)]
    end(made)
    made.settle(0.3)
    assert reports(made) == typed(FIVE)


def changed(path, old, new):
    """Replace the text `old` in a file of a board, which reads the file at its next start."""
    source = path.read_text()
    assert old in source
    path.write_text(source.replace(old, new))


def held(made):
    made.settle(0.3)
    made.press(ZONES_MM[4], 1500)
    made.settle(0.3)
    assert reports(made) == [report(FIVE)]
    return made


@pytest.mark.usefixtures("own_firmware")
def test_no_key_outlives_a_crash(plugged, tmp_path):
    made = plugged("keys=1")
    changed(
        tmp_path / "spots_device" / "board" / "app.py",
        "def time_us(self):",
        "def time_us(self, missing):",
    )
    made.board.command("reboot")
    held(made)
    made.link.write(b"sync\n")
    made.settle(1.5)
    assert reports(made) == typed(FIVE)
    assert "crashed" in made.board.log[-1]["text"]


@micropython
def test_no_key_outlives_ctrl_c(plugged):
    made = held(plugged("keys=1"))
    made.link.write(b"\x03")
    with refusal(PortError):
        made.settle(0.3)
    assert reports(made) == typed(FIVE)


@micropython
def test_a_host_that_sleeps_does_not_hold_up_the_end(plugged):
    made = held(plugged("keys=1"))
    made.link.usb.asks = False
    made.release()
    made.settle()  # the endpoint is full now
    made.link.write(b"\x03")
    before_s = made.link.now_s()
    with refusal(PortError):
        made.settle(5.0)
    assert made.link.now_s() - before_s < 0.2


def test_a_gamepad_is_where_and_how_hard(plugged):
    made = plugged("gamepad=1")
    made.settle(0.3)
    made.press(ZONES_MM[9], 1500)
    made.settle(0.3)
    made.release()
    made.settle(0.3)
    got = reports(made)
    x, z = (
        int.from_bytes(got[-2][:2], "little", signed=True),
        int.from_bytes(got[-2][4:6], "little"),
    )
    assert x == pytest.approx(0.9 * 32_767, abs=400)
    assert 0 < z < 32_767
    assert [one[6:] for one in got] == [b"\1\0"] * (len(got) - 1) + [b"\0\0"]
    assert got[-1] == UP


def test_both_at_once_are_two_interfaces(plugged):
    made = plugged("keys=1", "gamepad=1")
    made.settle(0.3)
    touch(made, 4)
    assert reports(made) == typed(FIVE)
    assert reports(made, 1)[-1] == UP
    assert reports(made, 1)[0][6:] == b"\1\0"


def test_media_keys_are_reports_of_their_own(plugged):
    made = plugged("keys=1")
    push(made.board, load("media"))
    made.board.command("reboot")
    made.settle(0.5)
    touch(made, 0)
    assert reports(made) == [b"\xb6\0", b"\0\0"]  # media key: previous track


def test_without_a_start_as_a_keyboard_keys_are_frames_and_a_note_says_so(rig, calibration):
    made = rig(calibration=calibration)
    reply = made.board.command("set keys=1")
    assert reply["keys"] == 1
    note = "save and reboot to make the board a USB keyboard; keys are sent as frames only"
    assert (reply["note"], reply["why"]) == (note, "needs_reboot")
    made.settle(0.3)
    made.press(ZONES_MM[0], 1500)
    assert keys_of(made.board.frames(0.15)) == [(ONE, True)]
    assert keys_of(made.board.frames(0.05)) == []
    # `push` has saved the layout, so it only asks for the reboot.
    wanted = "reboot the board: until then, it is not the USB keyboard of this layout"
    assert push(made.board, load("digits")).note == wanted
    made.board.command("set keys=0")
    assert reports(made) == []


def test_without_a_calibration_a_note_says_so(rig):
    made = rig()
    reply = made.board.command("set keys=1")
    assert "need a calibration" in reply["note"]
    assert "why" not in reply  # a reboot does not suffice
    assert "note" not in made.board.command("set keys=0")


@pytest.mark.parametrize("line", ["keys on", "gamepad off", "keys", "watchdog 1"])
def test_a_setting_as_a_command_changes_nothing_and_names_the_command_set(rig, line):
    made = rig()
    before, name = made.board.command("get"), line.split()[0]
    with refusal(BoardError, why="no_command") as caught:
        made.board.command(line)
    assert f"'set {name}=VALUE'" in str(caught.value)
    after = made.board.command("get")
    assert [after[key] for key in ("keys", "gamepad")] == [before["keys"], before["gamepad"]]


@pytest.mark.usefixtures("own_firmware")
def test_a_board_without_usb_reports_says_so_and_sends_frames(plugged, tmp_path):
    made = plugged("keys=1")
    changed(tmp_path / "board_config.py", "USB_HID = True", "USB_HID = False")
    made.board.command("reboot")
    made.settle(0.3)
    made.press(ZONES_MM[0], 1500)
    assert keys_of(made.board.frames(0.15)) == [(ONE, True)]
    note = made.board.command("set keys=1")["note"]
    assert note == "this board has no USB keyboard; keys are sent as frames only"
    assert "no USB keyboard and gamepad" in made.board.command("set gamepad=1")["note"]
    assert reports(made) == []


@micropython
@pytest.mark.usefixtures("own_firmware")
def test_a_board_with_too_few_endpoints_says_so_and_stays_on_its_port(plugged, tmp_path):
    made = plugged("keys=1", "gamepad=1")
    changed(tmp_path / "board_config.py", "USB_HID = True", "USB_HID = True\nUSB_HID_MAX = 1")
    made.board.command("reboot")
    made.settle(0.3)
    (line,) = [line for line in made.board.log if line["log"] == "error"]
    assert "no room for keyboard and gamepad" in line["text"]
    assert line["text"] in made.board.command("set gamepad=0")["note"]
    made.board.command("save")
    made.board.command("reboot")
    made.settle(0.5)
    touch(made, 4)
    assert reports(made) == typed(FIVE)
