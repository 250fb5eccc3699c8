"""The port ``virtual``: real firmware on a simulated sensor, in a process of its own.

See `spots.link.ports` for what a port scheme is.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from spots.calibrate.calibration_file import CalibrationFile
from spots.calibrate.guide import Guide
from spots.calibrate.session import settings
from spots.calibrate.steps import Setup
from spots.deploy.drive import Drive
from spots.deploy.place import Place
from spots.deploy.prompt import Prompt
from spots.deploy.staging import Device
from spots.errors import SpotsError
from spots.link.board import Board
from spots.link.connect import prepare
from spots.link.serial_link import SerialLink

from .files import ScenarioFile, SensorFile, load
from .linkage_demo import compare, endless
from .runtimes import is_cpython
from .stage import Stage, calibrate, set_led
from .stage_presser import StagePresser
from .vm import micropython_command

VIRTUAL = "virtual"
_START_S = 10.0
_POLL_S = 0.02


def open_port(rest: str, *, sensor: str, scenario: str, seed: int) -> Board:
    """Open a virtual board in real time, see `open_virtual`.

    Parameters
    ----------
    rest : str
        What follows ``virtual`` in the port; ignored.
    sensor, scenario : str
        Files, by path or name.
    seed : int
        Of the noise.

    Returns
    -------
    Board

    Raises
    ------
    SpotsError
        If a file is missing or invalid.
    """
    return open_virtual(sensor, scenario, seed)[0]


def check(rest: str, *, sensor: str, scenario: str, seed: int) -> None:
    """Check the files of the virtual board.

    Parameters
    ----------
    rest : str
        What follows ``virtual`` in the port; ignored.
    sensor, scenario : str
        Files, by path or name.
    seed : int
        Of the noise; ignored.

    Raises
    ------
    SpotsError
        If a file is missing or invalid.
    """
    load(SensorFile, sensor)
    load(ScenarioFile, scenario)


def calibration_setup(options, made_with, out: Path, guide: Guide) -> Setup:
    """Return a simulated strip under a stage that presses it, for `spots calibrate`.

    It is as it was made with a session or, for `spots rezero`, with a calibration file: then it has
    changed as the sensor file says.

    Parameters
    ----------
    options : argparse.Namespace
        Of ``spots calibrate`` or ``spots rezero``.
    made_with : Session or CalibrationFile
        What the board was calibrated with.
    out : Path
        Of the calibration file.
    guide : Guide
        Prints what happens.

    Returns
    -------
    Setup

    Raises
    ------
    SpotsError
        If a file is missing or invalid.
    """
    sensor = load(SensorFile, options.sensor)
    scenario = load(ScenarioFile, options.scenario)
    stage = Stage(sensor, options.seed)
    # The stage is the finger; of the scenario only the strip's bend is used.
    stage.held.bend_deg = scenario.bend_deg
    # A virtual board forgets its settings when it ends: restore those it was calibrated with.
    made = made_with.conditions
    if isinstance(made_with, CalibrationFile):
        stage.held.changed = sensor.change
    if made is not None and made.board == stage.reader.conditions.board:
        stage.board.command("set " + settings(made))
        stage.take_dark()
        stage.reader.set_up()
    length_um = 1000 * (options.length_mm or sensor.length_mm)
    return Setup(stage.reader, StagePresser(stage), guide, made_with, length_um, out)


# The port as a whole linkage.
linkage, compare_linkage = endless, compare


@contextmanager
def flash_place(device: Device) -> Iterator[Place]:
    """Start a virtual board with an empty file system, to be flashed."""
    with tempfile.TemporaryDirectory() as folder, virtual_board(Path(folder), device) as there:
        yield there


@contextmanager
def virtual_board(folder: Path, device: Device) -> Iterator[Place]:
    """Start a virtual board on a file system folder as it is.

    Parameters
    ----------
    folder : Path
        Its file system; a CircuitPython board's drive.
    device : Device
        The board to simulate.

    Yields
    ------
    Place
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
            Drive(str(folder)).close()
            return
        except SpotsError:
            if time.monotonic() > end_s:
                raise SpotsError("the virtual board does not start") from None
        time.sleep(_POLL_S)


def open_virtual(sensor: str, scenario: str, seed: int) -> tuple[Board, float]:
    """Start a virtual board in real time, calibrated on the simulated stage, and open it.

    Parameters
    ----------
    sensor, scenario : str
        Files, by path or name.
    seed : int
        Of the noise, from 0.

    Returns
    -------
    board : Board
        Ends the virtual board when closed.
    started_s : float
        Host time of time 0 of its scenario.

    Raises
    ------
    SpotsError
        If a file is wrong, or the board does not start.
    """
    if seed < 0:
        raise SpotsError(f"a seed is a whole number from 0, not {seed}")

    file = load(SensorFile, sensor)
    calibration = calibrate(file)
    start, end = start_simulator(sensor, scenario, seed)
    try:
        board = _opened(start["port"])
    except BaseException:
        end()
        raise
    board.when_closed(end)
    try:
        set_led(board, file)
        prepare(board, calibration)
    except BaseException:
        board.close()
        raise
    return board, start["started_s"]


def _opened(port: str) -> Board:
    """Open a board that is starting, which takes a busy machine longer than a board that runs."""
    end_s = time.monotonic() + _START_S
    while True:
        try:
            return Board(SerialLink(port))
        except SpotsError:
            if time.monotonic() > end_s:
                raise


def start_simulator(
    sensor: str, scenario: str, seed: int, folder: str = "", board: str = VIRTUAL
) -> tuple[dict, Callable[[], None]]:
    """Start a virtual board in a process of its own.

    Parameters
    ----------
    sensor, scenario : str
        Files, by path or name.
    seed : int
        Of the noise.
    folder : str
        The board's file system, used as it is, for which there has to be a MicroPython; a new
        one with the firmware, if empty.
    board : str
        Which one of the virtual boards.

    Returns
    -------
    start : dict
        ``port``, ``console`` (the port with the prompt, the same one but on CircuitPython), and
        ``started_s``, the host's time of power-on.
    end : callable
        Ends it.

    Raises
    ------
    SpotsError
        If it does not start.
    """
    if not folder and is_cpython(board):
        module, more = "cpython_realtime", ()
    else:
        micropython_command()  # fails before anything is started
        module, more = "realtime", (board, folder)
    process = subprocess.Popen(
        [sys.executable, "-m", f"spots_sim.{module}", sensor, scenario, str(seed), *more],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )

    def end():
        process.stdin.close()
        process.wait()
        process.stdout.close()  # not before: it may just be starting, and write

    try:
        line = process.stdout.readline()
    except BaseException:
        end()
        raise
    start = json.loads(line or '{"error": "the simulator did not start"}')
    if "error" in start:
        end()
        raise SpotsError(start["error"])
    return start, end
