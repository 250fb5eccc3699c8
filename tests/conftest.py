"""Fixtures of all tests, such as a simulated sensor and its calibration."""

from __future__ import annotations

import ctypes
import fcntl
import functools
import gc
import os
import resource
import shutil
import signal
import subprocess
import sys
from contextlib import contextmanager, redirect_stdout
from importlib import metadata
from pathlib import Path

import pytest
from hypothesis import settings

from spots import cli
from spots.common import toml
from spots.deploy.build import build
from spots_sim.board.kept_folder import FOLDER
from spots_sim.person.stage import calibrate
from spots_sim.strip.files import SensorFile, load

# No deadline for an example: a machine under load is slow.
settings.register_profile("spots", deadline=None, derandomize=bool(os.environ.get("CI")))
settings.load_profile("spots")

# Substitutes for the packages of virtual keyboards and gamepads, so that every machine can run all
# tests.
STAND_INS = Path(__file__).parent / "stand_ins"


# Folders of tests whose processes compute at the same time. In the other folders a virtual board
# and its host wait for each other, which needs half the processor time if both are on one
# processor.
PARALLEL = {"bench", "remote", "web"}

# Folders and modules of tests in which the firmware of virtual boards runs in MicroPython. In all
# others it runs in CPython, which needs a third of the processor time. tests/micropython compares
# all numbers of both, and tests/board/test_cpython.py the readings.
IN_MICROPYTHON = {"bench", "live", "micropython"}
IN_MICROPYTHON |= {"cli", "common", "deploy", "firmware", "fuzz", "link", "outputs"}
IN_MICROPYTHON |= {"radio", "recording", "terminal"}
IN_MICROPYTHON |= {"test_determinism.py", "test_dropped_boards.py", "test_fire.py", "test_flash.py"}
IN_MICROPYTHON |= {"test_keys.py", "test_realtime.py", "test_recovery.py", "test_slow_board.py"}
IN_MICROPYTHON |= {"test_two_strips.py"}


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers():
    """Return how many processes ``--numprocesses auto`` starts: 2 for each processor.

    There are more processes than processors because tests often wait.
    """
    return 2 * os.cpu_count()


# Tests are in three tiers: `browser`, with a real browser; `board`, with processes, such as a real
# MicroPython, or with minutes of a simulated board; all others are pure.
TIERS = {"board": "starts processes, or computes for long", "browser": "uses a real browser"}
OF_FIXTURES = {"browser": "browser"}
OF_FIXTURES |= dict.fromkeys(("built", "pressed", "results", "roughly", "seen", "staged"), "board")
STARTS = (subprocess.Popen, "__init__"), (os, "fork"), (os, "forkpty"), (os, "posix_spawn")
_pure = []  # the pure test that runs


def pytest_configure(config):
    """Declare the tiers, and let a pure test fail that starts a process."""
    _check_environment()
    for name, words in TIERS.items():
        config.addinivalue_line("markers", f"{name}: {words}")
    # An audit hook would do the same, but Python calls it for every open file and import.
    for owner, name in STARTS:
        if hasattr(owner, name):
            setattr(owner, name, _watched(getattr(owner, name)))


def _check_environment():
    """End if pyproject.toml has other entry points than are installed: nothing would find them."""
    about = toml.loads((STAND_INS.parents[1] / "pyproject.toml").read_text(encoding="utf-8"))
    groups = about["project"]["entry-points"].items()
    installed = metadata.distribution("spots-tactile").entry_points
    wanted = {(group, *one) for group, named in groups for one in named.items()}
    if wanted - {(one.group, one.name, one.value) for one in installed}:
        remedy = "run '.venv/bin/pip install -e .', or 'make .venv/test'"
        pytest.exit(f"the check failed whether .venv has all entry points: {remedy}", 2)


