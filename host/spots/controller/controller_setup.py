"""``spots controller --calibrate``: measures five touches and writes a settings file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from statistics import median

import msgspec

from ..errors import SpotsError, printable
from ..link.board import Board
from ..link.calibrated import length_of
from ..link.frames import Touch
from .controller_settings import DEFAULT, ControllerSettings, ForceAxis, PositionAxis, load, save

_HELD_S = 1.0  # how long a touch is looked at
_SETTLE_S = 0.3  # and from when on
_WAIT_S = 60.0
_LIFTED_S = 0.1
_RATIO_LEAST = 1.5
_APART_PERCENT = 5.0

_STEPS = {
    "rest": "put a finger where the stick's middle shall be, and hold it",
    "near": "now where its end towards the sensor shall be, and hold it",
    "far": "now where its other end shall be, and hold it",
    "light": "touch as lightly as you do without meaning anything, and hold it",
    "hard": "press as hard as you want to for all, and hold it",
}


def set_up(board: Board, path: str | Path, say: Callable[[str], None] = print) -> None:
    """Measure rest and ends of all axes of a settings file, and write it.

    Parameters
    ----------
    board : Board
        With a calibration.
    path : str or Path
        A file that exists keeps all but its comments and what is measured; a new one starts
        from the default.
    say : callable
        Called with each line for the user.

    Raises
    ------
    SpotsError
        If no touch comes in time, or the touches do not make a stick. Nothing is written then.
    """
    there, shown = Path(path).exists(), printable(str(path))
    settings = load(path if there else DEFAULT)
    length_um = length_of(board)
    board.command("stream touch")
    if there:
        say(f"{shown} keeps what is not measured, but not its comments")
    found = {}
    for step, words in _STEPS.items():
        say(words)
        found[step] = _touch(board)
        say("  good, lift it")
        _lift(board)
    percent = {step: round(touch.position_um / length_um * 100, 1) for step, touch in found.items()}
    force_mN = {step: touch.force_mN for step, touch in found.items()}
    save(_measured(settings, percent, force_mN), path)
    say(f"wrote {shown}; play with: spots controller --settings {shown}")


def _measured(settings: ControllerSettings, percent: dict, force_mN: dict) -> ControllerSettings:
    low, high = sorted((percent["near"], percent["far"]))
    rest = percent["rest"]
    if not (low + _APART_PERCENT <= rest <= high - _APART_PERCENT):
        raise SpotsError(
            f"the middle was pressed at {rest:g} % of the strip, the ends at {low:g} % and "
            f"{high:g} %; the middle must be at least {_APART_PERCENT:g} % inside both: try again"
        )
    if force_mN["hard"] < _RATIO_LEAST * force_mN["light"]:
        raise SpotsError(
            f"the hard press of {force_mN['hard']} mN has to be {_RATIO_LEAST:g} times the light "
            f"one of {force_mN['light']} mN: try again"
        )
    changes = {
        PositionAxis: {"rest_percent": rest, "min_percent": low, "max_percent": high},
        ForceAxis: {"rest_mN": force_mN["light"], "max_mN": force_mN["hard"]},
    }
    axes = {name: axis for name in "xyz" if (axis := getattr(settings, name)) is not None}
    for name, axis in axes.items():
        axes[name] = msgspec.structs.replace(axis, **changes[type(axis)])
    return msgspec.structs.replace(settings, **axes)


def _touch(board: Board) -> Touch:
    """Return the median of a touch that is held."""
    readings: list[Touch] = []
    for touch in _readings(board, "no touch was held"):
        if not touch.trusted:
            readings.clear()
            continue
        readings.append(touch)
        if touch.time_s - readings[0].time_s >= _SETTLE_S + _HELD_S:
            break
    steady = [one for one in readings if one.time_s - readings[0].time_s >= _SETTLE_S]
    return steady[0]._replace(
        position_um=median(one.position_um for one in steady),
        force_mN=round(median(one.force_mN for one in steady)),
    )


def _lift(board: Board) -> None:
    away_s = None
    for touch in _readings(board, "the finger was not lifted"):
        if touch.touching:
            away_s = None
        elif away_s is None:
            away_s = touch.time_s
        elif touch.time_s - away_s >= _LIFTED_S:
            return


def _readings(board: Board, what: str):
    for frame in board.frames(_WAIT_S):
        if isinstance(frame, Touch) and frame.sensor == 0:
            yield frame
    raise SpotsError(f"{what} within {_WAIT_S:g} s: nothing was written, try again")
