"""``spots controller --calibrate``: measures five touches to set the axes of a controller."""

import math
from collections.abc import Callable
from pathlib import Path
from statistics import median

import msgspec

from ..advice.calibrated import hello_calibrated
from ..common.signals import stop_explained
from ..errors import CalibrationError, printable
from ..link.board import Board
from ..link.frames import Touch
from .controller_settings import DEFAULT, ControllerSettings, ForceAxis, PositionAxis, load, save

_SETTLE_S = 0.3  # the start of a touch is not used
_HELD_S = 1.0  # duration of the measurement
_WAIT_S = 60.0  # longest wait for a touch or a lift
_LIFTED_S = 0.1  # duration of a lift
_RATIO_LEAST = 1.5  # least ratio of the hard press to the light press
_APART_PERCENT = 5.0  # least distance of the middle from each end, in % of the strip's length

_STEPS = {
    "rest": "hold a finger where the middle of the stick should be",
    "near": "now hold the finger at the end of the stick that is nearer to the sensor",
    "far": "now hold the finger at the other end of the stick",
    "light": "now touch the strip lightly, as if by accident, and hold the finger there",
    "hard": "now press as hard as for a full deflection, and hold the finger there",
}


def set_up(board: Board, path: str | Path, say: Callable[[str], None] = print) -> None:
    """Measure the rest position and the ends of all axes, and write them to a settings file.

    An existing file keeps its other settings, but loses its comments; a new file gets default
    values for all other settings. SpotsError if no steady touch or no lift follows within 60 s, the
    middle is not between the ends, the positions or forces of the touches are too similar, or the
    file has been changed in the meantime. Nothing is then written.
    """
    shown = printable(str(path))
    before = load(path) if Path(path).exists() else None
    settings = before or load(DEFAULT)
    length_um = hello_calibrated(board)["length_um"]
    board.command("stream touch")
    if before:
        say(f"{shown} keeps its other settings, but loses its comments")
    found = {}
    with stop_explained(lambda: "nothing is written; the same command begins again"):
        for step, words in _STEPS.items():
            say(words)
            found[step] = _touch(board)
            say("  done, lift the finger")
            _lift(board)
    percent = {step: round(touch.position_um / length_um * 100, 1) for step, touch in found.items()}
    force_mN = {step: touch.force_mN for step, touch in found.items()}
    save(_measured(settings, percent, force_mN), path, before)
    say(f"wrote {shown}; to play: spots controller --settings {shown}")


def _measured(settings: ControllerSettings, percent: dict, force_mN: dict) -> ControllerSettings:
    low, high = sorted((percent["near"], percent["far"]))
    rest = percent["rest"]
    if not (low + _APART_PERCENT <= rest <= high - _APART_PERCENT):
        raise CalibrationError(
            f"the middle is at {rest:g} % of the strip, but must be between the ends at {low:g} % "
            f"and {high:g} %, and at least {_APART_PERCENT:g} % from each: try again"
        )
    if force_mN["hard"] < _RATIO_LEAST * force_mN["light"]:
        raise CalibrationError(
            f"the hard press of {force_mN['hard']} mN must be at least {_RATIO_LEAST:g} times the "
            f"light press of {force_mN['light']} mN: try again"
        )
    changes = {
        PositionAxis: {"rest_percent": rest, "min_percent": low, "max_percent": high},
        ForceAxis: {"rest_mN": force_mN["light"], "max_mN": force_mN["hard"]},
    }
    axes = {
        name: msgspec.structs.replace(axis, **changes[type(axis)])
        for name in "xyz"
        if (axis := getattr(settings, name)) is not None
    }
    return msgspec.structs.replace(settings, **axes)


def _touch(board: Board) -> Touch:
    """Wait until a finger rests on the strip; return a reading with its median position and force.

    The medians leave out the readings of the first moment, in which the finger settles.
    """
    readings: list[Touch] = []
    for touch in _readings(board, "no touch was held"):
        readings = [*readings, touch] if touch.trusted else []
        if readings and touch.time_s - readings[0].time_s >= _SETTLE_S + _HELD_S:
            break
    steady = [one for one in readings if one.time_s - readings[0].time_s >= _SETTLE_S]
    return steady[0]._replace(
        position_um=median(one.position_um for one in steady),
        force_mN=round(median(one.force_mN for one in steady)),
    )


def _lift(board: Board) -> None:
    away_s = math.inf
    for touch in _readings(board, "the finger was not lifted"):
        away_s = math.inf if touch.touching else min(away_s, touch.time_s)
        if touch.time_s - away_s >= _LIFTED_S:
            return


def _readings(board: Board, what: str):
    for frame in board.frames(_WAIT_S):
        if isinstance(frame, Touch) and frame.sensor == 0:
            yield frame
    raise CalibrationError(f"{what} within {_WAIT_S:g} s: nothing was written, try again")
