"""A board that is unplugged and reconnects with another port name, a hundred times."""

import gc
import itertools
import os
import pty
import threading
import time
from contextlib import suppress

import pytest
from serial.tools.list_ports_common import ListPortInfo
from support.plugs import Hub
from support.refusals import refusal

import spots
from spots.cli import main
from spots.errors import PortError, PortLostError, RefusedError
from spots.keyboard.keyboard import type_on
from spots.keyboard.layout import load
from spots.link import connect, serial_link
from spots.link import timeouts as absence
from spots.link.finder import finder
from spots.link.serial_link import SerialLink
from spots.link.timeouts import CONNECTED, LOST, REFUSED
from spots.recording.recorder import Recorder
from spots.terminal.monitor import watch
from spots_sim.board.faults import Faults, FaultyLink
from spots_sim.demo.virtual import start_simulator
from spots_sim.strip import files
from spots_web.board_feed import BoardReader
from spots_web.state import PageState

CYCLES = 100
DEADLINE_S = 120.0


@pytest.fixture
def hub(monkeypatch):
    with Hub(3) as hub:
        monkeypatch.setattr("spots.link.serial_link.list_ports.comports", hub.ports)
        # Shorter times between attempts to reconnect.
        monkeypatch.setattr(absence, "_REOPEN_S", 0.01)
        monkeypatch.setattr(absence, "_REOPEN_MOST_S", 0.05)
        yield hub


class Stopping:
    """A link whose `read` raises KeyboardInterrupt (Ctrl-C) when the event `stopped` is set."""

    def __init__(self, link):
        self._link = link
        self.stopped = False

    def __getattr__(self, name):
        return getattr(self._link, name)

    def read(self, timeout_s):
        if self.stopped:
            raise KeyboardInterrupt
        return self._link.read(timeout_s)


class Pressed:
    def __init__(self):
        self.presses = 0
        self.down = set()

    def key(self, page, usage, modifiers, pressed):
        self.presses += pressed
        (self.down.add if pressed else self.down.discard)(usage)


def until(condition):
    end_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.001)


def in_thread(run, *arguments):
    def until_interrupted():
        with suppress(KeyboardInterrupt):
            run(*arguments)

    thread = threading.Thread(target=until_interrupted, daemon=True)
    thread.start()
    return thread


def held():
    gc.collect()
    return threading.active_count(), len(os.listdir("/dev/fd"))


@pytest.mark.board
def test_monitor_keyboard_and_page_recover_a_hundred_times_and_leave_nothing_behind(hub, capsys):
    names = [plug.name for plug in hub.plugs]
    links = [Stopping(SerialLink(name)) for name in names[:2]]
    watched, typed = (spots.Board(link) for link in links)
    keys, state = Pressed(), PageState()
    reader = BoardReader(finder(names[2]), load("digits"), state, 0.01)
    threads = [
        in_thread(watch, watched, None, False),
        in_thread(type_on, typed, load("digits"), keys),
    ]
    reader.start()

    def recovered_since(frames, presses, cycle):
        # A reconnection also gives replies; only a new reading shows that the board has restarted.
        return lambda: (
            min(watched.stats.restarts, typed.stats.restarts) >= cycle
            and watched.stats.frames > frames + 10
            and keys.presses > presses
        )

    def shown():
        return state.since(state.begin())[1]

    def on_the_page():
        return shown()["board"]["state"] == CONNECTED and bool(shown().get("touch"))

    try:
        until(lambda: watched.stats.frames > 100 and keys.presses and on_the_page())
        before = held()
        for cycle in range(1, CYCLES + 1):
            hub.unplug()
            until(lambda: watched.state == typed.state == LOST)
            until(lambda: shown()["board"]["state"] == LOST)
            before_it = watched.stats.frames, keys.presses
            hub.replug()
            until(lambda: watched.state == typed.state == CONNECTED and on_the_page())
            until(recovered_since(*before_it, cycle))
        hub.free_names()
        until(lambda: held() == before)
        assert watched.stats.restarts == typed.stats.restarts == CYCLES
        assert all(len(plug.names) == CYCLES + 1 for plug in hub.plugs)
        said = capsys.readouterr().out
        assert said.count("link lost") == CYCLES <= said.count("link connected")
    finally:  # a thread that searched on would open the boards of other tests
        reader.stop()
        for link in links:
            link.stopped = True
        for thread in threads:
            thread.join(DEADLINE_S)
    assert keys.down == set()
    watched.close()
    typed.close()


