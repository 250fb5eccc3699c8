"""Finds and opens a board, and uploads a calibration to it."""

import math
import sys
import time
from argparse import Namespace
from collections.abc import Collection, Mapping, Sequence
from os import PathLike
from typing import Any

from spots_device.board.settings import checksum  # pyright: ignore[reportUnknownVariableType]
from spots_device.reading.calibration import Calibration, Conditions
from spots_device.reading.calibration_lines import CalibrationError as LinesError
from spots_device.reading.rescale import rescale  # pyright: ignore[reportUnknownVariableType]

from ..errors import CalibrationError, NoReplyError, PortError, SpotsError, path_text
from .board import Board
from .lines import of_sensor
from .ports import comes_and_goes, known, opener
from .serial_link import SerialLink, usb_boards, usb_ports
from .stored import learn_calibrations

_LOOK_EVERY_S = 1.0  # time between two attempts with the option ``wait``
# Field of the reply to ``hello`` with the checksum of uploaded lines, by the command of the upload.
_UPLOADED = {"cal": "calibration", "layout": "layout"}


def open(port: str | PathLike[str] | None = None) -> Board:
    """Open a board: on USB, simulated, recorded, or published by another machine.

    Parameters
    ----------
    port : str or Path, optional
        Name of a serial port; ``"PORT#N"`` opens only strip N of a board with several strips. Other
        values: ``"virtual"`` starts a simulated board in real time. ``"recording:FILE"`` plays a
        recording. ``"zenoh:ID"`` reads a board that ``spots publish`` publishes on another machine;
        ``"zenoh:"`` reads the only published board. If not given, the only board on USB is opened;
        to find it, ``hello`` is sent to every USB device with a serial port.

    Returns
    -------
    Board
        The connected board. Close it, or use it in a ``with`` block.

    Raises
    ------
    SpotsError
        If no board or more than one board is found, or an argument is wrong.
    """
    board = open_with(port, None)
    learn_calibrations(board)
    return board


def open_with(
    port: str | PathLike[str] | None, options: Namespace | None, without: Collection[str] = ()
) -> Board:
    """Open a board as `open` does, with the options of its kind of port.

    Parameters
    ----------
    port : str, Path or None
        As for `open`.
    options : Namespace or None
        Options of the command line, see `ports`.
    without : collection of str
        Schemes of ports that the error for no board does not offer.

    Returns
    -------
    Board
        The connected board.

    Raises
    ------
    PortError
        If no board or more than one board is found, or an argument is wrong.
    """
    port = path_text(port, "a port") if port is not None else None
    open_port, target = opener(port)
    if open_port is not None:
        return open_port(target, options)
    if port is not None:
        return _opened(port)
    found, reasons = find()
    if not found:
        tried = "".join(f"; {reason}" for reason in reasons)
        raise PortError(
            f"no board found: plug a board in, or give {known(without)} as the port{tried}"
        )
    if len(found) > 1:
        names = ", ".join(board.port for board in found)
        for board in found:
            board.close()
        raise PortError(f"more than one board found: give one of these as the port: {names}")
    return found[0]


def _opened(port: str) -> Board:
    """Open a board on a serial port; ``PORT#N`` is strip N of a board with several strips."""
    name, mark, number = port.rpartition("#")
    if not mark or not number.isdecimal():
        return Board(SerialLink(port))
    board = Board(SerialLink(name), int(number))
    if board.info.get("sensor", 0) != int(number):  # the firmware is for one strip
        board.close()
        raise PortError(f"the board on {name} has one strip: leave out #{number}")
    return board


def open_named(options: Namespace) -> Board:
    """Open a board with a command's options: ``port``, and the options of this kind of port.

    The option ``without`` names kinds of ports that the command cannot use.

    With the option ``wait``, retry until a serial or published board is there, and print each new
    reason on stderr. The board may then be unplugged for any time.
    """
    without = getattr(options, "without", ())
    if not getattr(options, "wait", False):
        return open_with(options.port, options, without)
    reason = ""
    while True:
        try:
            board = open_with(options.port, options, without)
        except SpotsError as error:
            if not comes_and_goes(options.port):
                raise
            if str(error) != reason:
                reason = str(error)
                print(f"spots: waiting for a board: {reason}", file=sys.stderr, flush=True)
            time.sleep(_LOOK_EVERY_S)
        else:
            board.patience_s = math.inf
            return board


def find() -> tuple[list[Board], list[str]]:
    """Open all SPOTS boards on USB.

    Returns
    -------
    boards : list of Board
        The open boards.
    reasons : list of str
        Error message of each port that could not be opened as a SPOTS board.
    """
    boards: list[Board] = []
    reasons: list[str] = []
    for ports in usb_boards():
        for port in reversed(ports):
            try:
                boards.append(Board(SerialLink(port)))
                break
            except SpotsError as error:
                reasons.append(str(error))
    return boards, reasons


