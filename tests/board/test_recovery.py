"""A user can always recover a board: by Ctrl-C, by its button, after a crash, at the prompt."""

import contextlib
import io
import subprocess
import sys
import time
from itertools import islice

import pytest
from serial.tools.list_ports_common import ListPortInfo
from support.boards import DEADLINE_S, refused, until, virtual_board

import spots
from spots.cli import main
from spots.deploy.doctor import examine
from spots.deploy.staging import device_of, stage
from spots.errors import PortError
from spots.link.serial_link import SerialLink
from spots_device.board.store import Store

pytestmark = pytest.mark.board

PROMPT = b"raw REPL; CTRL-B to exit\r\n>"


@pytest.fixture
def start(tmp_path):
    """Return a function that starts a board with the files in `tmp_path`; it returns the port."""
    stage(device_of("virtual"), tmp_path)
    with contextlib.ExitStack() as boards:
        yield lambda: boards.enter_context(virtual_board(tmp_path))


def ask(link, code):
    """Run code at MicroPython's raw prompt; return its output."""
    link.write(code.encode() + b"\x04")
    answer = until(link, b"\x04>")
    return answer.split(b"OK", 1)[1].split(b"\x04")[0].decode().strip()


def restarted(port):
    """Open a board that is starting: on a busy machine, `open` may not wait long enough for it."""
    end_s = time.monotonic() + DEADLINE_S
    while True:
        try:
            return spots.open(port)
        except PortError:
            if time.monotonic() >= end_s:
                raise


def interrupted(port):
    """Interrupt a running board, and return a link to its raw prompt."""
    spots.open(port).close()
    link = SerialLink(port)
    link.write(b"\r\x03\x03")
    link.write(b"\r\x01")
    until(link, PROMPT)
    return link


def test_ctrl_c_in_full_flow_stops_the_application_and_leaves_led_and_sensor_off(start):
    port = start()
    with spots.open(port) as board:
        for _ in zip(board.touches(), range(20)):
            pass
        board.command("stream touch spectrum")
    link = interrupted(port)
    code = (
        "import machine\n"
        "i2c = machine.I2C(0, scl=machine.Pin(1), sda=machine.Pin(0))\n"
        "b = bytearray(1)\n"
        "i2c.readfrom_mem_into(0x39, 0x80, b)\n"
        "enable = b[0]\n"
        "i2c.writeto(0x39, bytes((0xA9, 0x10)))\n"
        "i2c.readfrom_mem_into(0x39, 0x74, b)\n"
        "print(enable, b[0] >> 7)\n"
    )
    assert ask(link, code) == "1 0"  # PON without SP_EN; LED off
    link.close()


def test_a_soft_reset_at_the_raw_prompt_stays_there_and_a_hard_one_starts_the_application(start):
    port = start()
    link = interrupted(port)
    link.write(b"\x04")
    assert b"soft reboot\r\n" in until(link, PROMPT)
    assert ask(link, "print(6 * 7)") == "42"
    link.write(b"import machine\nmachine.reset()\x04")
    link.close()
    with restarted(port) as board:
        assert board.info["board"] == "virtual"


def test_a_soft_reset_at_the_friendly_prompt_starts_the_application(start):
    port = start()
    link = interrupted(port)
    link.write(b"\x02")
    until(link, b">>> ")
    link.write(b"\x04")
    until(link, b"soft reboot\r\n")
    link.close()
    with restarted(port) as board:
        assert board.info["board"] == "virtual"


@pytest.fixture(params=["friendly", "raw"])
def at_prompt(start, request, monkeypatch):
    """The port of a board that another program has left at its friendly or raw prompt."""
    # The prompt is waited for however slow the machine is.
    monkeypatch.setattr("spots.link.reconnect._PROMPT_S", DEADLINE_S)
    port = start()
    link = interrupted(port)
    if request.param == "friendly":
        link.write(b"\x02")
        until(link, b">>> ")
    link.close()
    usb = ListPortInfo(port)
    usb.vid = usb.serial_number = 1
    monkeypatch.setattr("spots.link.serial_link.list_ports.comports", lambda: [usb])
    return port


def test_every_command_recognises_a_board_at_its_prompt(at_prompt, capsys, monkeypatch):
    monkeypatch.setattr("spots.link.reconnect.HELLO_TIMEOUT_S", 0.05)  # no reply will come
    sentence = "is at its Python prompt, so its firmware does not run: press the board's reset"
    named = ["--port", at_prompt]
    for command in (
        ["command", "hello", *named],
        ["monitor", *named],
        ["keys", "push", "mini", *named],
        ["monitor"],
    ):
        assert sentence in refused(capsys, *command)
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    for command, code in ((["ports"], 0), (["doctor"], 2)):
        assert main(command) == code
        shown = capsys.readouterr().out
        assert sentence in shown
        assert "spots flash BOARD" not in shown


