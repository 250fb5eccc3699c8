"""Text from devices, files and other machines cannot control the terminal.

Foreign text comes from outside of this program: replies of a board, names of USB devices, names and
contents of files, names on a network, environment variables. `SHOWN` lists each source with each
command that shows it. Each case runs with a terminal and with a pipe as output.
"""

import contextlib
import io
import json
import os
import pty
import re
import threading
import tty
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest
from rich.console import Console
from support.fault_streams import encoded
from support.net import Announced, Net, session, topic_key
from support.plugs import Hub, Plug

from spots.calibrate.fit.points import Point
from spots.calibrate.session.guide import Guide
from spots.cli import main
from spots.controller import controller_setup, stick
from spots.deploy import place
from spots.keyboard import layout
from spots.link import serial_link as link
from spots.link.decoder import note
from spots.link.frames import LinkStats
from spots.outputs.devices import REST
from spots.terminal.view import StripView
from spots_linkage import twin_view
from spots_net.ros2.messages import Strip, messages
from spots_net.ros2.types import packed

# Markup of rich, a title (OSC), a status request that a terminal answers (DSR), a C1 character,
# line ends, bidirectional controls, DEL. Short, because the length of a board's reply is limited.
MARK = "[red]r"
EVIL = MARK + "[/red]\x1b]0;x\x07\x1b[6n\x9b2J\r\n\u202e\u2066\x7f"
NAME = EVIL.replace("/", "")  # as a file or a key of Zenoh may be called
DANGER = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")
# Control sequences that rich and the progress of a recording write to a terminal. `EVIL` contains
# none of them except \r.
OURS = re.compile(r"\x1b\[(?:[0-9;]*m|[0-9]*[AK]|\?25[lh])|\r")


class Screen:
    """Captures the output of commands in this process, with a terminal or a pipe as output."""

    def __init__(self, monkeypatch, terminal):
        self._terminal = terminal
        self._reader, writer = pty.openpty() if terminal else os.pipe()
        if terminal:
            tty.setraw(writer)  # the terminal then adds no \r
        self._file = open(writer, "w", encoding="utf-8", buffering=1)
        self._data = b""
        self._thread = threading.Thread(target=self._drain, daemon=True)
        self._thread.start()
        monkeypatch.setenv("TERM", "xterm-256color")
        monkeypatch.setenv("COLUMNS", "300")

    def _drain(self):
        try:
            while data := os.read(self._reader, 1 << 16):
                self._data += data
        except OSError:
            pass  # the terminal was closed

    @contextlib.contextmanager
    def on(self):
        """Capture all output in a ``with`` block."""
        with contextlib.redirect_stdout(self._file), contextlib.redirect_stderr(self._file):
            yield

    def run(self, *arguments):
        """Run a command of `spots`; return its exit code."""
        with self.on():
            try:
                return main([str(one) for one in arguments])
            except SystemExit as end:  # of argparse
                return end.code

    def text(self):
        """Close the output; return its text without the control sequences of `OURS`."""
        self._file.close()
        self._thread.join(30)
        os.close(self._reader)
        text = self._data.decode()
        return OURS.sub("", text) if self._terminal else text


@pytest.fixture(params=[True, False], ids=["terminal", "pipe"])
def screen(request, monkeypatch):
    return Screen(monkeypatch, request.param)


def assert_shown(text, shown=True):
    """Check that `text` has no characters that control a terminal, and shows the foreign text.

    If `shown` is false, it must not show the foreign text.
    """
    assert not (found := DANGER.search(text)), text[max(0, found.start() - 200) :][:300]
    assert (MARK in text) == shown, text


