"""Measures, stores and fits the points of a linkage's kinematic calibration."""

import csv
import io
import math
import os
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from spots.common import (
    atomic,
    kinds,
    locks,
    typed_ahead,
)
from spots.common.bounded import (
    POINTS_MAX_BYTES,
    encoding_of,
    read_bytes,
    read_text,
)
from spots.common.toml import finite
from spots.errors import CalibrationError, FileError, SpotsError, printable

from . import mounted
from .encoder import Angle, Encoder
from .kinematics import calibrate
from .twin_source import Source

# Columns of a table of points: position, angles of the joints, standard errors of the angles.
COLUMNS = ("x_mm", "y_mm", "joint1_deg", "joint2_deg", "sigma1_deg", "sigma2_deg")
LASTS_S = 1.0  # duration of the measurement of a point
_MISFIT_MAX = 5.0  # multiple of the expected error, above which a linkage is not stored
_OUTLIERS_MAX = 0.2  # largest share of points that may not fit
_METRES = 0.01  # positions are in metres if they are below this share of the longest bar
_WAIT_S = 5.0  # longest wait for another program that appends a point
_LEAST = 3  # least number of angles of each joint


def fit(points: Path, linkage: Path, place_sigma_mm: float, out: Path | None) -> str:
    """Fit a linkage to measured points, write a linkage file to `out` if given, return a report.

    The table has the columns `COLUMNS`: measured position of the end point in any fixed coordinate
    frame, calibrated angles without offset and gain of the mounting, and standard errors of the
    angles. `linkage` has the nominal lengths and mounting. `place_sigma_mm` is the standard error
    of each measured coordinate. CalibrationError or FileError if a file is wrong, `out` would
    replace a file of another kind, there are too few points, or no linkage near the nominal one
    fits them.
    """
    drawn = mounted.load(linkage)
    calibrations = [linkage.parent / joint.calibration for joint in drawn.joint]
    before = out and mounted.KIND.present(out)
    rows, lines = _read(points)
    x_mm, y_mm, *angles_deg = rows.T
    far_mm = np.abs(rows[:, :2]).max(initial=0.0)
    if 0 < far_mm < _METRES * max(drawn.bar_mm):
        raise FileError(
            f"{points}: x_mm and y_mm are at most {far_mm:.3g} mm, but the longest bar has "
            f"{max(drawn.bar_mm):g} mm: give the positions in mm, not in metres",
            points,
        )
    angles, sigmas = np.radians(angles_deg[:2]), np.radians(angles_deg[2:])
    names = [_relative(path, (out or linkage).parent) for path in calibrations]
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
        known = drawn.found(found, names)
    except SpotsError as error:
        raise FileError(f"{points}: {error}", points) from None
    check = (
        "nothing was written: check the lengths and gains in the linkage file and the positions of "
        "the points, or give their error with --place-sigma-mm"
    )
    if found.misfit > _MISFIT_MAX:
        raise CalibrationError(
            f"{points}: the fitted linkage misses the points by {found.residual_rms_mm:.3g} mm "
            f"rms, {found.misfit:.0f} times the error that is expected; {check}"
        )
    if len(found.outliers) > _OUTLIERS_MAX * len(lines):
        raise CalibrationError(
            f"{points}: {len(found.outliers)} of {len(lines)} points do not fit, the first in line "
            f"{lines[found.outliers[0]]}; {check}"
        )
    found = replace(found, outliers=tuple(lines[i] for i in found.outliers))
    number = f"a point's number is its line in {printable(str(points))}"
    report = f"from {len(lines)} points; {number}\n{found.report()}"
    if out is None:
        return f"{report}\nnothing was written: add --out arm.toml to write a linkage file"
    mounted.save(known, out, before, report)
    return f"{report}\nwrote the linkage file {printable(str(out))}"


def _ask(question: str) -> str:
    typed_ahead.drop()
    return input(question)


def measure(source: Source, points: Path, ask: Callable[[str], str] = _ask, say=print) -> int:
    """Measure points of a kinematic calibration, append them to a table, and return their number.

    For each point, the user types the end point's position, and the joint angles are measured. An
    empty line ends the measurement. An existing table is continued. FileError if it is invalid or
    cannot be written.
    """
    count = len(_read(points)[0]) if points.exists() else 0
    while True:
        words = ask(f"{count} points. x and y of the end point in mm (empty line ends): ").split()
        if not words:
            return count
        try:
            x_mm, y_mm = map(finite, words)
        except ValueError:
            say("type two numbers in mm, such as: 40 150")
            continue
        try:
            joints = [np.degrees(mean_angle(angles)) for angles in _angles(source)]
        except SpotsError as error:
            say(str(error))
            continue
        row = x_mm, y_mm, *(joint[0] for joint in joints), *(joint[1] for joint in joints)
        _append(points, row)
        count += 1
        measured = ", ".join(f"{angle:.3f} +- {sigma:.3f} deg" for angle, sigma in joints)
        say(f"joints at {measured}")


