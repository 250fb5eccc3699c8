"""Finding a board and opening it."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from os import PathLike, fspath
from typing import Any

from spots_device.calibration import Calibration, CalibrationError, Conditions
from spots_device.settings import checksum  # pyright: ignore[reportUnknownVariableType]

from ..errors import SpotsError
from .board import Board
from .ports import known, scheme
from .serial_link import SerialLink, usb_boards, usb_ports


def open(
    port: str | PathLike[str] | None = None,
    *,
    sensor: str = "default",
    scenario: str = "demo",
    seed: int = 0,
) -> Board:
    """Open a board.

    Parameters
    ----------
    port : str or Path, optional
        A serial port, or one of a scheme, see `ports`: ``"virtual"`` starts a simulated board in
        real time, ``"recording:FILE"`` plays a recording, ``"zenoh:ID"`` is a board that `spots
        publish` publishes on another machine, ``"zenoh:"`` the only one. If not given, every USB
        serial port is asked ``hello``, and exactly one has to answer.
    sensor, scenario : str
        Files of the virtual board, by path or name.
    seed : int
        Of the virtual board's noise, from 0.

    Returns
    -------
    Board
        Connected; it closes its port when it is closed, or at the end of a ``with``.

    Raises
    ------
    SpotsError
        If no board, or more than one, is there, or an argument is wrong; the text says what to do.
    """
    port = fspath(port) if port is not None else None
    module, rest = scheme(port)
    if module is not None:
        return module.open_port(rest, sensor=sensor, scenario=scenario, seed=seed)
    if port is not None:
        return Board(SerialLink(port))
    found, reasons = find()
    if not found:
        tried = "".join(f"; {reason}" for reason in reasons)
        raise SpotsError(f"no board found: plug one in, or name {known()} as port{tried}")
    if len(found) > 1:
        names = ", ".join(board.port for board in found)
        for board in found:
            board.close()
        raise SpotsError(f"more than one board found, name one of: {names}")
    return found[0]


def open_named(options: Namespace) -> Board:
    """Open the board that a command's options name by port, sensor, scenario and seed."""
    return open(options.port, sensor=options.sensor, scenario=options.scenario, seed=options.seed)


def find() -> tuple[list[Board], list[str]]:
    """Ask every USB device with a serial port who it is.

    Returns
    -------
    boards : list of Board
        Those that answered, open.
    reasons : list of str
        Why the others are not SPOTS boards.
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


def survey() -> list[dict[str, str]]:
    """Ask every USB serial port who it is; return port, USB device and answer of each."""
    rows: list[dict[str, str]] = []
    for port in usb_ports():
        try:
            with Board(SerialLink(port.device)) as board:
                answer = "{board}, firmware {firmware}, {runtime}, id {id}".format(**board.info)
        except SpotsError as error:
            answer = str(error)
        rows.append({"port": port.device, "device": port.description, "answer": answer})
    return rows


def prepare(board: Board, calibration: Sequence[str]) -> None:
    """Set a board as a calibration was made, and give it the calibration.

    Parameters
    ----------
    board : Board
    calibration : sequence of str
        Lines, see `spots_device.calibration`.

    Raises
    ------
    SpotsError
        As `upload` does, or if the board refuses the settings.
    """
    made = _checked(calibration).conditions
    board.set(
        gain=made.gain, exposure_us=made.exposure_us, led_mA=made.led_mA, plan=list(made.plan)
    )
    upload(board, calibration)


def upload(board: Board, calibration: Sequence[str]) -> None:
    """Give a board a calibration, which it uses at once and forgets without ``save``.

    Parameters
    ----------
    board : Board
    calibration : sequence of str
        Lines, see `spots_device.calibration`.

    Raises
    ------
    SpotsError
        If it is invalid, was made on another board or at other settings; the board keeps its
        own.
    """
    made = _checked(calibration)
    i = board.command("hello")
    now = Conditions(i["id"], tuple(i["plan"]), i["gain"], i["exposure_us"], i["led_mA"])
    reason = made.mismatch(now, i.get("mains_hz", 0))
    if reason is not None:
        raise SpotsError(reason)
    board.command("cal begin")
    for line in calibration:
        board.command("cal " + line)
    name: str = checksum(calibration)
    board.command("cal end " + name)
    board.calibration = list(calibration)
    board.info["calibration"], board.info["length_um"] = name, made.length_um


def _checked(calibration: Sequence[str]) -> Any:
    try:
        return Calibration(calibration)
    except CalibrationError as error:
        raise SpotsError(f"no board takes this calibration: {error}") from None