class Evil(Plug):
    """A board whose replies contain foreign text.

    If `error` is true, all replies except that to ``hello`` are errors. If `fault` is true, the
    reply to ``get`` has a fault.
    """

    error = False
    fault = None

    def _answer(self, name, *words):
        if self.error and name != "hello":
            self._send(3, {"re": name, "error": EVIL})
        else:
            self._send(3, {"log": EVIL})
            super()._answer(name, *words)

    def _send(self, kind, body):
        if kind == 3:
            body = body if isinstance(body, dict) else json.loads(body)
            if body.get("re") == "hello":
                body |= dict.fromkeys(("board", "runtime", "firmware", "id", "layout"), EVIL)
                body["channels"][0] = EVIL
            elif body.get("re") == "get":
                body |= {"fault": self.fault and EVIL, "exposure_us": 1000}
            elif body.get("re") == "dark":
                body["dark"] = [0] * 6
            elif "re" in body and body["re"] not in ("sync", "stream"):
                body |= {"note": EVIL, EVIL: EVIL}
            body = json.dumps(body, ensure_ascii=False).encode()
        super()._send(kind, body)


@pytest.fixture
def evil_board():
    """A running `Evil` board; its attribute `name` is its port."""
    with Hub(0) as hub:
        board = Evil("evil")
        board.plug()
        hub.plugs.append(board)
        yield board


@pytest.fixture
def evil_usb(monkeypatch):
    """The only USB device of the system; its descriptors contain foreign text."""
    usb = SimpleNamespace(
        device="/dev/tty" + NAME, description=EVIL, product=EVIL, manufacturer=EVIL,
        serial_number=EVIL, vid=1, pid=2, location="1-1", interface=EVIL, hwid=EVIL, name=EVIL,
    )  # fmt: skip
    monkeypatch.setattr(link.list_ports, "comports", lambda *_: [usb])
    return usb


BOARD = {
    "ports": (["ports"], True),
    "ports as JSON": (["ports", "--json"], True),
    "monitor": (["monitor", "--port", "{}", "--seconds", "0.2"], None),
    "hello": (["command", "--port", "{}", "hello"], True),
    "get": (["command", "--port", "{}", "get"], False),
    "an unknown reply": (["command", "--port", "{}", "unheard"], True),
    "record": (["record", "{new}", "--port", "{}", "--seconds", "0.2"], True),
    "keys push": (["keys", "push", "mini", "--port", "{}"], True),
    "keyboard": (["keyboard", "--dry-run", "--port", "{}", "--seconds", "0.2"], None),
    "wearable": (["wearable", "--port", "{}", "--seconds", "0.2"], None),
    "controller": (["controller", "--dry-run", "--port", "{}", "--seconds", "0.2"], None),
    "calibrate": (["calibrate", "position", "--port", "{}", "--session", "{session}"], True),
    "publish": (["publish", "--port", "{}", "--seconds", "0.2"], None),
    "doctor": (["doctor", "--port", "{}"], True),
}


@pytest.mark.board
@pytest.mark.parametrize("wrong", ["", "error", "fault"])
@pytest.mark.parametrize("case", BOARD)
def test_what_a_board_replies(screen, evil_board, tmp_path, monkeypatch, case, wrong):
    arguments, shown = BOARD[case]
    evil_board.error, evil_board.fault = wrong == "error", wrong == "fault" or None
    monkeypatch.setattr(link.list_ports, "comports", lambda *_: [listed(evil_board)])
    monkeypatch.setenv("ZENOH_CONFIG", str(Net(tmp_path).hub))
    (tmp_path / "session.jsonl").write_bytes(a_session())
    places = {"{}": evil_board.name, "{new}": tmp_path / NAME}
    places["{session}"] = tmp_path / "session.jsonl"
    screen.run(*(places.get(one, one) for one in arguments))
    assert_shown(text := screen.text(), MARK in text if shown is None or wrong else shown)
    if arguments[0] == "command" and not wrong:
        assert isinstance(json.loads(text), dict)  # the escaped text is still valid JSON


def listed(board):
    return SimpleNamespace(device=board.name, description=EVIL, serial_number=EVIL, vid=1, pid=2)


