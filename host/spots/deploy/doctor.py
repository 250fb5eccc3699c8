"""``spots doctor``: checks a board, its sensor, LED and calibration; prints remedies."""

import math
import os
import sys
from collections.abc import Callable, Iterator
from itertools import islice, pairwise
from typing import NamedTuple

from spots_device import __version__
from spots_device.reading import decode

from ..advice import lamps
from ..advice.calibrated import finger_missing, next_step, start_fault
from ..advice.key_exposure import sentence, shortest_us
from ..common import typed_ahead
from ..errors import AtPromptError, BoardError, SpotsError, printable
from ..link.board import Board
from ..link.connect import open as open_board
from ..link.frames import Spectrum
from ..link.ports import no_port, scheme_name
from ..link.replies import Get, Hello
from ..link.serial_link import SerialLink
from ..link.stored import stored_calibration, stored_layout
from .finding import Finding
from .place import on_port, restarted, the_board
from .press_check import at_mark, fit
from .prompt import Prompt

_SPECTRA = 12  # least number of spectra from which the rate is measured
# Readings with the LED on that are compared with the dark frames before and after them: at least
# `_LIT`, and for at least `_LIT_S` seconds, a mains period at 50 Hz.
_LIT = 4
_LIT_S = 0.02
# Time in s for a person to press the strip, which is dark without a press, or to unplug an LED.
_WITHIN_S = 10.0
_DIM = 0.01  # share of full scale; with less light, a position is mostly noise
_BRIGHTEST = 0.95  # share of full scale; with more light, a channel may saturate
# A channel that counts less than this while another one counts `_DIM` of full scale is dead. The
# dye leaves every channel more light than this.
_DEAD = 1.0
# Least rate, as a share of the highest possible rate: transfers and dark frames take time, too.
_SLOWEST = 0.7
_RATE_S = 0.5  # least duration of the spectra; the commands before and after take far less time
_MISSED = 0.15  # largest share of missed samples; commands and dark frames cause fewer
# What to check first if the LED gives no light, by the setting `led`.
_WIRES = {
    "ldr": "the wire from LDR to the LED's cathode",
    "gpio": "the wire to the board's STRIP_LED_PIN",
    "always": "the LED's supply; unplug the LED only when you are asked to",
}


def doctor(port: str | None = None, mark: float | None = None) -> None:
    """Check a board and print the result of each check; BoardError if one found a problem.

    `mark` is the place in mm of a press that is compared with its measured position.
    """
    problems = 0
    for check, ok, text in examine(port, mark):
        problems += not ok
        print(f"{'ok' if ok else 'problem':8} {check:10} {printable(text)}")
    if problems:
        raise BoardError(
            f"problems found: {problems}; follow the advice in the lines above", "problems"
        )


def examine(port: str | None = None, mark: float | None = None) -> Iterator[Finding]:
    """Check a port and its board; stop if no further check is possible."""
    check, advice = "port", ""
    try:
        if not scheme_name(port):
            port = port or the_board()[-1]
            if os.name == "posix" and not os.path.exists(port):
                yield Finding(check, False, no_port(port))
                return
            yield Finding(check, True, port)
            check = "permission"
            SerialLink(port).close()
            yield Finding(check, True, "the port can be opened")
            advice = "; to flash the board, run 'spots flash BOARD'"
        check = "hello"
        board = _opened(port)
    except SpotsError as error:
        more = "" if isinstance(error, AtPromptError) else advice
        yield Finding(check, False, f"{error}{more}")
        return
    with board:
        yield from examine_board(board, mark)


def _opened(port: str | None) -> Board:
    """Open a board; if it is at its prompt and the user agrees, restart its firmware first."""
    try:
        return open_board(port)
    except AtPromptError:
        if port is None or not sys.stdin.isatty():
            raise
        typed_ahead.drop()
        print(
            f"the board on {printable(port)} is at its Python prompt: restart its firmware? [y/N] ",
            end="",
            flush=True,
        )
        if sys.stdin.readline().strip().lower() not in ("y", "yes"):
            raise
    ports = on_port(port).ports  # before the restart, after which the port may have another name
    Prompt(port).reset()
    return restarted(ports)


