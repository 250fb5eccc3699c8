"""Checks a board from its cable to its light; each finding says what to do."""

from __future__ import annotations

import os
from collections.abc import Iterator
from itertools import islice, pairwise
from typing import NamedTuple

from spots_device import __version__, decode

from ..errors import SpotsError, printable
from ..link.board import Board
from ..link.calibrated import next_step
from ..link.connect import open as open_board
from ..link.frames import Spectrum
from ..link.ports import no_port, scheme_name
from ..link.serial_link import SerialLink
from ..link.udev import with_rule
from .place import the_board

_SPECTRA = 12
_LIT = 4  # samples that are compared with the dark frames around them
# A strip that nobody presses is as dark as one whose LED is broken.
_PRESS_WITHIN_S = 10.0
_DIM = 0.01  # of full scale: positions of so little light are noise
_DARK_TIMEOUT_S = 30.0
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
        raise SpotsError(f"{problems} of the checks found a problem: do what each of them says")


def examine(port: str | None = None) -> Iterator[Finding]:
    """Check a port and its board step by step; stop where the next step needs the failed one."""
    flash = "" if scheme_name(port) else "; flash it: spots flash BOARD"
    if not scheme_name(port):
        try:
            port = port or the_board()[-1]
        except SpotsError as error:
            yield Finding("port", False, str(error))
            return
        if os.name == "posix" and not os.path.exists(port):
            yield Finding("port", False, no_port(port))
            return
        yield Finding("port", True, port)
        try:
            SerialLink(port).close()
        except SpotsError as error:
            yield Finding("permission", False, with_rule(str(error), port))
            return
        yield Finding("permission", True, "the port can be opened")
    try:
        board = open_board(port)
    except SpotsError as error:
        yield Finding("hello", False, f"{error}{flash}")
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
    reading_s = 1e-6 * state["exposure_us"] * state["average"]
    spectra = list(islice(_spectra(board, 1 + 3 * _SPECTRA * reading_s), _SPECTRA))
    if state["led_mA"]:
        yield from _light(board, state["full_scale"], reading_s)
    else:
        yield Finding("light", False, "the LED is off: spots command set led_mA=20")
    board.command("stream off")
    yield _rate(spectra, reading_s)
    hello = board.command("hello")
    step = next_step(hello)
    text = f"not yet; {step}" if step else f"for {hello['length_um'] / 1000:g} mm"
    yield Finding("calibrated", True, text)


def _spectra(board: Board, seconds: float) -> Iterator[Spectrum]:
    return (frame for frame in board.frames(seconds) if isinstance(frame, Spectrum))


def _light(board: Board, full_scale: int, reading_s: float) -> Iterator[Finding]:
    light, brightest, fits = _lit(board, reading_s)
    if light < _DIM * full_scale:
        text = f"none yet: press firmly near the sensor within {_PRESS_WITHIN_S:.0f} s, and hold"
        yield Finding("light", True, text)
        end_s = board.now_s() + _PRESS_WITHIN_S
        while light < _DIM * full_scale and board.now_s() < end_s:
            light, brightest, fits = _lit(board, reading_s)
    text = f"{100 * max(light, 0) / full_scale:.1f} % of full scale are the LED's"
    if light < _DIM * full_scale:
        text += ": press firmly and run spots command auto, or check the LED's wires, LDR is its "
        yield Finding("light", False, text + "cathode")
    elif brightest > _BRIGHTEST * full_scale:
        yield Finding("light", False, text + ": press at the sensor's end, spots command auto")
    else:
        yield Finding("light", True, text)
    if not fits:
        text = "the press fits the calibration worse than when it was made; re-zero is advised: "
        yield Finding("fit", False, text + "spots rezero")


def _lit(board: Board, reading_s: float) -> tuple[float, int, bool]:
    """Return the counts that the LED adds in the best channel, the largest raw count, and the fit.

    The fit is False if no sample fits one press of the calibration, see `decode.MISFIT`.

    The room's light changes, and a press guides it, too. So what counts as the LED's is only what
    every lit sample has more than the dark frames before and after it.
    """
    before = board.command("dark", timeout_s=_DARK_TIMEOUT_S)["dark"]
    begun_s = board.now_s() + reading_s / 2
    lit = (
        spectrum
        for spectrum in _spectra(board, 1 + 3 * _LIT * reading_s)
        if spectrum.time_s >= begun_s and not spectrum.flags & decode.LED_OFF
    )
    samples = list(islice(lit, _LIT))
    after = board.command("dark", timeout_s=_DARK_TIMEOUT_S)["dark"]
    if not samples:
        return 0, 0, True
    dark = [max(pair) / decode.DARK_SAMPLES for pair in zip(before, after)]
    counts = [spectrum.counts for spectrum in samples]
    least = map(min, zip(*counts))
    fits = not all(spectrum.flags & decode.MISFIT for spectrum in samples)
    return max(lit - dark for lit, dark in zip(least, dark)), max(map(max, counts)), fits


def _rate(spectra: list[Spectrum], reading_s: float) -> Finding:
    if len(spectra) < 2:
        return Finding("rate", False, "the board sends no spectra: spots command reboot")
    # In a dark window one comes each exposure, however many are averaged else.
    steps = list(pairwise(spectra))
    steps = [(a, b) for a, b in steps if not (a.flags | b.flags) & decode.LED_OFF] or steps
    # Numbers of frames count those that were lost on the way too.
    frames = sum((b.sequence - a.sequence) % (1 << 16) for a, b in steps)
    passed_us = sum((b.t_us - a.t_us) % (1 << 32) for a, b in steps)
    rate_hz, most_hz = frames / passed_us * 1e6, 1 / reading_s
    text = f"{rate_hz:.1f} frames a second, exposure and average allow {most_hz:.1f}"
    if rate_hz < _SLOWEST * most_hz:
        return Finding("rate", False, text + ": use a longer exposure, or a bus at 400 kHz")
    return Finding("rate", True, text)