def a_session():
    """Return the bytes of a session file of a board whose id and diode names are foreign text."""
    of = {"board": NAME, "plan": (NAME, "F4", "F5", "F6", "F7", "F8"), "gain": 9}
    of |= {"exposure_us": 5000, "led_mA": 4, "time": NAME, "saturated": False}
    numbers = (1.0,) * 6
    point = Point(
        kind="position", place_um=0.0, force_mN=6000.0, counts=numbers, variance=numbers, **of
    )
    return msgspec.json.encode(point) + b"\n"


@pytest.mark.board
@pytest.mark.parametrize("arguments", [["doctor"], ["command", "hello"], ["flash", "pico"],
    ["monitor"], ["ports"], ["ports", "--json"], ["erase", "pico", "--yes"]])  # fmt: skip
def test_what_a_usb_device_is_called(screen, evil_usb, arguments):
    screen.run(*arguments)
    assert_shown(screen.text())


CONTENTS = {
    "no text": b"\xff\n",
    "odd keys": f'{EVIL!r} = 1\n"{EVIL!a}" = 2\n'.encode(),
    "odd key": f'"{NAME.encode("unicode_escape").decode()}" = 1\n'.replace("\\x", "\\u00").encode(),
    "odd text": f'name = "{MARK}\\u001b]0;x\\u007f"\n'.encode(),
    "raw text": f'name = "{NAME}"\n'.encode(),
    "JSON": json.dumps({EVIL: EVIL, "kind": EVIL}, ensure_ascii=False).encode() + b"\n",
}
FILES = [
    ["info", "{}"],
    ["info", "{}", "--json"],
    ["replay", "{}"],
    ["export", "{}", "--to", "csv"],
    ["keys", "check", "{}.toml"],
    ["keys", "show", "{}.toml"],
    ["serve", "--layout", "{}.toml"],
    ["serve", "--linkage", "{}.toml"],
    ["serve", "--edit", "{}.toml"],
    ["serve", "--edit-controller", "{}.toml"],
    ["serve", "--edit-gestures", "{}.toml"],
    ["serve", "--record-to", "{}.toml"],
    ["wearable", "--dry-run", "--gestures", "{}.toml"],
    ["controller", "--dry-run", "--settings", "{}.toml"],
    ["twin", "--linkage", "{}.toml", "--port", "x"],
    ["twin", "--path", "{}.toml"],
    ["twin", "--linkage", "{}.toml", "--calibrate", "{}"],
    ["calibrate", "position", "--port", "/dev/null", "--session", "{}.toml"],
    ["monitor", "--port", "{}"],
    ["monitor", "--port", "recording:{}"],
    ["monitor", "--port", "zenoh:{}"],
    ["monitor", "--port", "zenoh:", "--zenoh-config", "{}.toml"],
    ["subscribe", "--zenoh-config", "{}.toml"],
    ["record", "{}", "--port", "{}"],
    ["record", "{}.new", "--port", "virtual", "--calibration", "{}.toml"],
    ["demo", "--sensor", "{}.toml"],
    ["demo", "--scenario", "{}.toml"],
    ["info", "a", "{}"],  # file names as a shell expands *
    ["export", "a", "--to", "{}"],
]
# Commands that show the name of a file without reading it.
UNREAD = [["{}"], ["flash", "{}"], ["flash", "pico", "--port", "{}"], ["doctor", "--port", "{}"]]


@pytest.mark.board
@pytest.mark.parametrize("arguments", FILES, ids=" ".join)
@pytest.mark.parametrize("content", CONTENTS.values(), ids=CONTENTS)
def test_names_and_contents_of_files(screen, tmp_path, monkeypatch, arguments, content):
    monkeypatch.delenv("ZENOH_CONFIG", raising=False)
    for end in ("", ".toml"):
        (tmp_path / (NAME + end)).write_bytes(content)
    assert screen.run(*(one.replace("{}", str(tmp_path / NAME)) for one in arguments)) == 2
    assert_shown(screen.text())