@pytest.mark.board
def test_the_firmware_itself_comes_back_under_another_name(monkeypatch, tmp_path):
    there, kept = set(), []
    monkeypatch.setattr("spots.link.serial_link.list_ports.comports", lambda: listed(there))
    start, end = start_simulator("default", "demo", 0)
    there.add(start["port"])
    names = [start["port"]]
    nothing_wrong = Faults(files.FaultsFile(), seconds=1.0)
    with spots.Board(FaultyLink(SerialLink(start["port"]), nothing_wrong)) as board:
        board.patience_s = DEADLINE_S
        Recorder(board, tmp_path / "run.spots")
        board.touches()
        for _ in range(2):
            end()
            there.clear()
            until(lambda: next(board.frames(0.05), None) is None and board.state == LOST)
            kept.append(pty.openpty())  # occupies the name, so that the next board has another name
            start, end = start_simulator("default", "demo", 0)
            while start["port"] in names:  # a name that another program has closed was free again
                end()
                kept.append(pty.openpty())
                start, end = start_simulator("default", "demo", 0)
            there.add(start["port"])
            names.append(start["port"])
            until(lambda: next(board.frames(0.05), None) and board.state == CONNECTED)
            assert board.port == names[-1]
        assert board.stats.restarts == 2
    end()
    assert len(set(names)) == 3
    for fd in itertools.chain(*kept):
        os.close(fd)


def listed(names):
    """List ports of USB devices with one serial number, as pyserial does."""
    found = [ListPortInfo(name) for name in names]
    for port in found:
        port.vid, port.serial_number = 1, "number"
    return found


@pytest.mark.parametrize("number", [None, "", "123456"])
def test_another_board_on_the_old_name_is_refused_and_told_of_once(hub, number):
    mine = hub.plugs[0]
    for plug in hub.plugs:
        plug.usb_number = plug.board_id
    mine.usb_number = number
    with spots.Board(SerialLink(mine.name)) as board:
        board.touches()
        until(lambda: next(board.frames()))
        mine.board_id = "another"
        name = mine.name
        hub.unplug()
        hub.replug()
        assert mine.name != name

        def state_is(state):
            list(board.frames(0.02))
            return board.state == state

        until(lambda: state_is(REFUSED))
        list(board.frames(0.3))
        assert len([line for line in board.log if "another instead of board0" in line["text"]]) == 1
        assert list(board.frames(0.1)) == []
        mine.board_id = "board0"
        until(lambda: state_is(CONNECTED))
        assert next(touch for touch in board.touches() if touch.touching).position_um == 42_000


def test_a_device_of_another_number_under_the_old_name_is_not_even_opened(hub):
    first, second, _ = hub.plugs
    link = SerialLink(first.name)
    first.usb_number, second.usb_number = "board9", "board8"
    with refusal(RefusedError):
        link.reopen()
    second.usb_number = "board0"
    link.reopen()
    assert link.name == second.name
    link.close()


@pytest.fixture
def twins(hub):
    """Two boards with the same USB serial number in two sockets; the second also has two ports."""
    for i, plug in enumerate(hub.plugs):
        plug.usb_number, plug.socket = "123456", ("1-1:1.0", "1-2:1.0", "1-2:1.2")[i]
    return hub


@pytest.mark.parametrize("number", ["123456", "", None])
def test_boards_with_one_serial_number_are_two_boards(twins, number):
    for plug in twins.plugs:
        plug.usb_number = number
    first, console, data = (plug.name for plug in twins.plugs)
    assert sorted(serial_link.usb_boards()) == sorted([[first], sorted([console, data])])
    with refusal(PortError):
        spots.open()


@pytest.mark.parametrize("number", ["123456", "", None])
def test_of_boards_with_one_serial_number_each_link_finds_its_own_again(twins, number):
    for plug in twins.plugs:
        plug.usb_number = number
    first, _, data = twins.plugs
    links = [SerialLink(plug.name) for plug in (first, data)]
    for _ in range(3):
        twins.unplug()
        twins.replug()
        for link in links:
            link.reopen()
        assert links[0].name == first.name
        assert links[1].name in (twins.plugs[1].name, data.name)
    first.usb_number = "another"  # not plugged in: its twin is, in its own socket
    with refusal(RefusedError):
        links[0].reopen()
    for link in links:
        link.close()


@pytest.mark.parametrize("when", ["before it is opened", "after it was opened"])
def test_a_board_is_not_taken_for_its_twin_that_was_plugged_in(twins, when):
    first, *others = twins.plugs
    if when == "after it was opened":
        for plug in others:
            plug.usb_number = "not yet there"
    link = SerialLink(first.name)
    for plug in others:
        plug.usb_number = "123456"
    first.unplug()
    try:
        with pytest.raises(PortLostError):
            link.read(DEADLINE_S)
        for _ in range(2):
            with refusal(RefusedError):
                link.reopen()
    finally:
        first.plug()
    link.reopen()
    assert link.name == first.name
    link.close()


