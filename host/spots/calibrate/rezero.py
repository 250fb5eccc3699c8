"""``spots rezero``: the marks of a calibration pressed again, and its tables shifted to fit.

The file and the board change together at the end, or not at all.
"""

from __future__ import annotations

import argparse
from contextlib import suppress
from pathlib import Path

import msgspec
import numpy as np

from spots_device.calibration import Calibration
from spots_device.log2 import ONE as ONE_Q20

from ..errors import SpotsError
from ..link.connect import upload
from . import calibration_file as file
from .calibrate import opened
from .drift import described
from .guide import Guide
from .session import Wanted
from .shift import shifted
from .steps import DARK_S, Setup

_STRAY_UM = 1500.0  # from the other presses of a mark; people place a finger to 300 um
_STRAY_SHARE = 0.5  # of the distance to the next mark, whose press this is beyond that
_STRAYS = 5  # presses of a mark that may be asked for again


def rezero_command(options: argparse.Namespace) -> None:
    """Run ``spots rezero`` with the options that `cli` parsed."""
    path = Path(options.calibration)
    made = file.load(path)
    force_mN = options.force_N and 1000 * options.force_N
    with opened(options, made, path, Guide()) as setup:
        new = rezero(setup, made, options.presses, options.quick, force_mN, options.joint)
        setup.reader.give_back()
        name = use(setup, made, new)
        setup.guide.say(f"{path}: {new.rezeros[-1].drift}; the board stores calibration {name}")


def rezero(
    setup: Setup,
    made: file.CalibrationFile,
    presses: int = 1,
    quick: bool = False,
    force_mN: float | None = None,
    joint: bool = False,
) -> file.CalibrationFile:
    """Have the marks pressed and return the calibration that fits the strip now.

    Parameters
    ----------
    setup : Setup
        Nothing is written to its session or file.
    made : CalibrationFile
    presses : int
        Number of presses of each mark.
    quick : bool
        Whether to press the middle mark only; this corrects LED and filters, not the dye.
    force_mN : float, optional
        Force of each press in mN, read from a scale; the force is then corrected too.
    joint : bool
        Whether a joint presses the strip at its stops, not a person at the marks.

    Returns
    -------
    CalibrationFile

    Raises
    ------
    SpotsError
        If there are no marks, the board is another or set otherwise, or presses disagree.
    """
    marks = made.joint_marks if joint else made.marks
    if marks is None:
        again = "run 'spots calibrate joint' again" if joint else "calibrate again"
        raise SpotsError(
            f"{setup.out} has no [{'joint_' * joint}marks], so there is nothing to compare presses "
            f"with: {again}, which ends with three marks"
        )
    table = Calibration(made.lines)
    reason = table.mismatch(setup.reader.conditions, setup.reader.info.get("mains_hz", 0))
    if reason is not None:
        raise SpotsError(f"{setup.out}: {reason}")
    at = slice(1, 2) if quick else slice(None)
    place_um, logs = marks.place_um[at], np.array(marks.logs)
    angles_deg = marks.angle_deg or (None,) * len(logs)
    along = (logs[2] - logs[0]) / (marks.place_um[2] - marks.place_um[0])
    along = along - along.mean()  # colour per um
    um_per_log = along / (along @ along)
    limit_um = _STRAY_SHARE * (marks.place_um[1] - marks.place_um[0])
    force_now_mN = force_mN or marks.force_mN
    setup.guide.say("dark frames: touch nothing")
    setup.reader.set_up(dark_s=DARK_S)
    setup.taker.given_up = "nothing has changed"
    setup.guide.begin("re-zero", presses * len(place_um), table.conditions.plan, setup.length_um)
    shifts = np.array(
        [
            _pressed(
                setup,
                Wanted(kind="mark", place_um=x_um, force_mN=force_now_mN, angle_deg=angle_deg),
                log,
                um_per_log,
                presses,
                limit_um,
            )
            for x_um, log, angle_deg in zip(place_um, logs[at], angles_deg[at])
        ]
    )
    if force_mN is None:  # all channels alike is the force of the finger
        shifts -= shifts.mean(axis=1, keepdims=True)
    else:
        then_now_mN = [marks.force_mN, force_mN]
        then, now = np.interp(then_now_mN, table.forces_mN, table.brightnesses) / ONE_Q20
        longer = setup.reader.conditions.exposure_us / table.conditions.exposure_us
        shifts -= now - then + np.log2(longer)
    original = made.original or made.lines
    done = file.Rezero(
        date=file.now(),
        place_um=place_um,
        shifts=tuple(map(tuple, shifts.round(6).tolist())),
        drift=described(place_um, logs[at], shifts, table.conditions.plan),
    )
    lines = tuple(shifted(original, place_um, shifts))
    return msgspec.structs.replace(
        made, lines=lines, original=original, rezeros=[*made.rezeros, done]
    )


def use(setup: Setup, made: file.CalibrationFile, new: file.CalibrationFile) -> str:
    """Write a re-zeroed calibration to file and board.

    Parameters
    ----------
    setup : Setup
        The board, and the file's path.
    made : CalibrationFile
        The calibration before it.
    new : CalibrationFile
        The re-zeroed one.

    Returns
    -------
    str
        The new calibration's name, as ``hello`` reports it.

    Raises
    ------
    SpotsError
        If that fails; then file and board have the calibration `made`.
    """
    file.save(new, setup.out)
    try:
        return file.send(setup.reader.board, new)
    except BaseException:
        file.save(made, setup.out)
        with suppress(SpotsError):  # a board that is unplugged loads what it stores
            upload(setup.reader.board, made.lines)
        raise


def _pressed(setup: Setup, wanted: Wanted, log, um_per_log, presses: int, limit_um: float):
    """Return the mean shift of a mark over as many presses that agree."""
    found: list[np.ndarray] = []
    for _ in range(presses + _STRAYS):
        setup.guide.want(wanted)
        reading = setup.taker.take(wanted)
        if wanted.angle_deg is None:
            setup.taker.release()
        setup.guide.taken(wanted, reading)
        found.append(np.log2(reading.counts) - log)
        places_um = np.array(found) @ um_per_log
        good = np.abs(places_um) <= limit_um
        if len(found) == presses:
            good &= np.abs(places_um - np.median(places_um)) <= _STRAY_UM
        if not good.all():
            setup.guide.say(f"a press of {wanted} lies elsewhere: press this mark again")
            setup.guide.skip(-int((~good).sum()))
            found = [one for one, keep in zip(found, good) if keep]
        if len(found) == presses:
            return np.mean(found, axis=0)
    raise SpotsError(
        f"the presses of the mark at {wanted.place_um / 1000:.1f} mm disagree by more than "
        f"{_STRAY_UM / 1000:g} mm, or lie elsewhere: mark the place on the strip and run this "
        "again; nothing has changed"
    )
