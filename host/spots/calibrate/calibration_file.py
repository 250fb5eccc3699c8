"""The calibration file: the text lines that a board uses, and how they were measured.

Residuals are the errors of the board's positions and forces at the presses of the calibration.
Marks are positions that are pressed again for a re-zero (``spots rezero``), to measure and correct
drift. The file is TOML. The section ``[end]`` has a CRC-32 of all text before it, so that `load`
detects a file that was cut short or changed.
"""

from __future__ import annotations

import json
import re
import zlib
from datetime import datetime, timezone
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from spots_device.board.settings import checksum
from spots_device.reading.calibration import Calibration, Conditions
from spots_device.reading.calibration_lines import CalibrationError

from ..common import atomic, kinds, schema, toml
from ..common.bounded import read_text
from ..errors import FileError
from ..link.board import Board
from ..link.connect import ensured, upload
from .fit.points import Degrees, ExposureUs, ForceMN, Gain, LedMA, PlaceUm, Plan, Ppm, Sigma

VERSION = 1
_END = "[end]\n"
_AGAIN = "copy the file again, or make it again from its session with 'spots calibrate --session'"
_HEAD = f"""\
# The calibration of one SPOTS board, made by 'spots calibrate'.
version = {VERSION}
"""
_COMMENTS = {
    "lines": "# Calibration lines for the board, see docs/extend/files-on-the-board.md.",
    "original": "# Calibration lines before the first re-zero.",
    "joint": "# angle in degrees = zero_deg + deg_per_um * position in um",
    "marks": "# log2 of the counts of presses that 'spots rezero' repeats.",
    "joint_marks": "# log2 of the counts at three angles, which 'spots rezero --joint' repeats.",
}


_Logs = Annotated[
    tuple[Annotated[float, msgspec.Meta(ge=-100, le=100)], ...],
    msgspec.Meta(min_length=6, max_length=6),
]


Celsius = Annotated[float, msgspec.Meta(ge=-100, le=200)]
Presser = Literal["finger", "indenter"]
FINGER: Presser = "finger"
INDENTER: Presser = "indenter"


class Residual(toml.Strict, kw_only=True):
    """Errors of the board's positions and forces at the presses of the calibration, for one strain.

    Attributes
    ----------
    strain_ppm : int
        Strain of the strip: elongation over length at rest, in ppm.
    position_rms_um : float
        Root mean square error of the position, in um.
    force_rms_mN : float or None
        Root mean square error of the force, in mN; None for a stretched strip, and if the forces
        are unknown.
    presses : int
        Number of position errors, plus number of presses with a known force; a press can count in
        both.
    """

    strain_ppm: Ppm
    position_rms_um: Sigma
    force_rms_mN: Sigma | None = None
    presses: Annotated[int, msgspec.Meta(ge=0, le=1_000_000)]


class Joint(toml.Strict, kw_only=True):
    """A joint that moves an indenter along the strip: angle = zero_deg + deg_per_um * position.

    Attributes
    ----------
    zero_deg : float
        Angle at position 0, in degrees.
    deg_per_um : float
        Slope of the angle, in degrees per um of position.
    r2 : float
        R squared of this line for all measured points.
    resolution_deg : float
        Standard deviation of the angle while the joint does not move, in degrees.
    accuracy_deg : float
        Mean absolute error of the angle in degrees, at half of the points, if the line is fitted to
        the other half.
    backlash_deg : float
        Mean difference of the angle between the two directions of turning, in degrees.
    low, high : tuple of (float, float)
        Lowest and highest calibrated position in um, each with the standard deviation of the angle
        at this position, in degrees. Between these two positions, the logarithm of the standard
        deviation is linear in the position.
    """

    zero_deg: Degrees
    deg_per_um: Degrees
    r2: Annotated[float, msgspec.Meta(le=1)]
    resolution_deg: Sigma
    accuracy_deg: Sigma
    backlash_deg: Sigma
    low: tuple[PlaceUm, Sigma]
    high: tuple[PlaceUm, Sigma]