@pytest.mark.board
@pytest.mark.parametrize("arguments", UNREAD, ids=" ".join)
def test_names_of_files_that_are_not_read(screen, tmp_path, monkeypatch, arguments):
    test_names_and_contents_of_files(screen, tmp_path, monkeypatch, arguments, b"")


def test_a_layout_of_an_odd_name(screen, tmp_path):
    path = tmp_path / (NAME + ".toml")
    text = (Path(layout.__file__).parent / "layouts" / "mini.toml").read_text()
    assert "Mini keyboard" in text
    path.write_text(text.replace("Mini keyboard", MARK + "[/red]"))
    for what in ("check", "show"):
        assert screen.run("keys", what, path) == 0
    assert_shown(screen.text())


def test_a_recording_of_such_a_board_under_an_odd_name(screen, evil_board, tmp_path):
    path, out = tmp_path / (NAME + ".spots"), tmp_path / (NAME + "2")
    assert screen.run("record", path, "--port", evil_board.name, "--seconds", "0.5") == 0
    # Another program may have written such notes.
    with path.open("ab") as file:
        file.write(note(10**7, {EVIL: EVIL}))
        text = json.dumps({"log": EVIL, EVIL: EVIL}, ensure_ascii=False).encode()
        file.write(encoded(b"\x03" + bytes(6) + text))
    for arguments in (
        ["info", path],
        ["info", path, "--json"],
        ["replay", path, "--speed", "inf"],
        ["export", path, "--to", "csv", "--out", out],
        ["export", path, "--to", "npz", "--out", out],
        ["export", path, "--to", "mcap", "--out", f"{out}.mcap"],
    ):
        assert screen.run(*arguments) == 0
    text = screen.text()
    assert_shown(text)
    (found,) = (json.loads(line) for line in text.splitlines() if line.startswith("{"))
    assert NAME in found["files"][0]


@pytest.mark.board
@pytest.mark.parametrize("about", ["{}", "CircuitPython 9.2.1 on\nBoard ID:{}\nUID:{}\n"])
@pytest.mark.parametrize("arguments", [[], ["--dry-run"]])
def test_the_label_of_a_drive_and_what_is_written_on_it(screen, tmp_path, about, arguments):
    (tmp_path / NAME).mkdir()
    (tmp_path / NAME / "boot_out.txt").write_text(about.replace("{}", MARK + "\x1b]0;\x9b\x7f"))
    assert screen.run("flash", "qtpy_rp2040", "--port", tmp_path / NAME, *arguments) == 2
    assert_shown(screen.text())


@pytest.mark.board
def test_a_drive_of_an_odd_name_is_flashed_and_erased(screen, tmp_path, monkeypatch):
    monkeypatch.setattr(place, "_RETURN_S", 0.1)  # the board does not reconnect
    (tmp_path / NAME).mkdir()
    about = "CircuitPython 9.2.1 on\nBoard ID:adafruit_qtpy_rp2040\nUID:1\n"
    (tmp_path / NAME / "boot_out.txt").write_text(about)
    for command in (["flash", "qtpy_rp2040", "--dry-run"], ["flash", "qtpy_rp2040"],
                    ["erase", "qtpy_rp2040", "--yes"]):  # fmt: skip
        screen.run(*command, "--port", tmp_path / NAME)
    assert_shown(screen.text())


@pytest.mark.parametrize("variable", ["ZENOH_CONFIG"])
def test_a_variable_of_the_environment(screen, monkeypatch, variable):
    monkeypatch.setenv(variable, EVIL)
    assert screen.run("monitor", "--port", "zenoh:") == 2
    assert_shown(screen.text())


