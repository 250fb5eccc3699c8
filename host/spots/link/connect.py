"""Finding a board and opening it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable

from tactile.calibration import Calibration, CalibrationError
from tactile.settings import checksum

from ..errors import SpotsError
from ..recording.replay import open_recording
from .board import Board
from .serial_link import SerialLink, usb_boards, usb_ports

VIRTUAL = "virtual"
RECORDING = "recording:"
ZENOH = "zenoh:"


def open(
    port: str | None = None, *, sensor: str = "default", scenario: str = "demo", seed: int = 0
) -> Board:
    """Open a board.

    Parameters
    ----------
    port : str, optional
        A serial port; ``"virtual"`` starts a simulated board in real time; ``"recording:FILE"``
        plays one back, see `recording.replay.open_recording`; ``"zenoh:ID"`` is the board that
        `spots publish` publishes on another machine, ``"zenoh:"`` the only one; if not given,
        every USB serial port is asked ``hello``, and exactly one has to answer.
    sensor, scenario : str
        Files of the virtual board, by path or name.
    seed : int
        Of the virtual board's noise, from 0.

    Raises
    ------
    SpotsError
        If no board, or more than one, is there, or an argument is wrong; the text says what to do.
    """
    if port == VIRTUAL:
        return open_virtual(sensor, scenario, seed)[0]
    if port is not None and port.startswith(RECORDING):
        return open_recording(port[len(RECORDING) :])
    if port is not None and port.startswith(ZENOH):
        from ..remote.remote_board import open_remote  # Zenoh only where it is used

        return open_remote(port[len(ZENOH) :])
    if port is not None:
        return Board(SerialLink(port))
    found, reasons = find()
    if not found:
        tried = "".join(f"; {reason}" for reason in reasons)
        raise SpotsError(f"no board found, plug one in or try port 'virtual'{tried}")
    if len(found) > 1:
        names = ", ".join(board.port for board in found)
        for board in found:
            board.close()
        raise SpotsError(f"more than one board found, name one of: {names}")
    return found[0]


def open_named(options) -> Board:
    """Open the board that a command's options name by port, sensor, scenario and seed."""
    return open(options.port, sensor=options.sensor, scenario=options.scenario, seed=options.seed)


def find() -> tuple[list[Board], list[str]]:
    """Ask every USB device with a serial port who it is.

    Returns
    -------
    boards : list of Board
        Those that answered, open.
    reasons : list of str
        Why the others are none.
    """
    boards, reasons = [], []
    for ports in usb_boards():
        for port in reversed(ports):
            try:
                boards.append(Board(SerialLink(port)))
                break
            except SpotsError as error:
                reasons.append(str(error))
    return boards, reasons


def survey() -> list[dict]:
    """Ask every USB serial port who it is; return port, USB device and answer of each."""
    rows = []
    for port in usb_ports():
        try:
            with Board(SerialLink(port.device)) as board:
                answer = "{board}, firmware {firmware}, {runtime}, id {id}".format(**board.info)
        except SpotsError as error:
            answer = str(error)
        rows.append({"port": port.device, "device": port.description, "answer": answer})
    return rows


def open_virtual(sensor: str, scenario: str, seed: int) -> tuple[Board, float]:
    """Start a virtual board in real time, calibrated on the simulated stage, and open it.

    Returns
    -------
    board : Board
        Ends the virtual board when closed.
    started_s : float
        Host time of time 0 of its scenario.
    """
    if seed < 0:
        raise SpotsError(f"a seed is a whole number from 0, not {seed}")
    from spots_sim.files import SensorFile, load
    from spots_sim.stage import calibrate  # the simulator only where it is used

    calibration = calibrate(load(SensorFile, sensor))
    start, end = start_simulator(sensor, scenario, seed)
    try:
        board = Board(SerialLink(start["port"]))
    except BaseException:
        end()
        raise
    board.when_closed(end)
    try:
        prepare(board, calibration)
    except BaseException:
        board.close()
        raise
    return board, start["started_s"]


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
        The board's file system, used as it is; a new one with the firmware, if empty.
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
    arguments = [sensor, scenario, str(seed), board, folder]
    process = subprocess.Popen(
        [sys.executable, "-m", "spots_sim.realtime", *arguments],
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


def prepare(board: Board, calibration) -> None:
    """Set a board as a calibration was made, and give it the calibration."""
    made = _checked(calibration)
    board.command(
        f"set gain={made.gain} exposure_us={made.exposure_us} led_mA={made.led_mA} "
        f"plan={','.join(made.plan)}"
    )
    upload(board, calibration)


def upload(board: Board, calibration) -> None:
    """Give a board a calibration, which it uses from then on and forgets unless told to save.

    Parameters
    ----------
    board : Board
    calibration : sequence of str
        Lines, see `tactile.calibration`.

    Raises
    ------
    SpotsError
        If it is none, was made on another board or at other settings; the board keeps what it
        has.
    """
    made = _checked(calibration)
    i = board.command("hello")
    reason = made.mismatch(i["id"], i["plan"], i["gain"], i["exposure_us"], i["led_mA"])
    if reason is not None:
        raise SpotsError(reason)
    board.command("cal begin")
    for line in calibration:
        board.command("cal " + line)
    board.command("cal end " + checksum(calibration))
    board.calibration = list(calibration)


def _checked(calibration) -> Calibration:
    try:
        return Calibration(calibration)
    except CalibrationError as error:
        raise SpotsError(f"no board takes this calibration: {error}") from None
