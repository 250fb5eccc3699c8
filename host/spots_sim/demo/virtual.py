"""The port ``virtual``: real firmware on a simulated sensor, in a separate process.

`spots.link.ports` describes port schemes.
"""

from __future__ import annotations

import json
import os
import subprocess
import threading
import time
import weakref
from argparse import Namespace
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from spots.calibrate.calibration_file import FINGER, CalibrationFile
from spots.calibrate.pressers import awaited
from spots.calibrate.session.bench import Bench
from spots.calibrate.session.guide import Guide
from spots.calibrate.session.presser import Presser
from spots.calibrate.session.session_file import settings
from spots.common import atomic
from spots.common.python import module_command
from spots.deploy.drive import Drive
from spots.deploy.place import Place
from spots.deploy.prompt import Prompt
from spots.deploy.staging import Device
from spots.errors import PortError, SettingError, SpotsError
from spots.link.board import Board
from spots.link.connect import prepare
from spots.link.serial_link import SerialLink

from ..board.runtimes import is_cpython
from ..board.starting import end as end_process
from ..board.vm import micropython_command
from ..person.person import follow_pipe
from ..person.stage import Stage, board_lines, calibrate, set_as_calibrated
from ..person.stage_presser import StagePresser
from ..strip.defaults import given
from ..strip.files import ScenarioFile, SensorFile, load
from .linkage_demo import Endless, endless

VIRTUAL = "virtual"
_START_S = 10.0
_POLL_S = 0.02
# Sensor file and seed of each open board.
_open: set[tuple[str, int]] = set()
_opening = threading.Lock()
# Environment variable of a virtual board's process.
_INSIDE = "SPOTS_INSIDE_VIRTUAL_BOARD"


def open_port(target: str, options: Namespace | None = None) -> Board:
    """Open a virtual board in real time, see `open_virtual`.

    `target` is the text after ``virtual:`` in the port; it must be empty, otherwise SettingError.
    """
    _check_target(target)
    options = given(options)
    return open_virtual(options.sensor, options.scenario, options.seed)[0]


def check(target: str, options: Namespace | None = None) -> None:
    """Validate the sensor and scenario file of a virtual board; see `open_port`."""
    _check_target(target)
    options = given(options)
    load(SensorFile, options.sensor)
    load(ScenarioFile, options.scenario)


def _check_target(target: str) -> None:
    if target:
        raise SettingError(f"there is no port {VIRTUAL}:{target}: write {VIRTUAL}")


def calibration_setup(options, made_with, path: Path, guide: Guide) -> Bench:
    """Return a simulated strip on a simulated stage, for ``spots calibrate`` and ``spots rezero``.

    For ``spots rezero``, the strip has changed as the sensor file describes. With the port
    ``virtual:PIPE``, a person at the terminal moves the finger through a named pipe, see
    `person.follow_pipe`. If `made_with` was made with this virtual board, its settings are sent to
    the board.
    """
    options = given(options)
    sensor = load(SensorFile, options.sensor)
    scenario = load(ScenarioFile, options.scenario)
    stage = Stage(sensor, options.seed, number=options.seed)
    # The stage replaces the fingers; only the bend of the scenario is used.
    stage.held.bend_deg = scenario.bend_deg
    # A virtual board loses its settings when it ends: restore the settings of the calibration.
    made = made_with.conditions
    if isinstance(made_with, CalibrationFile):
        stage.held.changed = sensor.change
        stage.by_hand = (options.presser or awaited(made_with)) == FINGER and not options.joint
    if made is not None and made.board == stage.reader.conditions.board:
        stage.board.command("set " + settings(made))
        stage.take_dark()
        stage.reader.set_up()
    length_um = 1000 * (options.length_mm or sensor.length_mm)
    presser: Presser = StagePresser(stage)
    if pipe := options.port.partition(":")[2]:
        follow_pipe(stage.held, Path(pipe))
        presser = Presser(guide)
    return Bench(stage.reader, presser, guide, length_um, path)


def linkage(options: Namespace) -> Endless:
    """Return the simulated linkage that the options of a command describe."""
    options = given(options)
    return endless(options.sensor, options.linkage, seed=options.seed)


@contextmanager
def flash_place(device: Device) -> Iterator[Place]:
    """Start a virtual board with an empty file system, for `spots.deploy.flash`."""
    with atomic.temporary() as folder, virtual_board(folder, device) as there:
        yield there