@pytest.fixture
def network(tmp_path, monkeypatch):
    """A Zenoh session that publishes foreign data to the commands of the test."""
    net = Net(tmp_path)
    monkeypatch.setenv("ZENOH_CONFIG", str(net.leaf))
    monkeypatch.setattr("spots_net.zenoh_session._PATIENCE_S", 60.0)
    with session(net.hub) as foreign:
        yield foreign


def test_names_of_published_boards(screen, network):
    # A name that no node can have is not listed.
    with contextlib.ExitStack() as stack:
        for name in (NAME, f"{NAME}2", "a1", "b2"):
            stack.enter_context(Announced(network, name))
        assert screen.run("monitor", "--port", "zenoh:") == 2
    text = screen.text()
    assert_shown(text, shown=False)
    assert "zenoh:a1, zenoh:b2" in text


def test_an_error_in_place_of_a_published_board_reply(screen, network):
    with Announced(network, "a1") as announced:
        announced.replies("hello", json.dumps({"error": EVIL}), success=False)
        assert screen.run("monitor", "--port", "zenoh:") == 2
    assert_shown(screen.text())


@pytest.mark.board
@pytest.mark.parametrize("arguments", [[], ["--json"]])
def test_what_is_published(screen, network, arguments):
    ended = threading.Event()

    def publish():
        strip = Strip(EVIL, [EVIL], 0, (0,) * 6)
        values = dict.fromkeys(("sequence", "t_us", "flags", "gain_code"), 1) | {"counts": (1,) * 6}
        ((_, spectrum),) = messages("spectrum", values, 1.0, 0.0, strip)
        place = topic_key("a1", "spectrum").replace("spots_a1", NAME)
        while not ended.wait(0.05):
            for message in (b"\xff", EVIL.encode(), packed(spectrum)):
                network.put(place, message)

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        assert screen.run("subscribe", "/**", "--seconds", "2", *arguments) == 0
    finally:
        ended.set()
        thread.join()
    text = screen.text()
    assert_shown(text)
    objects = [json.loads(line) for line in text.splitlines() if line.startswith("{")]
    assert bool(objects) == bool(arguments)
    assert all(one["channels"] == [EVIL] for one in objects)


def test_what_a_guide_says(screen):
    with screen.on(), Guide(stdin=io.StringIO("1\n")) as guide:
        guide.begin(EVIL, 1, (EVIL,), 1e5)
        guide.say(EVIL)
        guide.ask(EVIL)
    assert_shown(screen.text())


PICTURES = {
    "monitor": lambda: StripView(
        {"board": EVIL, "runtime": EVIL, "channels": [EVIL]}, EVIL
    ).picture(LinkStats()),
    "channels": lambda: StripView({"board": "b", "runtime": "r", "channels": [EVIL]}, "p").picture(
        LinkStats()
    ),
    "controller": lambda: stick.picture(REST, title=EVIL),
    "twin": lambda: twin_view.TwinView(
        SimpleNamespace(trail=[], silence=lambda now_s: ""), [EVIL]
    ).picture([], 0.0),
}


@pytest.mark.parametrize("picture", PICTURES.values(), ids=PICTURES)
def test_a_picture(screen, picture):
    with screen.on():
        Console(width=200).print(picture())
    text = screen.text()
    assert_shown(text, MARK in text)
    assert "[red]" in text


def test_settings_that_are_measured_into_a_file_of_an_odd_name(screen, tmp_path, monkeypatch):
    monkeypatch.setattr(controller_setup, "hello_calibrated", lambda board: {"length_um": 85_000})
    monkeypatch.setattr(controller_setup, "_touch", lambda board: SimpleNamespace(position_um=1))
    path = tmp_path / (NAME + ".toml")
    path.write_bytes(controller_setup.DEFAULT.read_bytes())
    board = SimpleNamespace(command=lambda line: {})
    with (
        screen.on(),
        pytest.raises(AttributeError),
    ):  # its touch has no force
        controller_setup.set_up(board, path)
    assert_shown(screen.text())