def _watched(start):
    @functools.wraps(start)
    def watched(*arguments, **named):
        if _pure:
            raise AssertionError(f"{_pure[0]} starts a process: mark it with pytest.mark.board")
        return start(*arguments, **named)

    return watched


def pytest_collection_modifyitems(items):
    """Put the tests of the folders in `PARALLEL` first, because they wait for most of their time.

    The first worker starts with them, while the others compute; at the end, they would leave the
    processors idle. They also need only one browser, as long as no other worker steals them.
    """
    for item in items:
        for name in OF_FIXTURES.keys() & {*item.fixturenames}:
            item.add_marker(OF_FIXTURES[name])
    items.sort(key=lambda item: item.path.parent.name not in PARALLEL)


def pytest_runtest_teardown():
    """End the watch over a pure test."""
    _pure.clear()


def pytest_runtest_setup(item):
    """Select the runtime of virtual boards, and the processor of a test; watch a pure test.

    A test and the processes that it starts use one processor.
    """
    _pure[:] = [] if any(map(item.get_closest_marker, TIERS)) else [item.nodeid]
    if IN_MICROPYTHON.isdisjoint((item.path.parent.name, item.path.name)):
        os.environ["SPOTS_VIRTUAL_RUNTIME"] = "cpython"
    else:
        os.environ.pop("SPOTS_VIRTUAL_RUNTIME", None)
    worker, count = os.environ.get("PYTEST_XDIST_WORKER"), os.cpu_count()
    if worker and sys.platform == "linux":
        own = {int(worker.removeprefix("gw")) % count}
        os.sched_setaffinity(0, range(count) if item.path.parent.name in PARALLEL else own)


@pytest.fixture(scope="module", autouse=True)
def frozen():
    """Exempt what exists before a module of tests from garbage collection.

    The firmware collects garbage at its start. In a process that has loaded all tests and has run
    some thousand, this would take 0.3 s.
    """
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def sensor():
    """Sensor file `default`: the simulated strip that most tests use."""
    return load(SensorFile, "default")


@pytest.fixture(scope="session")
def shared_folder(tmp_path_factory):
    """Temporary folder that all processes of a test run share."""
    folder = tmp_path_factory.getbasetemp()
    return folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder


@pytest.fixture(scope="session")
def once(shared_folder):
    """Return a function that creates a file or folder one time for all processes of a test run."""

    def once(name, make):
        """Return the path of `name`; the first caller creates it with ``make(path)``."""
        path = shared_folder / name
        with open(shared_folder / f"{name}.lock", "a") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            part = shared_folder / f"{name}.part"
            if part.is_dir():  # of a caller that failed
                shutil.rmtree(part)
            part.unlink(missing_ok=True)
            if not path.exists():
                make(part)
                os.replace(part, path)
        return path

    return once


@pytest.fixture(scope="session")
def built(once):
    """Return a function that returns the folder with the build of a board.

    All tests share this folder, so they must not change it: a build takes half a second.
    """

    def built(board, strips=1):
        return once(f"build-{board}-{strips}", lambda root: build(board, root, strips)) / board

    return built


@pytest.fixture(scope="session")
def site(once):
    """Return the folder with the site of the documents, which all tests share."""
    from make import build_site

    return once("site", build_site.build) / "site"


@pytest.fixture(scope="session", autouse=True)
def kept_calibrations(shared_folder):
    """Cache the calibrations of virtual boards for all programs that tests start."""
    folder = shared_folder / "calibrations"
    folder.mkdir(exist_ok=True)
    os.environ[FOLDER] = str(folder)


@pytest.fixture(scope="session")
def calibration(sensor, once):
    """Calibration lines of the default sensor, from presses of the simulated stage."""
    # The same one, whatever the first test is: in MicroPython and CPython, the noise differs.
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SPOTS_VIRTUAL_RUNTIME", "cpython")
        once("calibrated", lambda path: (calibrate(sensor), path.touch()))  # others read it
        return list(calibrate(sensor))