@contextmanager
def virtual_board(folder: Path, device: Device) -> Iterator[Place]:
    """Start a virtual board whose file system is a folder, for `spots.deploy`.

    The folder of a CircuitPython board is its drive. No firmware is copied to it.
    """
    start, end = start_simulator("default", "demo", 0, str(folder), device.name)
    try:
        heard = lambda: [start["port"]]  # noqa: E731
        if device.runtime == "circuitpython":
            _await_drive(folder)
            yield Place(str(folder), lambda: Drive(str(folder), start["console"]), heard)
        else:
            yield Place(start["port"], lambda: Prompt(start["port"]), heard)
    finally:
        end()


def _await_drive(folder: Path) -> None:
    end_s = time.monotonic() + _START_S
    while True:
        try:
            Drive(str(folder))
            return
        except SpotsError:
            if time.monotonic() > end_s:
                raise PortError(
                    f"the virtual board did not start within {_START_S:g} s: try again"
                ) from None
        time.sleep(_POLL_S)


def open_virtual(sensor: str, scenario: str, seed: int) -> tuple[Board, float]:
    """Start a virtual board in real time, calibrated on the simulated stage, and open it.

    The board stops when it is closed. A board beside an open one of this program gets the next free
    seed, and so an id of its own. The second result is the host time in seconds at which the
    scenario's time is 0. SpotsError if an argument or file is invalid, or the board does not start.
    """
    if not isinstance(seed, int) or seed < 0:
        raise SettingError(f"the seed must be a whole number of 0 or more, not {seed!r}")

    load(ScenarioFile, scenario)  # before the strip is calibrated
    file = load(SensorFile, sensor)
    calibration = calibrate(file)
    seed = _free_seed(sensor, seed)
    try:
        start, stop = start_simulator(sensor, scenario, seed)
    except BaseException:
        _open.discard((sensor, seed))
        raise

    def end() -> None:
        _open.discard((sensor, seed))
        stop()

    try:
        board = _opened(start["port"])
    except BaseException:
        end()
        raise
    board.when_closed(weakref.finalize(board, end))  # or when the program drops it
    try:
        set_as_calibrated(board, file)
        prepare(board, board_lines(calibration, board.info["id"]))
    except BaseException:
        board.close()
        raise
    return board, start["started_s"]


def _free_seed(sensor: str, seed: int) -> int:
    """Return the first seed from `seed` on that no open board of this program has; reserve it."""
    with _opening:
        while (sensor, seed) in _open:
            seed += 1
        _open.add((sensor, seed))
    return seed


def _opened(port: str) -> Board:
    """Open a board that may still be starting; repeat failed attempts for up to 10 s."""
    end_s = time.monotonic() + _START_S
    while True:
        try:
            return Board(SerialLink(port))
        except SpotsError:
            if time.monotonic() > end_s:
                raise


def start_simulator(
    sensor: str,
    scenario: str,
    seed: int,
    folder: str = "",
    board: str = VIRTUAL,
    strips: int = 1,
) -> tuple[dict, Callable[[], None]]:
    """Start a virtual board in a separate process; return its first message and ``end()``.

    The message has ``port`` for frames, ``console`` with the prompt (another port only on
    CircuitPython), and ``started_s``, the host time of power-on. `folder` is the board's file
    system, without a copy of the firmware, only on MicroPython; if empty, a temporary folder with
    the firmware. ``end()`` waits for the process. PortError if the board does not start.
    """
    if os.environ.get(_INSIDE):
        raise PortError(
            "a virtual board's process opens a virtual board: PYTHONPATH has a script with the "
            "name of a module of Python, such as pty.py; rename it"
        )
    if not folder and is_cpython(board):
        module, more = "cpython_realtime", (str(strips),)
    else:
        micropython_command()  # raises SpotsError before the process starts
        module, more = "realtime", (board, folder, str(strips))
    process = subprocess.Popen(
        module_command(f"spots_sim.board.{module}", sensor, scenario, str(seed), *more),
        env=os.environ | {_INSIDE: "1"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )

    stop = partial(end_process, process, os.getpid())
    try:
        line = process.stdout.readline()
    except BaseException:
        stop()
        raise
    start = json.loads(line or '{"error": "the simulator did not start: see its error above"}')
    if "error" in start:
        stop()
        raise PortError(start["error"])
    return start, stop
