"""Fixtures of all tests: a calibrated simulated sensor, made once."""

from __future__ import annotations

import fcntl
import gc
import os
import resource
import signal
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import settings

from spots_sim.files import SensorFile, load
from spots_sim.kept_folder import FOLDER
from spots_sim.stage import calibrate

# A loaded machine is slow, not wrong.
settings.register_profile("spots", deadline=None, derandomize=bool(os.environ.get("CI")))
settings.load_profile("spots")

# Of what plays keyboards and gamepads, so that every machine runs every test.
STAND_INS = Path(__file__).parent / "stand_ins"


# Folders of tests whose programs compute at the same time. In others a virtual board and its host
# take turns, which costs half as much processor time if both are on one processor.
PARALLEL = {"bench", "remote", "web"}


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers():
    """Return how many processes ``--numprocesses auto`` starts: much of the time is waiting."""
    return 3 * os.cpu_count() // 2


def pytest_runtest_setup(item):
    """Run a test and the processes that it starts on one processor, if this worker has its own."""
    worker = os.environ.get("PYTEST_XDIST_WORKER", "gw-1")
    everywhere = range(os.cpu_count())
    own = int(worker.removeprefix("gw"))
    if own in everywhere and sys.platform == "linux":
        os.sched_setaffinity(0, everywhere if item.path.parent.name in PARALLEL else {own})


def pytest_collection_finish():
    """Exempt modules and tests from garbage collection.

    The firmware collects at its start; in a process with every test loaded that costs 0.1 s.
    """
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def sensor():
    """The default sensor."""
    return load(SensorFile, "default")


@pytest.fixture(scope="session")
def shared_folder(tmp_path_factory):
    """The folder that all processes of a test run share."""
    folder = tmp_path_factory.getbasetemp()
    return folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder


@pytest.fixture(scope="session")
def once(shared_folder):
    """Return a function that makes a file or a folder once for all processes of a test run."""

    def once(name, make):
        """Return the path; the first caller makes it with ``make(path)``, and others wait."""
        path = shared_folder / name
        with open(shared_folder / f"{name}.lock", "a") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not path.exists():
                make(shared_folder / f"{name}.part")
                os.replace(shared_folder / f"{name}.part", path)
        return path

    return once


@pytest.fixture(scope="session", autouse=True)
def kept_calibrations(shared_folder):
    """Let programs that tests start reuse the calibrations of their virtual boards."""
    folder = shared_folder / "calibrations"
    folder.mkdir(exist_ok=True)
    os.environ[FOLDER] = str(folder)


@pytest.fixture(scope="session")
def calibration(sensor, once):
    """Calibration lines of the default sensor, from presses of the simulated stage."""
    once("calibrated", lambda path: (calibrate(sensor), path.touch()))  # others read it
    return list(calibrate(sensor))


@pytest.fixture(scope="session", autouse=True)
def signals():
    """Let programs that tests start get every signal, even if nohup or a shell ignores it.

    A process inherits which signals are ignored, and a program of ours leaves those alone.
    """
    for number in signal.valid_signals() - {signal.SIGPIPE, signal.SIGXFSZ}:  # as Python has them
        if signal.getsignal(number) == signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def no_zenoh_configuration(monkeypatch):
    """Undo ``--zenoh-config``, which the command line sets for the process in the environment."""
    monkeypatch.setenv("ZENOH_CONFIG", "")
    monkeypatch.delenv("ZENOH_CONFIG")


@pytest.fixture
def full_disk():
    """Return a context manager in which no file can grow beyond a given number of bytes."""

    @contextmanager
    def limit(file_bytes):
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (file_bytes, hard))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))

    return limit


def _without(monkeypatch, *names):
    for name in [*sys.modules]:
        if name.split(".")[0] in names:
            monkeypatch.delitem(sys.modules, name)


@pytest.fixture
def evdev(monkeypatch):
    """Make ``import evdev`` import the substitute."""
    _without(monkeypatch, "evdev")
    monkeypatch.syspath_prepend(str(STAND_INS))
    import evdev

    assert Path(evdev.__file__).parent == STAND_INS
    yield evdev
    _without(monkeypatch, "evdev")


@pytest.fixture
def pynput(monkeypatch):
    """Make ``import pynput`` import the substitute."""
    _without(monkeypatch, "pynput")
    monkeypatch.syspath_prepend(str(STAND_INS))
    from pynput import keyboard

    assert Path(keyboard.__file__).parent.parent == STAND_INS
    yield keyboard
    _without(monkeypatch, "pynput")


@pytest.fixture
def environment():
    """The environment of a process that imports the substitutes."""
    path = os.pathsep.join([str(STAND_INS), *filter(None, sys.path)])
    return {**os.environ, "PYTHONPATH": path}


def pytest_terminal_summary(terminalreporter):
    """Print which checks could not run on this machine."""
    if not os.access("/dev/uinput", os.W_OK):
        terminalreporter.write_line(
            "not run: a real uinput keyboard read back, for /dev/uinput cannot be written here"
        )
