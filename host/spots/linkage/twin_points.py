"""The points of a kinematic calibration: measured with a linkage, stored as a table, and fitted."""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np

from ..bounded import POINTS_MAX_BYTES, read_bytes, read_text
from ..errors import SpotsError, printable
from . import mounted
from .encoder import Angle, Encoder
from .kinematics import Kinematics, calibrate
from .twin_source import Source

COLUMNS = ("x_mm", "y_mm", "joint1_deg", "joint2_deg", "sigma1_deg", "sigma2_deg")
_LASTS_S = 1.0  # as long as a joint is read at each point
_LEAST = 3  # readings of each joint


def fit(points: Path, linkage: Path, place_sigma_mm: float, out: Path | None) -> str:
    """Find a linkage from points, write its file, and return a report.

    Parameters
    ----------
    points : Path
        A table with the columns `COLUMNS`: where the terminal was by a grid laid anyhow, and the
        joints there by their own calibrations.
    linkage : Path
        The linkage file as drawn.
    place_sigma_mm : float
        Standard error of a coordinate.
    out : Path or None
        The linkage file to write.

    Returns
    -------
    str

    Raises
    ------
    SpotsError
        If a file is wrong or would be replaced by `out`, or the points are too few or do not go
        together.
    """
    drawn = mounted.load(linkage)
    if out is not None:
        _spare(out, [points, *(linkage.parent / joint.calibration for joint in drawn.joint)])
    rows, lines = _read(points)
    x_mm, y_mm, *angles_deg = rows.T
    angles, sigmas = np.radians(angles_deg[:2]), np.radians(angles_deg[2:])
    try:
        found = calibrate(
            angles,
            x_mm,
            y_mm,
            drawn.linkage,
            angle_sigma_rad=sigmas,
            place_sigma_mm=place_sigma_mm,
            offset_rad=drawn.offset_rad,
            gain=drawn.gain,
        )
        known = drawn.found(found)
    except SpotsError as error:
        raise SpotsError(f"{points}: {error}") from None
    report = _report(found, points, lines)
    if out is None:
        return f"{report}\nnothing was written: --out arm.toml writes a linkage file"
    mounted.save(_moved(known, linkage, out), out, report)
    return f"{report}\n{printable(str(out))} holds this linkage"


def measure(source: Source, points: Path, ask: Callable[[str], str] = input, say=print) -> int:
    """Ask where the terminal is, read the joints there, add it to a table; until an empty line.

    Parameters
    ----------
    source : Source
    points : Path
        Is made, or goes on.
    ask : callable
        Given a question, returns the answer.
    say : callable
        Called with each line for the user.

    Returns
    -------
    int
        How many points the table has.

    Raises
    ------
    SpotsError
        If the table has other columns or cannot be written.
    """
    count = len(_read(points)[0]) if points.exists() else 0
    while True:
        words = ask(f"{count} points. x and y of the terminal in mm (nothing to end): ").split()
        if not words:
            return count
        try:
            x_mm, y_mm = map(float, words)
        except ValueError:
            x_mm = y_mm = math.nan
        if not (math.isfinite(x_mm) and math.isfinite(y_mm)):
            say("two numbers in mm, such as: 40 150")
            continue
        try:
            joints = [_mean(angles) for angles in _angles(source)]
        except SpotsError as error:
            say(str(error))
            continue
        row = x_mm, y_mm, *(joint[0] for joint in joints), *(joint[1] for joint in joints)
        _append(points, row)
        count += 1
        measured = ", ".join(f"{angle:.3f} +- {sigma:.3f} deg" for angle, sigma in joints)
        say(f"joints at {measured}")


def _spare(out: Path, kept: list[Path]) -> None:
    """Refuse to write over a file that cannot be had again from the linkage file."""
    for path in kept:
        if out.resolve() == path.resolve():
            raise SpotsError(f"--out {out} would replace {path}: name another file")


def _angles(source: Source) -> list[list[Angle]]:
    encoders = [Encoder(encoder.joint) for encoder in source.twin.encoders]
    angles: list[list[Angle]] = [[], []]
    since_s = source.boards[0].now_s()
    for joint, touch in source.readings(_LASTS_S):
        # Readings from before now are of another place.
        angle = encoders[joint].take(touch) if touch.time_s >= since_s else None
        if angle is not None:
            angles[joint].append(angle)
    for number, found in enumerate(angles, 1):
        if len(found) < _LEAST:
            raise SpotsError(f"joint {number} gives no angle: does its indenter press the strip?")
    return angles


def _mean(angles: list[Angle]) -> tuple[float, float]:
    """Return the mean of a joint at rest and its standard error, in degrees."""
    last = angles[-1]
    noise2 = max(last.sigma_rad**2 - last.systematic_rad**2, 0.0) / len(angles)
    mean_rad = sum(angle.angle_rad for angle in angles) / len(angles)
    return math.degrees(mean_rad), math.degrees(math.sqrt(noise2 + last.systematic_rad**2))


def _append(path: Path, row: Iterable[float]) -> None:
    try:
        new = not path.exists()
        # An editor may have left the last line without its end.
        cut_off = not new and not read_bytes(path, POINTS_MAX_BYTES).endswith(b"\n")
        with open(path, "a", encoding="utf-8", newline="") as file:
            table = csv.writer(file)
            if cut_off:
                file.write("\r\n")
            if new:
                table.writerow(COLUMNS)
            table.writerow(f"{value:.5f}" for value in row)
    except OSError as error:
        raise SpotsError(f"cannot write {path}: {error.strerror}") from None


def _read(path: Path) -> tuple[np.ndarray, list[int]]:
    """Return the points, a row each, and in which line of the file each stands."""
    try:
        text = read_text(path, POINTS_MAX_BYTES, "utf-8-sig")
        table = csv.DictReader(io.StringIO(text))
        missing = [name for name in COLUMNS if name not in (table.fieldnames or ())]
        if missing:
            raise SpotsError(
                f"{path} has no column {', '.join(missing)}: its first line names the columns, "
                f"{','.join(COLUMNS)}"
            )
        rows, lines = [], []
        for row in table:
            rows.append([_number(path, table.line_num, name, row[name]) for name in COLUMNS])
            lines.append(table.line_num)
    except FileNotFoundError:
        raise SpotsError(
            f"there is no file {path}: 'spots twin --linkage ARM.toml --measure {path}' makes it"
        ) from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise SpotsError(f"cannot read {path} as a table: {error}") from None
    return np.array(rows, dtype=float).reshape(-1, len(COLUMNS)), lines


def _number(path: Path, line: int, name: str, text: str | None) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise SpotsError(f"{path}, line {line}: {name} is a number, not '{text or ''}'")
    if name.startswith("sigma") and value <= 0:
        raise SpotsError(f"{path}, line {line}: {name} is a standard error, so more than 0")
    return value


def _report(found: Kinematics, points: Path, lines: list[int]) -> str:
    named = replace(found, outliers=tuple(lines[i] for i in found.outliers))
    text = f"from {len(lines)} points of {printable(str(points))}\n{named.report()}"
    return text.replace("places that do not fit:", "points that do not fit, by line of the file:")


def _moved(known: mounted.Mounted, old: Path, new: Path) -> mounted.Mounted:
    """Return the same for a file elsewhere: calibrations are named from where it is."""
    joints = [
        msgspec.structs.replace(
            joint,
            calibration=_relative(old.parent / joint.calibration, new.parent),
        )
        for joint in known.joint
    ]
    return msgspec.structs.replace(known, joint=joints)


def _relative(path: Path, folder: Path) -> str:
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        return path.resolve().as_posix()  # on another drive of Windows
