"""Checks a board from its cable to its light; each finding says what to do."""

from __future__ import annotations

import math
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
from ..link.replies import Get
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
_RATE_S = 0.5  # of readings, in which the commands before and after them cost little
_MISSED = 0.15  # of the samples: more than commands and dark frames cost
_BRIGHTEST = 0.95
# What to look at first, by the kind of the LED.
_WIRES = {
    "ldr": ", LDR is its cathode",
    "gpio": " and the board's STRIP_LED_PIN",
    "always": " and its supply",
}


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
    count = max(_SPECTRA, round(_RATE_S / reading_s))
    missed = board.command("get")["missed"]
    spectra = list(islice(_spectra(board, 1 + 3 * count * reading_s), count))
    missed = max(0, board.command("get")["missed"] - missed)  # it restarts with the sensor
    if state["led"] == "ldr" and not state["led_mA"]:
        yield Finding("light", False, "the LED is off: spots command set led_mA=20")
    else:
        yield from _light(board, state, reading_s)
    board.command("stream off")
    share = missed / (missed + count * state["average"])
    yield _missed(state["exposure_us"], share) if share > _MISSED else _rate(spectra, reading_s)
    hello = board.command("hello")
    step = next_step(hello)
    text = f"not yet; {step}" if step else f"for {hello['length_um'] / 1000:g} mm"
    yield Finding("calibrated", True, text)


def _spectra(board: Board, seconds: float) -> Iterator[Spectrum]:
    return (frame for frame in board.frames(seconds) if isinstance(frame, Spectrum))


def _light(board: Board, state: Get, reading_s: float) -> Iterator[Finding]:
    full_scale = state["full_scale"]
    try:
        light, brightest = _lit(board, reading_s)
    except SpotsError as error:  # an LED that is always on has no dark frame yet
        yield Finding("light", False, str(error))
        return
    if light < _DIM * full_scale:
        text = f"none yet: press firmly near the sensor within {_PRESS_WITHIN_S:.0f} s, and hold"
        yield Finding("light", True, text)
        end_s = board.now_s() + _PRESS_WITHIN_S
        while light < _DIM * full_scale and board.now_s() < end_s:
            light, brightest = _lit(board, reading_s)
    text = f"{100 * max(light, 0) / full_scale:.1f} % of full scale are the LED's"
    if light < _DIM * full_scale:
        text += ": press firmly and run spots command auto, or check the LED's wires"
        yield Finding("light", False, text + _WIRES.get(state["led"], ""))
    elif brightest > _BRIGHTEST * full_scale:
        yield Finding("light", False, text + ": press at the sensor's end, spots command auto")
    else:
        yield Finding("light", True, text)


def _lit(board: Board, reading_s: float) -> tuple[float, int]:
    """Return the counts that the LED adds in the best channel, and the largest raw count.

    The room's light changes, and a press guides it, too. So what counts as the LED's is only what
    every lit sample has more than the dark frames before and after it.
    """
    before = board.command("dark", timeout_s=_DARK_TIMEOUT_S)["dark"]
    begun_s = board.now_s() + reading_s / 2
    lit = (
        spectrum.counts
        for spectrum in _spectra(board, 1 + 3 * _LIT * reading_s)
        if spectrum.time_s >= begun_s and not spectrum.flags & decode.LED_OFF
    )
    samples = list(islice(lit, _LIT))
    after = board.command("dark", timeout_s=_DARK_TIMEOUT_S)["dark"]
    if not samples:
        return 0, 0
    dark = [max(pair) / decode.DARK_SAMPLES for pair in zip(before, after)]
    least = map(min, zip(*samples))
    return max(lit - dark for lit, dark in zip(least, dark)), max(map(max, samples))


def _missed(exposure_us: int, share: float) -> Finding:
    # What the board needs for a sample, and a little more.
    longer_us = 100 * math.ceil(0.011 * exposure_us / (1 - share))
    text = f"the board misses {share:.0%} of the sensor's samples: spots command set "
    return Finding("rate", False, f"{text}exposure_us={longer_us}")


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