def of_id(boards: Sequence[Board], board_id: str) -> list[Board]:
    """Return the boards with an id, and make sure that there is at most one.

    Parameters
    ----------
    boards : sequence of Board
        Open boards.
    board_id : str
        The id.

    Returns
    -------
    list of Board
        The only board with this id; empty if there is none.

    Raises
    ------
    PortError
        If several boards have this id.
    """
    found = [board for board in boards if board.info["id"] == board_id]
    if len(found) > 1:
        ports = ", ".join(board.port for board in found)
        raise PortError(f"the boards on {ports} have the id {board_id}: unplug all but one")
    return found


def survey() -> list[dict[str, str]]:
    """Try to open a board on each USB serial port; return a row for each port.

    Keys of a row: ``port``, its name; ``device``, the USB device's description; ``answer``, a line
    with board, firmware, runtime and id, or the error message.
    """
    rows: list[dict[str, str]] = []
    for port in usb_ports():
        try:
            with Board(SerialLink(port.device)) as board:
                answer = "{board}, firmware {firmware}, {runtime}, id {id}".format(**board.info)
        except SpotsError as error:
            answer = str(error)
        rows.append({"port": port.device, "device": port.description, "answer": answer})
    return rows


def prepare(board: Board, calibration: Sequence[str], sensor: int = 0) -> None:
    """Set a board to the settings of a calibration, and upload the calibration.

    Parameters
    ----------
    board : Board
        The board to change.
    calibration : sequence of str
        Lines of the calibration, see `spots_device.reading.calibration_lines`.
    sensor : int
        Number of the strip on the board.

    Raises
    ------
    SpotsError
        If the board refuses the settings, or `upload` refuses the calibration.
    """
    made = _checked(calibration).conditions
    board.set(
        gain=made.gain,
        exposure_us=made.exposure_us,
        led_mA=made.led_mA,
        channels=list(made.plan),
        sensor=sensor,
    )
    upload(board, calibration, sensor)


def upload(board: Board, calibration: Sequence[str], sensor: int = 0) -> None:
    """Upload a calibration to a board. Only the board's command ``save`` makes it permanent.

    Parameters
    ----------
    board : Board
        The board to calibrate.
    calibration : sequence of str
        Lines of the calibration, see `spots_device.reading.calibration_lines`.
    sensor : int
        Number of the strip on the board.

    Raises
    ------
    BoardError, CalibrationError
        If the calibration is invalid, or was made on another board or with other settings. The
        board then keeps its previous calibration.
    """
    made = _checked(calibration)
    i: Any = board.command(of_sensor("hello", sensor))
    now = Conditions(i["id"], tuple(i["channels"]), i["gain"], i["exposure_us"], i["led_mA"])
    reason = made.mismatch(now)
    if reason is not None:
        raise CalibrationError(reason)
    name = upload_lines(board, "cal", calibration, sensor)
    board.learn(calibration, i, sensor)
    if sensor:
        return
    board.calibration = list(calibration)
    board.info["calibration"], board.info["length_um"] = name, made.length_um
    board.info["decay"], board.info["relative_force"] = made.decay, made.relative_force
    board.info["presser"] = made.presser
    if i["exposure_us"] != made.conditions.exposure_us:
        rescale(made, i["exposure_us"])
    board.info["cross"] = made.cross and list(made.cross)


def upload_lines(board: Board, command: str, lines: Sequence[str], sensor: int = 0) -> str:
    """Upload a calibration or a key layout to a board.

    Parameters
    ----------
    board : Board
        The board.
    command : str
        ``cal`` for a calibration, ``layout`` for a key layout.
    lines : sequence of str
        Lines to upload.
    sensor : int
        Number of the strip on the board.

    Returns
    -------
    str
        Checksum of the lines.

    Raises
    ------
    SpotsError
        If the board refuses the lines, or does not answer. The board is then unchanged. An upload
        of which a reply is lost is repeated once, unless the board already has the lines.
    """
    name: str = checksum(lines)
    try:
        _send(board, command, lines, name, sensor)
    except NoReplyError:
        info: Any = board.command(of_sensor("hello", sensor))
        if info.get(_UPLOADED[command]) != name:
            _send(board, command, lines, name, sensor)
    return name


def _send(board: Board, command: str, lines: Sequence[str], name: str, sensor: int) -> None:
    board.command(of_sensor(f"{command} begin", sensor))
    for line in lines:
        board.command(f"{command} {line}")
    board.command(f"{command} end {name}")


def ensured(board: Board, line: str) -> Mapping[str, Any]:
    """Send a command that can be repeated, such as ``save``; repeat it once if no reply arrives.

    Parameters
    ----------
    board : Board
        The board.
    line : str
        Command that has the same effect if the board executes it twice.

    Returns
    -------
    dict
        The reply.

    Raises
    ------
    SpotsError
        If the board refuses the command, or does not answer twice.
    """
    try:
        return board.command(line)
    except NoReplyError:
        return board.command(line)


def _checked(calibration: Sequence[str]) -> Any:
    try:
        return Calibration(calibration)
    except LinesError as error:
        raise CalibrationError(
            f"the calibration is invalid: {error}; calibrate the strip again"
        ) from None