class Marks(toml.Strict, kw_only=True):
    """Reference presses at marked positions, which ``spots rezero`` repeats to measure drift.

    Attributes
    ----------
    place_um : tuple of float, length n
        Distances of the marks from the strip's end at the sensor in um, ascending; three or more.
    force_mN : float
        Force of each press in mN; 0 for a joint, whose indenter presses all the time.
    logs : tuple of tuple of float, shape (n, 6)
        log2 of the dark-subtracted counts; one row for each mark, one column for each channel.
    angle_deg : tuple of float, length n, or None
        Angles of the joint at the marks, in degrees; None for marks that a person presses.
    """

    place_um: Annotated[tuple[PlaceUm, ...], msgspec.Meta(min_length=3, max_length=99)]
    force_mN: ForceMN
    logs: tuple[_Logs, ...]
    angle_deg: tuple[Degrees, ...] | None = None

    def __post_init__(self):
        if sorted({*self.place_um}) != [*self.place_um]:
            raise ValueError("the places of the marks must ascend")
        if {len(self.logs), len(self.angle_deg or self.logs)} != {len(self.place_um)}:
            raise ValueError("each mark needs its own logs, and its angle if others have one")


class Rezero(toml.Strict, kw_only=True):
    """Result of a re-zero (``spots rezero``): the drift that presses at the marks showed.

    Attributes
    ----------
    date : datetime
        Date and time in UTC.
    place_um : tuple of float, length n
        Distances of the n pressed marks from the strip's end at the sensor, in um.
    shifts : tuple of tuple of float, shape (n, 6)
        log2 of the counts at the re-zero minus log2 of the counts at the calibration, corrected for
        errors of force and position of the presses. Rows are marks, columns are channels.
    drift : str
        Description of the drift, for example ``dye 1.9 % paler``.
    presser : {"finger", "indenter"} or None
        What pressed the marks; None if it is unknown.
    temperature_C : float or None
        Temperature of the board in degrees Celsius; None if the board cannot measure it.
    """

    date: datetime
    place_um: tuple[PlaceUm, ...]
    shifts: tuple[_Logs, ...]
    drift: str
    presser: Presser | None = None
    temperature_C: Celsius | None = None


class CalibrationFile(toml.Strict, kw_only=True):
    """Content of a calibration file.

    Attributes
    ----------
    date : datetime
        Date and time of the calibration in UTC.
    board, plan, gain, exposure_us, led_mA
        Board and settings of the calibration; `plan` is the choice of the six channels. See
        `spots_device.reading.calibration.Conditions`.
    presser : {"finger", "indenter"} or None
        What pressed the strip for the calibration; None if it is unknown.
    lines : tuple of str
        Calibration lines that the board uses, see `spots_device.reading.calibration_lines`. Their
        line ``presser`` names for what they are: a finger or an indenter.
    original : tuple of str
        Calibration lines before the first re-zero; empty if there was no re-zero.
    residuals : list of Residual
        Errors at the presses of the calibration, one entry for each strain.
    joint : Joint or None
        Calibration of the joint; None without a joint.
    marks : Marks or None
        Marks for ``spots rezero``; None if the session has no presses at the marks.
    joint_marks : Marks or None
        Marks at the lowest, a middle and the highest angle of the joint; None without a joint.
    rezeros : list of Rezero
        All re-zeros, oldest first. `lines` contains the correction of the last re-zero with one
        presser only, see `pressers.used_by`.
    """

    date: datetime
    board: str
    plan: Plan
    gain: Gain
    exposure_us: ExposureUs
    led_mA: LedMA
    presser: Presser | None = None
    lines: tuple[str, ...]
    original: tuple[str, ...] = ()
    residuals: list[Residual] = []
    joint: Joint | None = None
    marks: Marks | None = None
    joint_marks: Marks | None = None
    rezeros: list[Rezero] = []

    @property
    def length_um(self) -> float:
        """Length of the strip at rest, in um."""
        return Calibration(self.lines).length_um

    @property
    def conditions(self) -> Conditions:
        """Board and settings of the calibration."""
        return Conditions(self.board, self.plan, self.gain, self.exposure_us, self.led_mA)


def now() -> datetime:
    """Return the current time in UTC, in whole seconds."""
    return datetime.now(timezone.utc).replace(microsecond=0)


