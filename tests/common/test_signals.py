"""Signals that end or suspend a process: it releases all keys first; a resumed one has no touch."""

import contextlib
import os
import pty
import random
import signal
import subprocess
import sys
import threading
import time

import pytest
from rich.console import Console

from spots.common.signals import ended_cleanly, on_console_event, released_by_signals
from spots.outputs import devices
from spots.outputs.devices import PrintedKeyboard
from spots.terminal.view import live

DEADLINE_S = 60
if sys.platform == "win32":
    pytest.skip("Windows has no such signals", allow_module_level=True)
IGNORED = (signal.SIGHUP, signal.SIGINT, signal.SIGQUIT, signal.SIGTSTP)

# Program that sends states as fast as possible, so that signals arrive at any point of the code.
PLAYS = """
import itertools
from spots.outputs.open import open_gamepad, open_keyboard
from spots.common.signals import released_by_signals, resumed
with released_by_signals(), open_keyboard(False) as keyboard, open_gamepad(False) as gamepad:
    print("ready", flush=True)
    for i in itertools.count(1):
        resumed()
        gamepad.update(i % 99 + 1, -5, 7, 1 << i % 16)
        for pressed in (True, False):
            keyboard.usage(7, 4 + i % 9, 0, pressed)
            keyboard.usage(12, 0xE9, 0, pressed)
"""
# Program that holds a key and an axis, as while a finger touches. After a suspension nothing is
# pressed.
HOLDS = """
import time
from spots.outputs.open import open_gamepad, open_keyboard
from spots.common.signals import released_by_signals
with released_by_signals(), open_keyboard(False) as keyboard, open_gamepad(False) as gamepad:
    keyboard.usage(7, 0xE1)
    keyboard.usage(7, 4)
    gamepad.update(1, 2, 3, 4)
    print("ready", flush=True)
    while True:
        gamepad.update(1, 2, 3, 4)
        keyboard.usage(7, 5)
        time.sleep(0.01)
"""


class Devices:
    """State of the virtual devices of a process, computed from the events that it recorded."""

    def __init__(self, path):
        self._path = path

    def lines(self):
        return self._path.read_text().splitlines() if self._path.exists() else []

    def held(self):
        known = {}
        for line in self.lines():
            if line[0].isdigit():
                *key, value = line.split()
                known[tuple(key)] = int(value)
        return {key for key, value in known.items() if value}


@pytest.fixture
def start(environment, tmp_path):
    """Return a function that starts a program in its own process group.

    It waits until the program is ready, and returns the process and its `Devices`.
    """
    with contextlib.ExitStack() as stack:

        def started(program, before=lambda: None):
            path = tmp_path / "events"
            process = subprocess.Popen(
                [sys.executable, "-c", program],
                env={**environment, "STAND_IN_EVENTS": str(path)},
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                preexec_fn=lambda: (os.setpgid(0, 0), before(), None)[-1],
            )
            stack.callback(process.stdout.close)
            stack.callback(process.wait)
            stack.callback(process.kill)
            assert process.stdout.readline() == b"ready\n"
            return process, Devices(path)

        yield started


def until(condition):
    end_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < end_s, "it does not happen"
        time.sleep(0.005)


def ignore_signals():
    """Ignore signals, as nohup does, and a shell for background jobs without job control."""
    for number in IGNORED:
        signal.signal(number, signal.SIG_IGN)


def stopped_by(process):
    _, status = os.waitpid(process.pid, os.WUNTRACED)
    assert os.WIFSTOPPED(status), status
    return os.WSTOPSIG(status)


@pytest.mark.board
@pytest.mark.parametrize("program", [PLAYS, HOLDS])
@pytest.mark.parametrize(
    "name", ["SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGABRT", "SIGTSTP", "SIGTTIN", "SIGTTOU"]
)
def test_a_signal_does_what_it_does_after_all_is_released(start, program, name):
    process, devices = start(program)
    assert program is PLAYS or devices.held()
    number = getattr(signal, name)
    process.send_signal(number)
    if name.startswith("SIGT") and name != "SIGTERM":
        assert stopped_by(process) == number
    else:
        assert process.wait(DEADLINE_S) == -number
        assert devices.lines()[-1] == "close"
    assert not devices.held()


@pytest.mark.board
def test_stops_at_many_moments_leave_nothing_down_and_it_plays_on(start):
    process, devices = start(PLAYS)
    rng = random.Random(1)
    for _ in range(60):
        time.sleep(rng.random() * 0.01)
        process.send_signal(rng.choice((signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU)))
        stopped_by(process)
        lines = len(devices.lines())
        assert not devices.held()
        process.send_signal(signal.SIGCONT)
        until(lambda: len(devices.lines()) > lines + 20)  # noqa: B023
    process.send_signal(signal.SIGTERM)
    assert process.wait(DEADLINE_S) == -signal.SIGTERM
    assert not devices.held()