def examine_board(board: Board, mark: float | None = None) -> Iterator[Finding]:
    """Check a board that answers."""
    yield Finding("hello", True, "{board}, {runtime}, id {id}".format(**board.info))
    text = firmware = board.info["firmware"]
    if firmware != __version__:
        text += f" on the board, {__version__} here: run 'spots flash {board.info['board']}'"
    yield Finding("firmware", firmware == __version__, text)
    if fault := start_fault(board.info):
        yield Finding("start", False, fault)
    state = board.command("get")
    if state["fault"] is not None:
        yield Finding("sensor", False, f"{state['fault']}: check SDA, SCL, power and ground")
        return
    yield Finding("sensor", True, "the sensor answers on the bus")
    board.command("stream spectrum")
    reading_s = 1e-6 * state["exposure_us"] * state["average"]
    count = max(_SPECTRA, round(_RATE_S / reading_s))
    missed = board.command("get")["missed"]
    begun_s = board.now_s()
    arrived = board.spectra(1 + 3 * count * reading_s)
    # Spectra from before may still wait in the host; the LED may have been off for all of them.
    spectra = list(islice((one for one in arrived if one.time_s >= begun_s), count))
    missed = max(0, board.command("get")["missed"] - missed)  # negative if the board restarted
    if state["led"] == "ldr" and not state["led_mA"]:
        yield Finding("light", False, "the LED is off: run 'spots command set led_mA=20'")
    else:
        yield from _light(board, state, reading_s)
    yield from _lamps(board, state)
    board.command("stream off")
    share = missed / (missed + count * state["average"])
    yield _missed(state["exposure_us"], share) if share > _MISSED else _rate(spectra, reading_s)
    hello = board.command("hello")
    step = next_step(hello)
    text = f"not yet; {step}" if step else f"a strip of {hello['length_um'] / 1000:g} mm"
    yield Finding("calibrated", True, text)
    if missing := finger_missing(hello):
        yield Finding("presser", False, missing)
    yield from _keys(board, hello)
    if mark is not None:
        yield from _mark(board, state, hello, mark)


def _keys(board: Board, hello: Hello) -> Iterator[Finding]:
    calibration = stored_calibration(board, hello) if hello["keys"] else None
    layout = stored_layout(board, hello) if calibration else None
    if calibration and layout is not None:
        chosen_us = shortest_us(calibration, layout, hello["strain_ppm"])
        exposure_us = hello["exposure_us"]
        ok = chosen_us is not None and exposure_us >= 0.99 * chosen_us
        yield Finding("keys", ok, sentence(exposure_us, chosen_us))


def _light(board: Board, state: Get, reading_s: float) -> Iterator[Finding]:
    full_scale = state["full_scale"]
    least = _DIM * full_scale
    try:
        lit = _led_light(board, reading_s)
    except SpotsError as error:  # an LED that is always on has no dark frame yet
        yield Finding("light", False, str(error))
        return
    if lit.light < least:
        text = f"no light yet: press firmly near the sensor within {_WITHIN_S:.0f} s, and hold"
        yield Finding("light", True, text)
        lit = _await(board, reading_s, lambda light: light >= least)
    light = lit.light
    yield from _channels(state, lit, light >= least)
    whole = light >= least and min(lit.net) >= _DEAD
    fits = fit(board, state, lit.dark) if whole else None
    if light >= least and state["led"] == "always":
        # The board cannot switch this LED, and a press also couples ambient light into the strip.
        text = (
            f"hold the press, and within {_WITHIN_S:.0f} s unplug the LED or cover the strip's end "
            "at the LED"
        )
        yield Finding("light", True, text)
        pressed = light
        light -= _await(board, reading_s, lambda light: light <= pressed / 2).light
    text = f"the LED gives {100 * max(light, 0) / full_scale:.1f} % of full scale"
    dim, bright = light < least, lit.peak > _BRIGHTEST * full_scale
    if dim:
        text += (
            f": press firmly and run 'spots command autoexpose', or check {_WIRES[state['led']]}"
        )
    elif bright:
        text += ": press at the sensor's end and run 'spots command autoexpose'"
    yield Finding("light", not dim and not bright, text)
    if fits:
        yield fits


def _mark(board: Board, state: Get, hello: Hello, mark_mm: float) -> Iterator[Finding]:
    length_um = hello["length_um"]
    if not length_um:
        yield Finding("mark", False, "a mark needs a calibration: run 'spots calibrate'")
    elif not 0 <= 1000 * mark_mm <= length_um:
        text = f"--mark {mark_mm:g} is not on the strip of {length_um / 1000:g} mm"
        yield Finding("mark", False, f"{text}: give a place from 0 to {length_um / 1000:g} mm")
    else:
        text = f"press at {mark_mm:g} mm from the sensor's end within 10 s, and hold for 2 s"
        yield Finding("mark", True, text)
        yield at_mark(board, state, mark_mm)