def _angles(source: Source) -> list[list[Angle]]:
    encoders = [Encoder(encoder.joint) for encoder in source.twin.encoders]
    angles: list[list[Angle]] = [[], []]
    since_s = source.boards[0].now_s()
    for joint, touch in source.readings(LASTS_S):
        # Older readings were measured at another position.
        angle = encoders[joint].take(touch) if touch.time_s >= since_s else None
        if angle is not None:
            angles[joint].append(angle)
    for number, found in enumerate(angles, 1):
        if len(found) < _LEAST:
            raise CalibrationError(
                f"joint {number} gave {len(found)} angles in {LASTS_S:g} s, but {_LEAST} are "
                "needed: check that its indenter presses the strip, and that the board is fast "
                "enough"
            )
    return angles


def mean_angle(angles: list[Angle]) -> tuple[float, float]:
    """Return the mean angle of a joint at rest, and the standard error of this mean, in rad.

    `angles` are one or more angles of this joint, in order of time.
    """
    last = angles[-1]
    noise2 = max(last.sigma_rad**2 - last.systematic_rad**2, 0.0) / len(angles)
    mean_rad = sum(angle.angle_rad for angle in angles) / len(angles)
    return mean_rad, math.sqrt(noise2 + last.systematic_rad**2)


def _append(path: Path, row: Iterable[float]) -> None:
    """Append a point to a table, which may have other columns, too, in any order."""
    cells = dict(zip(COLUMNS, (f"{value:.5f}" for value in row)))
    try:
        with locks.held(path, _WAIT_S):
            data = read_bytes(path, POINTS_MAX_BYTES) if path.exists() else b""
            mark, encoding = encoding_of(data)
            text = data[len(mark) :].decode(encoding)
            names = next(csv.reader(io.StringIO(text)), [])
            added = io.StringIO(newline="")
            table = csv.writer(added)
            if not names:
                table.writerow(names := COLUMNS)
            elif missing := [name for name in COLUMNS if name not in names]:
                raise _no_columns(path, missing)
            elif not text.endswith("\n"):
                added.write("\r\n")  # some editors omit the end of the last line
            table.writerow(cells.get(name, "") for name in names)
            atomic.append(path, added.getvalue().encode(encoding))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise FileError(
            f"cannot write the file of points {path} ({reason}): the last point is not stored, all "
            "points before it are; make room, or name another file",
            path,
        ) from None


def _no_columns(path: Path, missing: list[str]) -> SpotsError:
    return FileError(
        f"{path} has no column {', '.join(missing)}: its first line must name the columns "
        f"{','.join(COLUMNS)}",
        path,
    )


def _read(path: Path) -> tuple[np.ndarray, list[int]]:
    """Read a table of n points; return an array, shape (n, 6), and the line number of each row."""
    try:
        text = read_text(path, POINTS_MAX_BYTES)
        table = csv.DictReader(io.StringIO(text))
        missing = [name for name in COLUMNS if name not in (table.fieldnames or ())]
        if missing:
            kinds.check(path, text, "a table of points")
            raise _no_columns(path, missing)
        rows, lines = [], []
        for row in table:
            rows.append([_number(path, table.line_num, name, row[name]) for name in COLUMNS])
            lines.append(table.line_num)
    except FileNotFoundError:
        raise FileError(
            f"there is no file {path}: make it with 'spots twin --linkage ARM.toml --measure "
            f"{path}'",
            path,
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise kinds.not_read(path, error, "a table of points") from None
    except csv.Error as error:
        raise FileError(
            f"cannot read {path} as a CSV table ({error}): name another file", path
        ) from None
    return np.array(rows, dtype=float).reshape(-1, len(COLUMNS)), lines


def _number(path: Path, line: int, name: str, text: str | None) -> float:
    try:
        value = finite(text or "")
    except ValueError:
        raise FileError(
            f"{path}, line {line}: {name} must be a number, not '{text or ''}'",
            path,
            f"line {line}",
        ) from None
    if name.startswith("sigma") and value <= 0:
        raise FileError(
            f"{path}, line {line}: {name}, a standard error, must be more than 0",
            path,
            f"line {line}",
        )
    return value


def _relative(path: Path, folder: Path) -> str:
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        return path.resolve().as_posix()  # on Windows, the file is on another drive