@pytest.mark.board
def test_ends_at_many_moments_leave_nothing_down(start, tmp_path):
    rng = random.Random(2)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGQUIT, signal.SIGHUP) * 2:
        process, devices = start(PLAYS)
        time.sleep(rng.random() * 0.05)
        process.send_signal(number)
        process.send_signal(signal.SIGTERM)  # a second signal changes nothing
        assert process.wait(DEADLINE_S) in (-number, -signal.SIGTERM)
        assert devices.lines()[-1] == "close"
        assert not devices.held()
        (tmp_path / "events").unlink()


@pytest.mark.board
def test_after_a_stop_nothing_is_pressed_until_the_loop_has_begun_again(start):
    process, devices = start(HOLDS)
    process.send_signal(signal.SIGTSTP)
    stopped_by(process)
    lines = devices.lines()
    process.send_signal(signal.SIGCONT)
    process.send_signal(signal.SIGTERM)
    assert process.wait(DEADLINE_S) == -signal.SIGTERM
    assert devices.lines() == [*lines, "close", "close"]


@pytest.mark.board
def test_what_a_stop_without_a_handler_held_is_released_when_it_goes_on(start):
    process, devices = start(HOLDS)
    process.send_signal(signal.SIGSTOP)
    stopped_by(process)
    assert devices.held()
    process.send_signal(signal.SIGCONT)
    until(lambda: not devices.held())


@pytest.mark.board
def test_ignored_signals_stay_ignored(start):
    process, devices = start(HOLDS, ignore_signals)
    for number in IGNORED:
        process.send_signal(number)
    time.sleep(0.2)
    assert process.poll() is None
    assert devices.held()
    process.send_signal(signal.SIGTERM)
    assert process.wait(DEADLINE_S) == -signal.SIGTERM


def test_no_signal_is_ignored_here():
    names = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGABRT", "SIGTSTP", "SIGTTIN", "SIGTTOU")
    numbers = [getattr(signal, name) for name in names]
    assert [one for one in numbers if signal.getsignal(one) == signal.SIG_IGN] == []