@pytest.mark.parametrize(
    ("at_prompt", "typed"), [("raw", "y\n"), ("friendly", "\n")], indirect=["at_prompt"]
)
def test_the_doctor_offers_to_restart_a_board_at_its_prompt(at_prompt, capsys, monkeypatch, typed):
    person = io.StringIO(typed)
    person.isatty = lambda: True
    monkeypatch.setattr(sys, "stdin", person)
    found = list(islice(examine(at_prompt), 3))
    assert "restart its firmware? [y/N]" in capsys.readouterr().out
    hello = found[2]
    assert hello.check == "hello"
    assert hello.ok == (typed == "y\n")
    assert ("virtual" if hello.ok else "Python prompt") in hello.text


def test_the_button_skips_the_application(start, tmp_path, monkeypatch):
    with (tmp_path / "board_config.py").open("a") as file:
        file.write("SAFE_BOOT = 2\n")
    monkeypatch.setenv("SPOTS_BUTTON", "held")
    link = SerialLink(start())
    link.write(b"\r")  # requests a new prompt: the output at the start may be lost
    until(link, b">>> ")
    link.write(b"import sys; print('spots_device.board.app' in sys.modules)\r")
    until(link, b"\nFalse")
    link.close()


def test_a_button_that_is_not_held_skips_nothing(start, tmp_path):
    with (tmp_path / "board_config.py").open("a") as file:
        file.write("SAFE_BOOT = 2\n")
    with spots.open(start()) as board:
        assert board.info["board"] == "virtual"


def test_a_crash_is_told_and_the_board_starts_anew(start, tmp_path):
    path = tmp_path / "spots_device" / "board" / "app.py"
    broken = path.read_text().replace(
        "    def time_us(self):\n", "    def time_us(self):\n        self.nonsense()\n"
    )
    path.write_text(broken)
    link = SerialLink(start())
    decoder = spots.Decoder()
    link.write(b"\nsync\n")
    told, end_s = [], link.now_s() + DEADLINE_S
    while not told:
        assert link.now_s() < end_s
        frames = decoder.feed(link.read(0.1))
        told = [frame.content for frame in frames if "log" in frame.content]
    assert told[0]["log"] == "error"
    assert "crashed" in told[0]["text"]
    assert "AttributeError" in told[0]["text"]
    assert "nonsense" in told[0]["text"]
    hello = []
    while not hello:
        assert link.now_s() < end_s
        link.write(b"hello\n")
        frames = decoder.feed(link.read(0.2))
        hello = [frame for frame in frames if frame.content.get("re") == "hello"]
    link.close()


@pytest.fixture
def watched(start, tmp_path, monkeypatch):
    """Return a function that starts a board with a watchdog of 2 s.

    The command ``layout clear`` makes this board hang.
    """
    with monkeypatch.context() as patch:
        patch.chdir(tmp_path)
        Store().save([("settings", ["watchdog=1"])])
    for path, old, new in (
        ("board/start.py", "WATCHDOG_MS = 8_000", "WATCHDOG_MS = 2_000"),
        (
            "board/strip_app.py",
            "def use_layout(self, lines):\n",
            "def use_layout(self, lines):\n        while True: pass\n",
        ),
    ):
        text = (tmp_path / "spots_device" / path).read_text()
        assert old in text
        (tmp_path / "spots_device" / path).write_text(text.replace(old, new))
    return start


def test_a_watchdog_starts_a_board_that_hangs(watched):
    port = watched()
    with spots.open(port) as board:
        assert board.info["watchdog"] == 1
        assert len([touch for touch, _ in zip(board.touches(), range(250))]) == 250  # > 2 s
        assert board.stats.restarts == 0
        board._link.write(b"layout clear\n")
        touches = board.touches(DEADLINE_S)
        assert any(board.stats.restarts for _ in touches)


def test_ctrl_c_under_a_watchdog_leads_to_a_prompt_that_lasts(watched, tmp_path):
    port = watched()
    link = interrupted(port)
    assert (
        ask(link, "import time; time.sleep(3); print('spots_device.board.app')")
        == "spots_device.board.app"
    )
    assert ask(link, "import sys; print('spots_device.board.app' in sys.modules)") == "False"
    assert not (tmp_path / "stay").exists()
    link.write(b"import machine\nmachine.reset()\x04")
    link.close()
    with restarted(port) as board:
        assert board.info["watchdog"] == 1


def test_mpremote_connects_while_the_application_runs(start):
    port = start()
    with spots.open(port) as board:
        assert len([touch for touch, _ in zip(board.touches(), range(50))]) == 50
    command = [sys.executable, "-m", "mpremote", "connect", port]
    run = subprocess.run(
        [*command, "exec", "print(6 * 7)", "+", "reset"], capture_output=True, text=True, timeout=60
    )
    assert run.stdout.strip() == "42", run.stdout + run.stderr
    with restarted(port) as board:
        assert board.info["board"] == "virtual"
