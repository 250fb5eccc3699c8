"""What is wrong with a board, from the cable to the light; each finding says what to do."""

from __future__ import annotations

import os
from collections.abc import Iterator
from itertools import islice, pairwise
from typing import NamedTuple

from spots_device import __version__, decode

from ..errors import SpotsError, printable
from ..link.board import Board
from ..link.connect import open as open_board
from ..link.frames import Spectrum
from ..link.ports import scheme_name
from ..link.serial_link import SerialLink
from ..link.udev import with_rule
from .place import the_board

_SPECTRA = 12
# A strip that lets no light through unpressed is as dark as one whose LED is broken.
_PRESS_WITHIN_S = 10.0
# Each exposure is followed by the transfer of the last one, and now and then by a dark frame.
_SLOWEST = 0.7
_BRIGHTEST = 0.95


class Finding(NamedTuple):
    """What a check found."""

    check: str
    ok: bool
    text: str


def doctor(port: str | None = None) -> None:
    """Print what each check found.

    Raises
    ------
    SpotsError
        If one found a problem.
    """
    problems = 0
    for finding in examine(port):
        problems += not finding.ok
        print(f"{'ok' if finding.ok else 'problem':8} {finding.check:10} {printable(finding.text)}")
    if problems:
        raise SpotsError(f"{problems} of the checks found a problem: see what each says to do")


def examine(port: str | None = None) -> Iterator[Finding]:
    """Check a board in the order in which one thing needs the other; end where that ends."""
    if not scheme_name(port):
        try:
            port = port or the_board()[-1]
        except SpotsError as error:
            yield Finding("port", False, str(error))
            return
        if os.name == "posix" and not os.path.exists(port):
            text = f"there is no port {port}; 'spots ports' lists those that there are"
            yield Finding("port", False, text)
            return
        yield Finding("port", True, port)
        try:
            SerialLink(port).close()
        except SpotsError as error:
            yield Finding("permission", False, with_rule(str(error), port))
            return
        yield Finding("permission", True, "the port may be opened")
    try:
        board = open_board(port)
    except SpotsError as error:
        yield Finding("hello", False, f"{error}; flash it: spots flash BOARD")
        return
    with board:
        yield from examine_board(board)


def examine_board(board: Board) -> Iterator[Finding]:
    """Check a board that answers."""
    yield Finding("hello", True, "{board}, {runtime}, id {id}".format(**board.info))
    firmware = board.info["firmware"]
    if firmware == __version__:
        yield Finding("firmware", True, firmware)
    else:
        text = f"{firmware} on the board, {__version__} here: spots flash {board.info['board']}"
        yield Finding("firmware", False, text)
    state = board.command("get")
    if state["fault"] is not None:
        yield Finding("sensor", False, f"{state['fault']}: check SDA, SCL, power and ground")
        return
    yield Finding("sensor", True, "it answers on the bus")
    board.command("stream spectrum")
    reading_us = state["exposure_us"] * state["average"]
    spectra = list(islice(_spectra(board, 1 + 3 * _SPECTRA * reading_us / 1e6), _SPECTRA))
    yield from _light(board, spectra, state["full_scale"])
    board.command("stream off")
    yield _rate(spectra, reading_us)


def _spectra(board: Board, seconds: float) -> Iterator[Spectrum]:
    return (frame for frame in board.frames(seconds) if isinstance(frame, Spectrum))


def _brightest(spectrum: Spectrum) -> int:
    return 0 if spectrum.flags & decode.LED_OFF else max(spectrum.counts)


def _light(board: Board, spectra: list[Spectrum], full_scale: int) -> Iterator[Finding]:
    lit = [spectrum for spectrum in spectra if not spectrum.flags & decode.LED_OFF]
    if not lit:
        yield Finding("light", False, "the LED is never on: spots command set led_mA=20")
        return
    brightest = max(map(_brightest, lit))
    if not brightest:
        text = f"none, which may be for want of a press: press within {_PRESS_WITHIN_S:.0f} s"
        yield Finding("light", True, text)
        brightest = next(filter(None, map(_brightest, _spectra(board, _PRESS_WITHIN_S))), 0)
    level = brightest / full_scale
    text = f"brightest channel at {100 * level:.1f} % of full scale"
    if not brightest:
        yield Finding("light", False, text + ": check the LED's wires, LDR is its cathode")
    elif level > _BRIGHTEST:
        yield Finding("light", False, text + ": press at the sensor's end, spots command auto")
    else:
        yield Finding("light", True, text)


def _rate(spectra: list[Spectrum], reading_us: int) -> Finding:
    if len(spectra) < 2:
        return Finding("rate", False, "no spectra come: spots command reboot")
    # In a dark window one comes each exposure, however many are averaged else.
    steps = list(pairwise(spectra))
    steps = [(a, b) for a, b in steps if not (a.flags | b.flags) & decode.LED_OFF] or steps
    # Numbers of frames count those that were lost on the way too.
    frames = sum((b.sequence - a.sequence) % (1 << 16) for a, b in steps)
    passed_us = sum((b.t_us - a.t_us) % (1 << 32) for a, b in steps)
    rate_hz, most_hz = frames / passed_us * 1e6, 1e6 / reading_us
    text = f"{rate_hz:.1f} frames a second, exposure and average allow {most_hz:.1f}"
    if rate_hz < _SLOWEST * most_hz:
        return Finding("rate", False, text + ": use a longer exposure, or a bus at 400 kHz")
    return Finding("rate", True, text)