def _calibrated(once, name, *steps):
    """Return a folder with the session and calibration of `steps`, made one time for a test run."""

    def make(folder):
        folder.mkdir()
        place = ["--session", str(folder / "a.jsonl"), "--port", "virtual"]
        with pytest.MonkeyPatch.context() as patch, open(folder / "said", "w") as said:
            patch.setenv("SPOTS_VIRTUAL_RUNTIME", "cpython")
            with redirect_stdout(said):
                for words in steps:
                    assert cli.main(["calibrate", *words, *place]) == 0

    return once(name, make)


@pytest.fixture(scope="session")
def staged(once):
    """Folder of a calibration by a stage: `a.jsonl`, `a.toml`, and `said`, what was printed.

    It has positions, forces, a strain of 10 % and a joint. All tests share it: copy, do not write.
    """
    strain = ["strain", "--strain-percent", "10"]
    return _calibrated(once, "staged", ["position"], ["force"], strain, ["joint"])


@pytest.fixture(scope="session")
def pressed(once):
    """Folder as that of `staged`, of 20 presses by hand with a scale."""
    return _calibrated(once, "pressed", ["--places", "20"])


@pytest.fixture(scope="session")
def roughly(once):
    """Folder as that of `staged`, of presses by hand without a scale."""
    return _calibrated(once, "roughly", ["--rough"])


@pytest.fixture(scope="session", autouse=True)
def signals():
    """Let programs that tests start receive every signal, even if nohup or a shell ignores it.

    A process inherits the ignored signals, and our programs do not change them.
    """
    # Python itself ignores these two signals.
    for number in signal.valid_signals() - {signal.SIGPIPE, signal.SIGXFSZ}:
        if signal.getsignal(number) == signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def no_zenoh_configuration(monkeypatch):
    """Remove ZENOH_CONFIG and ROS_DOMAIN_ID from the environment.

    The option ``--zenoh-config`` sets the first.
    """
    for name in ("ZENOH_CONFIG", "ROS_DOMAIN_ID"):
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)


@pytest.fixture
def full_disk():
    """Return a context manager in which writing a file beyond a number of bytes fails."""

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


def _forget(name):
    # Not by monkeypatch, whose undo would put the substitute back.
    for one in [one for one in sys.modules if one.partition(".")[0] == name]:
        del sys.modules[one]


@pytest.fixture
def evdev(monkeypatch):
    """Make ``import evdev`` import the substitute in tests/stand_ins; return this module."""
    _without(monkeypatch, "evdev")
    monkeypatch.syspath_prepend(str(STAND_INS))
    import evdev

    assert Path(evdev.__file__).parent == STAND_INS
    yield evdev
    _forget("evdev")


@pytest.fixture
def pynput(monkeypatch):
    """Make ``import pynput`` import the substitute; return its module ``pynput.keyboard``."""
    _without(monkeypatch, "pynput")
    monkeypatch.syspath_prepend(str(STAND_INS))
    from pynput import keyboard

    assert Path(keyboard.__file__).parent.parent == STAND_INS
    yield keyboard
    _forget("pynput")


@pytest.fixture
def environment():
    """Environment variables for a process that imports the substitutes for evdev and pynput."""
    path = os.pathsep.join([str(STAND_INS), *filter(None, sys.path)])
    return {**os.environ, "PYTHONPATH": path}


def pytest_terminal_summary(terminalreporter):
    """Print which checks did not run because this machine cannot run them."""
    if not os.access("/dev/uinput", os.W_OK):
        terminalreporter.write_line(
            "not run: a real uinput keyboard read back, for /dev/uinput cannot be written here"
        )
    try:
        ctypes.CDLL("libxkbcommon.so.0")
    except OSError:
        terminalreporter.write_line(
            "not run: the layouts of computers (tests/keyboard/test_hosts.py), for libxkbcommon is "
            "missing: apt install libxkbcommon0 xkb-data libx11-data"
        )