def test_a_board_with_its_own_serial_number_is_found_in_another_socket(hub):
    first = hub.plugs[0]
    first.socket = "1-1:1.0"
    link = SerialLink(first.name)
    for socket in ("1-7:1.0", "1-7.2:1.0"):
        hub.unplug()
        with pytest.raises(PortLostError):
            link.read(DEADLINE_S)
        first.socket = socket
        hub.replug()
        link.reopen()
        assert link.name == first.name
    link.close()


def test_the_page_refuses_to_choose_between_boards_with_one_id(twins):
    for plug in twins.plugs:
        plug.board_id = "clone"
    with refusal(PortError):
        finder(None)("clone")


def test_on_windows_reading_does_not_set_up_the_port_anew(monkeypatch):
    behind, front = pty.openpty()
    port = SerialLink(os.ttyname(front))
    monkeypatch.setattr("spots.link.serial_link.sys.platform", "win32")
    monkeypatch.setattr(port._serial, "_reconfigure_port", lambda **_: pytest.fail("set up anew"))
    begun_s = port.now_s()
    assert port.read(0.05) == b""
    assert port.now_s() - begun_s >= 0.05
    os.write(behind, b"some")
    heard = b""
    while heard != b"some":  # a read may return only the first bytes
        piece = port.read(10.0)
        assert piece
        heard += piece
    port.close()
    os.close(behind)
    os.close(front)


def test_a_board_that_stays_unplugged_is_reported_as_unplugged(hub):
    with spots.Board(SerialLink(hub.plugs[0].name)) as board:
        board.patience_s = 0.1
        board.touches()
        hub.unplug()
        with refusal(PortLostError):
            list(board.touches())


def test_a_moved_board_is_still_found_after_several_failed_writes(hub):
    first = hub.plugs[0]
    first.socket = "1-1:1.0"
    link = SerialLink(first.name)
    hub.unplug()
    with pytest.raises(PortLostError):
        link.read(DEADLINE_S)
    link.close_port()
    first.socket = "1-7:1.0"
    hub.replug()
    with pytest.raises(PortLostError):
        link.write(b"hello\n")
    link.reopen()
    assert link.name == first.name
    link.close()


@pytest.mark.board
def test_record_waits_for_a_board_at_the_start_and_while_it_is_unplugged(
    hub, monkeypatch, capsys, tmp_path
):
    hub.unplug()
    del hub.plugs[1:]
    path, links = tmp_path / "run.spots", []
    monkeypatch.setattr(connect, "_LOOK_EVERY_S", 0.01)
    monkeypatch.setattr(absence, "PATIENCE_S", 0.0)

    def stopping(port):
        links.append(Stopping(SerialLink(port)))
        return links[-1]

    monkeypatch.setattr(connect, "SerialLink", stopping)
    said, codes = [], []

    def has_said(text):
        said.append(capsys.readouterr().err)
        return text in "".join(said)

    thread = in_thread(lambda: codes.append(main(["record", str(path), "--wait"])))
    try:
        until(lambda: has_said("waiting for a board: no board found"))
        for cycle in range(2):
            hub.replug()
            size = path.stat().st_size if path.exists() else 0
            until(lambda size=size: path.exists() and path.stat().st_size > size + 10_000)
            if cycle == 0:
                hub.unplug()
                until(lambda: not links[-1]._link._connected)
                time.sleep(0.05)
    finally:
        for link in links:
            link.stopped = True
        thread.join(DEADLINE_S)
    assert codes == [0]
    assert len(said) - said.count("") <= 3  # each reason once
    with spots.open_recording(path, speed=float("inf")) as recording:
        assert list(recording.touches())
    assert has_said("lost 0")


@pytest.mark.parametrize(
    ("port", "says"),
    [
        ("virtual:x", "--wait has no effect here: give a serial port or ble:NAME"),
        ("recording:no such file", "this command cannot use 'recording:no such file'"),
    ],
)
def test_a_port_that_no_waiting_helps_is_refused_at_once(capsys, tmp_path, port, says):
    with pytest.raises(SystemExit) as end:
        main(["record", str(tmp_path / "a.spots"), "--wait", "--port", port])
    assert end.value.code == 2
    assert says in capsys.readouterr().err


def test_a_recording_that_exists_is_refused_before_the_wait(hub, capsys, tmp_path):
    hub.unplug()
    (tmp_path / "a.spots").write_bytes(b"")
    assert main(["record", str(tmp_path / "a.spots"), "--wait"]) == 2
    assert "a.spots exists" in capsys.readouterr().err