def save(calibration: CalibrationFile, path: Path, before: CalibrationFile | None) -> None:
    """Create or replace a calibration file atomically.

    Parameters
    ----------
    calibration : CalibrationFile
        Content of the file.
    path : Path
        Name of the file.
    before : CalibrationFile or None
        Calibration that the file must still contain, and on which `calibration` is based; None if
        the file did not exist.

    Raises
    ------
    SpotsError
        If the file cannot be written, or contains something else than `before`. An existing file is
        unchanged.
    """
    text = _text(calibration)
    text = f'{text}{_END}crc32 = "{_crc32(text)}"\n'
    atomic.write_text(text, path, KIND, was=before)


def load(path: Path) -> CalibrationFile:
    """Read a calibration file and validate its content.

    Parameters
    ----------
    path : Path
        Name of the file.

    Returns
    -------
    CalibrationFile

    Raises
    ------
    FileError
        If the file cannot be read, is cut short or was changed, has another version, or has no
        valid calibration.
    """
    try:
        text = read_text(path)
    except FileNotFoundError:
        raise FileError(
            f"there is no file {path}: change to its folder, or make it with 'spots calibrate'",
            path,
        ) from None
    except UnicodeDecodeError as error:
        kinds.check(path, error.object, "a calibration file")
        raise FileError(f"{path} is damaged: {_AGAIN}", path) from None
    except OSError as error:
        raise kinds.not_read(path, error, "a calibration file") from None
    version = re.search(r"^version = (\d+)$", text, re.MULTILINE)
    if version and version[1] != str(VERSION):
        raise FileError(
            f"{path} has format version {version[1]}, but this program reads version {VERSION}: "
            "update this program, or calibrate again",
            path,
        )
    body, _, tail = text.partition(_END)
    found = re.fullmatch(r'crc32 = "([0-9a-f]{8})"\n?', tail)
    if found is None:
        kinds.check(path, text, "a calibration file")
    if found is None and len(tail) < len('crc32 = "00000000"'):
        raise FileError(f"{path} is cut short, or is not a calibration file: {_AGAIN}", path)
    if found is None or found[1] != _crc32(body):
        raise FileError(f"{path} was changed after it was written (wrong checksum): {_AGAIN}", path)
    return _checked(path, body)


KIND = atomic.Kind("a calibration file", load)


def send(board: Board, calibration: CalibrationFile) -> str:
    """Upload a calibration to a board, and store the calibration on the board.

    Parameters
    ----------
    board : Board
        The board; its settings must be those of the calibration.
    calibration : CalibrationFile
        The calibration to upload.

    Returns
    -------
    str
        Checksum of the calibration, as the board's command ``hello`` reports it.

    Raises
    ------
    SpotsError
        If the calibration was made on another board or at other settings. The board is unchanged.
    """
    upload(board, calibration.lines)
    ensured(board, "save")
    return checksum(list(calibration.lines))


def _crc32(text: str) -> str:
    return f"{zlib.crc32(text.encode()):08x}"


def _checked(path: Path, body: str) -> CalibrationFile:
    try:
        content = toml.loads(body)
        content.pop("version")
        found = schema.convert(content, CalibrationFile)
        made = Calibration(found.lines)
        if found.original:
            Calibration(found.original)
    except (msgspec.ValidationError, CalibrationError, KeyError) as error:
        raise FileError(f"{path} is not a calibration ({error}): {_AGAIN}", path) from None
    if made.conditions != found.conditions:
        raise FileError(
            f"the calibration lines in {path} do not match its settings: {_AGAIN}", path
        )
    return found


def _text(calibration: CalibrationFile) -> str:
    """Return the text of the calibration file without its section ``[end]``."""
    rows = []
    for name, value in msgspec.to_builtins(calibration, builtin_types=(datetime,)).items():
        if value in (None, [], ()):
            continue
        if name in ("lines", "original"):
            lines = [f"  {json.dumps(line)}," for line in value]
            rows += [_COMMENTS[name], f"{name} = [", *lines, "]"]
        else:
            rows.append(toml.dumps({name: value}, comments=_COMMENTS))
    return _HEAD + "\n".join([*rows, "", ""])