class _Light(NamedTuple):
    """Light of the LED, measured between two dark frames.

    `light` are the counts due to the LED in the channel where they are largest, `peak` is the
    largest raw count in any channel while the LED was on; both are 0 without a sample. `net` is the
    largest count of each channel due to the LED, `dark` its mean count with the LED off.
    """

    light: float
    peak: int
    net: list[float]
    dark: list[float]


def _channels(state: Get, lit: _Light, pressed: bool) -> Iterator[Finding]:
    """Yield a problem for each channel that is dead, or full without light.

    `pressed` is whether the LED gives light in any channel; only then a dead channel is seen.
    """
    for i, dark in enumerate(lit.dark):
        name = f"channel {state['channels'][i]} (ADC {i}) of the sensor"
        advice = "check the sensor's window and its solder joints, or replace the sensor"
        if dark > _BRIGHTEST * state["full_scale"]:
            text = f"{name} is at full scale although the LED is off: darken the strip, or {advice}"
            yield Finding("channels", False, text)
        elif pressed and lit.net[i] < _DEAD:
            text = f"{name} counts no light while another one counts {max(lit.net):.0f}: {advice}"
            yield Finding("channels", False, text)


def _await(board: Board, reading_s: float, done: Callable[[float], bool]) -> _Light:
    """Return what `_led_light` measures as soon as ``done(light)`` is true; after 10 s at most."""
    end_s = board.now_s() + _WITHIN_S
    while True:
        lit = _led_light(board, reading_s)
        if done(lit.light) or board.now_s() >= end_s:
            return lit


def _led_light(board: Board, reading_s: float) -> _Light:
    """Measure the light of the LED, by samples with the LED on between two dark frames.

    A press also couples ambient light into the strip, and ambient light changes. So for each
    channel, the larger one of the two dark counts is subtracted from the smallest count with the
    LED on.
    """
    before = board.command("dark")["dark"]
    begun_s = board.now_s() + reading_s / 2
    count = max(_LIT, round(_LIT_S / reading_s))
    lit = (
        spectrum
        for spectrum in board.spectra(1 + 3 * count * reading_s)
        if spectrum.time_s >= begun_s and not spectrum.flags & decode.LED_OFF
    )
    samples = list(islice(lit, count))
    after = board.command("dark")["dark"]
    dark = [max(pair) / decode.DARK_SAMPLES for pair in zip(before, after)]
    if not samples:
        return _Light(0, 0, [], dark)
    counts = [spectrum.counts for spectrum in samples]
    least, most = (map(one, zip(*counts)) for one in (min, max))
    net = [max(0.0, lit - off) for lit, off in zip(most, dark)]
    light = max(lit - off for lit, off in zip(least, dark))
    return _Light(light, max(map(max, counts)), net, dark)


def _lamps(board: Board, state: Get) -> Iterator[Finding]:
    mains_hz = state["mains_hz"]
    found_hz = lamps.mains_hz(board)
    text = f"lamps flicker at {2 * found_hz} Hz: " if found_hz else "no lamp flickers: "
    ok = found_hz in (0, mains_hz)
    advice = f"run 'spots command set mains_hz={found_hz}', then 'spots command save'"
    yield Finding("lamps", ok, text + (f"mains_hz={mains_hz}" if ok else advice))


def _missed(exposure_us: int, share: float) -> Finding:
    # The time in us that the board needs for a sample, plus 10 %, rounded up to 100 us.
    longer_us = 100 * math.ceil(0.011 * exposure_us / (1 - share))
    text = f"the board misses {share:.0%} of the sensor's samples: run 'spots command "
    return Finding("rate", False, f"{text}set exposure_us={longer_us}'")


def _rate(spectra: list[Spectrum], reading_s: float) -> Finding:
    if len(spectra) < 2:
        return Finding("rate", False, "too few spectra arrive: run 'spots command reboot'")
    # While the LED is off, a frame contains a single exposure, not the average of several.
    steps = list(pairwise(spectra))
    steps = [(a, b) for a, b in steps if not (a.flags | b.flags) & decode.LED_OFF] or steps
    # If a number is missing between two spectra, a spectrum may be lost on the link. Replies and
    # other frames have numbers, too.
    whole = [(a, b) for a, b in steps if (b.sequence - a.sequence) % (1 << 16) == 1]
    steps = whole or steps
    passed_us = sum((b.t_us - a.t_us) % (1 << 32) for a, b in steps)
    rate_hz, most_hz = len(steps) / passed_us * 1e6, 1 / reading_s
    text = f"{rate_hz:.1f} readings a second of {most_hz:.1f} that exposure and average allow"
    slow = rate_hz < _SLOWEST * most_hz
    advice = ": set a longer exposure_us, or a bus clock of 400 kHz" if slow else ""
    return Finding("rate", not slow, text + advice)
