"""Checks of ``spots doctor`` with a press: drift, and the error at a known place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spots_device.reading.decode import LED_OFF, MISFIT, NOT_CALIBRATED, SATURATED, TOO_DARK

from ..advice.notice import WRONG_UM, cause_of, notice_for
from ..link.board import Board
from ..link.frames import Spectrum, Touch
from ..link.replies import Get
from ..link.stored import stored_calibration
from .finding import Finding

_FOR_S = 1.0  # duration of the readings, at least `_READINGS`
_READINGS = 8
_SURE = 4.0  # standard deviations by which an error must exceed 0
_NET_MIN = 20.0  # counts; a channel with less light is mostly noise
_WITHIN_S = 10.0  # for a person to press the mark
_BOTH = "stream touch spectrum"
_SETTLING = 5  # readings while the force rises


def fit(board: Board, state: Get, dark: Sequence[float]) -> Finding | None:
    """Check whether the present press fits the calibration; None without a calibration.

    The board streams spectra. `dark` are counts with the LED off.
    """
    board.command(_BOTH)
    pairs = _pairs(board, state)
    board.command("stream spectrum")
    flags = [touch.flags for touch, _ in pairs]
    if not pairs or all(one & NOT_CALIBRATED for one in flags):
        return None
    notice = notice_for(stored_calibration(board, board.command("hello")), state)
    net = np.array([spectrum.counts for _, spectrum in pairs], float) - dark
    place_um = np.array([touch.position_um for touch, _ in pairs])
    good = (net >= _NET_MIN).all(axis=1) & np.isfinite(place_um)
    found = notice and good.sum() > 1 and notice.estimate(place_um[good], net[good])
    error_um, sigma_um = (abs(found[0][-1]), found[1][-1]) if found else (0.0, 0.0)
    rezero = "to correct a drift of the strip, run 'spots rezero'"
    if found and error_um > max(WRONG_UM, _SURE * sigma_um):
        wrong = f"positions are probably wrong by {error_um / 1000:.1f} mm"
        text = f"{wrong}, the probable cause is {cause_of(found[0])}; {rezero}"
        return Finding("fit", False, text)
    if all(one & MISFIT for one in flags):
        return Finding("fit", False, f"the press does not fit the calibration; {rezero}")
    if all(one & TOO_DARK for one in flags):
        return Finding("fit", False, "the press is too dark for the calibration: press firmly")
    if not found:
        return None
    text = "the press fits the calibration; a change of the dye needs a check with --mark"
    return Finding("fit", True, text)


def at_mark(board: Board, state: Get, mark_mm: float) -> Finding:
    """Compare the position of a press with its known distance from the strip's end at the sensor.

    At the end, the board streams nothing.
    """
    board.command(_BOTH)
    end_s = board.now_s() + _WITHIN_S
    for touch in board.touches(_WITHIN_S):
        if touch.touching or board.now_s() >= end_s:
            break
    pairs = _pairs(board, state)
    board.command("stream off")
    places_um = [touch.position_um for touch, _ in pairs if touch.touching][_SETTLING:]
    if not places_um:
        return Finding("mark", False, f"no press at {mark_mm:g} mm: run the command again")
    read_mm = float(np.mean(places_um)) / 1000
    error_mm = read_mm - mark_mm
    text = f"the press at {mark_mm:g} mm is measured at {read_mm:.2f} mm: {error_mm:+.2f} mm"
    if abs(error_mm) <= WRONG_UM / 1000:
        return Finding("mark", True, text)
    more = "press the mark again, and if the error stays, run 'spots rezero'"
    return Finding("mark", False, f"{text}; {more}")


def _pairs(board: Board, state: Get) -> list[tuple[Touch, Spectrum]]:
    """Return readings with the LED on, each with its spectrum."""
    reading_s = 1e-6 * state["exposure_us"] * state["average"]
    begun_s, touch = board.now_s(), None
    pairs: list[tuple[Touch, Spectrum]] = []
    for frame in board.frames(max(_FOR_S, 3 * _READINGS * reading_s)):
        if (frame.time_s or 0.0) < begun_s + reading_s / 2:
            continue
        if isinstance(frame, Touch):
            touch = frame
        elif isinstance(frame, Spectrum) and touch is not None and touch.t_us == frame.t_us:
            if not frame.flags & (LED_OFF | SATURATED):
                pairs.append((touch, frame))
            if len(pairs) >= max(_READINGS, round(_FOR_S / reading_s)):
                break
    return pairs