@pytest.mark.board
def test_nor_where_the_tests_were_started_with_signals_ignored():
    """The test run starts with ignored signals, as under nohup or as a background job."""
    test = f"{__file__}::{test_no_signal_is_ignored_here.__name__}"
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", test]
    ran = subprocess.run(command, preexec_fn=ignore_signals, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stdout


def test_a_console_event_of_windows_waits_until_all_is_released(monkeypatch):
    """Windows calls the handler in a thread, and ends the process when the handler returns."""
    released, lines, found = threading.Event(), [], []
    monkeypatch.setattr(devices, "print", lambda line, flush: lines.append(line), raising=False)

    def close():
        found.append((on_console_event(2, released), list(lines)))

    thread = threading.Thread(target=close)
    with released_by_signals():
        with (
            contextlib.suppress(KeyboardInterrupt),
            PrintedKeyboard() as keyboard,
        ):
            keyboard.usage(7, 4)
            thread.start()
            while True:
                time.sleep(0.01)
        released.set()
    thread.join()
    assert found == [(True, ["down  A", "up    A"])]
    assert not on_console_event(0, released)  # Ctrl-C is handled by its signal


def test_handlers_are_put_back():
    names = ("SIGTERM", "SIGINT", "SIGTSTP", "SIGCONT")
    before = [signal.getsignal(getattr(signal, name)) for name in names]
    with released_by_signals():
        assert callable(signal.getsignal(signal.SIGTSTP))
    assert [signal.getsignal(getattr(signal, name)) for name in names] == before


def test_an_end_that_is_caught_in_the_block_is_no_end():
    """A program may catch the exception of Ctrl-C and then end normally."""
    with released_by_signals(), contextlib.suppress(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(DEADLINE_S)
    with released_by_signals(), PrintedKeyboard() as keyboard:
        keyboard.usage(7, 4)
        assert keyboard._down


# In an interactive shell with job control.

# A tap every second; the demo scenario has longer pauses.
TAPS = """
seconds = 1.0
[[touch]]
points = [[0.20, 42.5, 0], [0.25, 42.5, 3000], [0.75, 42.5, 3000], [0.80, 42.5, 0]]
"""


class Shell:
    """An interactive shell with its own terminal (PTY)."""

    def __init__(self, environment):
        self.pid, self._end = pty.fork()
        if not self.pid:
            os.environ.update(environment, PS1="")
            os.execvp("sh", ["sh", "-i"])

    def type(self, text):
        os.write(self._end, text.encode())

    def read(self):
        """Read and return the output of the shell, so that no process blocks on a full terminal."""
        os.set_blocking(self._end, False)
        with contextlib.suppress(OSError):
            return os.read(self._end, 65_536)
        return b""

    def hang_up(self):
        os.close(self._end)


@pytest.fixture
def shell(environment, tmp_path):
    made = Shell({**environment, "STAND_IN_EVENTS": str(tmp_path / "events")})
    yield made
    with contextlib.suppress(OSError):
        os.killpg(made.pid, signal.SIGKILL)
    with contextlib.suppress(ChildProcessError):
        os.waitpid(made.pid, 0)


@pytest.mark.board
@pytest.mark.parametrize("use", ["keyboard", "controller"])
def test_a_strip_is_played_stopped_and_played_again(shell, tmp_path, use):
    devices = Devices(tmp_path / "events")

    def now(condition):
        def looked():
            shell.read()
            return condition()

        until(looked)

    taps = tmp_path / "taps.toml"
    taps.write_text(TAPS)
    shell.type(f"{sys.executable} -m spots {use} --port virtual --scenario {taps}\n")
    for _ in range(3):
        before = len(devices.lines())
        now(lambda: len(devices.lines()) > before + 2 and devices.held())  # noqa: B023
        shell.type("\x1a")
        now(lambda: not devices.held())
        said = f"stopped-{before}"
        shell.type(f"echo {said} > {tmp_path}/said\n")  # the shell has the terminal again
        now(lambda: (tmp_path / "said").exists() and said in (tmp_path / "said").read_text())  # noqa: B023
        assert not devices.held()
        shell.type("fg\n")
    before = len(devices.lines())
    now(lambda: len(devices.lines()) > before + 2 and devices.held())
    shell.type("\x1c")  # Ctrl-\
    now(lambda: devices.lines()[-1] == "close")
    assert not devices.held()


CLEANS_UP = """
import os, signal, time
from spots.common.signals import released_by_signals
with released_by_signals():
    try:
        print("ready", flush=True)
        time.sleep(60)
    finally:
        time.sleep(0.2)
        print("cleaned up", flush=True)
"""


@pytest.mark.board
def test_a_continue_after_an_ending_signal_does_not_cut_the_end_in_two(start):
    process, _ = start(CLEANS_UP)
    for number in (signal.SIGTERM, signal.SIGCONT):
        process.send_signal(number)
    time.sleep(0.1)
    process.send_signal(signal.SIGCONT)
    assert process.stdout.readline() == b"cleaned up\n"
    assert process.wait(DEADLINE_S) == -signal.SIGTERM


# Program that writes a line when its block ends, and whose end takes some time.
ENDS = """
import time
from spots.common.signals import ended_cleanly
with ended_cleanly():
    try:
        print("ready", flush=True)
        while True:
            time.sleep(0.01)
    finally:
        time.sleep(0.3)
        print("ended", flush=True)
"""


@pytest.mark.board
@pytest.mark.parametrize("first", [signal.SIGTERM, signal.SIGHUP])
def test_a_command_ends_by_its_own_steps_and_then_by_the_signal(first):
    process = subprocess.Popen([sys.executable, "-c", ENDS], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "ready\n"
    process.send_signal(first)
    time.sleep(0.1)
    for number in (signal.SIGHUP, signal.SIGTERM):  # must not disturb the end
        process.send_signal(number)
    assert process.communicate(timeout=DEADLINE_S) == ("ended\n", None)
    assert process.returncode == -first


def test_ignored_signals_stay_ignored_and_other_threads_are_left_alone():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with ended_cleanly():
            assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
            assert signal.getsignal(signal.SIGTERM) not in (signal.SIG_IGN, signal.SIG_DFL)
    finally:
        signal.signal(signal.SIGHUP, before)
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
    found = []

    def in_thread():
        with ended_cleanly():
            found.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=in_thread)
    thread.start()
    thread.join()
    assert found == [signal.SIG_DFL]


def test_a_display_that_is_stopped_shows_the_cursor_and_hides_it_again(monkeypatch):
    # The other tests stop programs that hold keys; what is tried here is the terminal.
    master, slave = pty.openpty()
    seen = []
    monkeypatch.setattr(
        signal, "raise_signal", lambda number: seen.append((number, os.read(master, 1000)))
    )
    with os.fdopen(slave, "w") as terminal:
        console = Console(file=terminal, force_terminal=True)
        with live(console):
            terminal.flush()
            assert b"\x1b[?25l" in os.read(master, 1000)
            os.kill(os.getpid(), signal.SIGTSTP)
            assert seen == [(signal.SIGTSTP, b"\x1b[?25h")]
            assert os.read(master, 1000) == b"\x1b[?25l"
    os.close(master)
    assert signal.getsignal(signal.SIGTSTP) == signal.SIG_DFL
