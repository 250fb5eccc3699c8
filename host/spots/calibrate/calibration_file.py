"""The calibration file: the board's lines, their residuals, and what they were made with.

TOML, readable by people. A CRC-32 of all text before the section ``[end]`` detects a file that was
cut short or changed.
"""

from __future__ import annotations

import json
import re
import zlib
from datetime import datetime, timezone
from pathlib import Path

import msgspec

from spots_device.calibration import Calibration, CalibrationError, Conditions
from spots_device.settings import checksum

from .. import atomic, toml
from ..bounded import read_text
from ..errors import SpotsError
from ..link.board import Board
from ..link.connect import upload
from .session import Six

VERSION = 1
_END = "[end]\n"
_AGAIN = "copy it again, or run 'spots calibrate' with its session to make it again"


class _Struct(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    pass


class Residual(_Struct, kw_only=True):
    """How far the calibrated board is off at the presses that it was calibrated with.

    Attributes
    ----------
    strain_ppm : int
        Elongation over length at rest, in millionths.
    position_rms_um : float
        Root mean square error of the position, in um.
    force_rms_mN : float or None
        None for a stretched strip: forces are varied at rest only.
    presses : int
        Number of presses.
    """

    strain_ppm: int
    position_rms_um: float
    force_rms_mN: float | None = None
    presses: int


class Joint(_Struct, kw_only=True):
    """A joint that moves an indenter along the strip: angle = zero + deg_per_um * position.

    Attributes
    ----------
    zero_deg, deg_per_um : float
    r2 : float
        R squared of the straight line.
    resolution_deg : float
        Standard deviation of a reading at rest.
    accuracy_deg : float
        Mean absolute error at angles that the line was not made with.
    backlash_deg : float
        Between the two directions.
    low, high : tuple of (float, float) or None
        The lowest and the highest position (um) that it was turned through, and the standard
        deviation (degrees) of a reading there; between the two its logarithm is a straight line.
    """

    zero_deg: float
    deg_per_um: float
    r2: float
    resolution_deg: float
    accuracy_deg: float
    backlash_deg: float
    low: tuple[float, float] | None = None
    high: tuple[float, float] | None = None


class Marks(_Struct, kw_only=True):
    """Presses of a calibration that a re-zero repeats.

    Attributes
    ----------
    place_um : tuple of float, length 3
        Distance of each mark from the sensor's end, ascending.
    force_mN : float
        Force of each press; 0 for a joint, whose indenter always presses.
    logs : tuple, shape (3, 6)
        log2 of each channel's dark-subtracted counts.
    angle_deg : tuple of float, length 3, or None
        Angles at which a joint presses the marks.
    """

    place_um: tuple[float, float, float]
    force_mN: float
    logs: tuple[Six, Six, Six]
    angle_deg: tuple[float, float, float] | None = None


class Rezero(_Struct, kw_only=True):
    """A re-zero: what the marks' logs had become, less what they were.

    Attributes
    ----------
    date : datetime
        UTC.
    place_um : tuple of float
    shifts : tuple, shape (n, 6)
    drift : str
        Description of the drift, for example ``dye 1.9 % paler``.
    """

    date: datetime
    place_um: tuple[float, ...]
    shifts: tuple[Six, ...]
    drift: str


class CalibrationFile(_Struct, kw_only=True):
    """A calibration, as the file holds it.

    Attributes
    ----------
    date : datetime
        UTC.
    board, plan, gain, exposure_us, led_mA
        See `spots_device.calibration.Conditions`.
    residuals : list of Residual
        One for each strain.
    joint : Joint or None
    lines : tuple of str
        The board's, see `spots_device.calibration`.
    marks : Marks or None
    joint_marks : Marks or None
        End stops and a middle stop of the joint.
    rezeros : list of Rezero
        The last one gave `lines`.
    original : tuple of str
        Lines as calibrated; empty before the first re-zero.
    """

    date: datetime
    board: str
    plan: tuple[str, ...]
    gain: int
    exposure_us: int
    led_mA: int
    residuals: list[Residual] = []
    joint: Joint | None = None
    lines: tuple[str, ...]
    marks: Marks | None = None
    joint_marks: Marks | None = None
    rezeros: list[Rezero] = []
    original: tuple[str, ...] = ()

    @property
    def length_um(self) -> float:
        """Length of the strip at rest."""
        return Calibration(self.lines).length_um

    @property
    def conditions(self) -> Conditions:
        """What it was made with."""
        return Conditions(self.board, self.plan, self.gain, self.exposure_us, self.led_mA)

    @classmethod
    def now(cls, conditions: Conditions, lines, residuals, joint=None, **others):
        """Return a calibration dated now.

        Parameters
        ----------
        conditions : Conditions
            What it was made with.
        lines : iterable of str
            The board's.
        residuals : list of Residual
        joint : Joint, optional
        **others
            Any of `marks` and `joint_marks`.

        Returns
        -------
        CalibrationFile
        """
        return cls(
            date=now(),
            **conditions._asdict(),
            residuals=residuals,
            joint=joint,
            lines=tuple(lines),
            **others,
        )


def now() -> datetime:
    """Return the time as files have it: UTC, in whole seconds."""
    return datetime.now(timezone.utc).replace(microsecond=0)


def save(calibration: CalibrationFile, path: Path) -> None:
    """Write or replace a file, atomically.

    Parameters
    ----------
    calibration : CalibrationFile
    path : Path

    Raises
    ------
    SpotsError
        If it cannot be written.
    """
    text = _text(calibration)
    atomic.write_text(f'{text}{_END}crc32 = "{_crc32(text)}"\n', path)


def load(path: Path) -> CalibrationFile:
    """Read a file and check it.

    Raises
    ------
    SpotsError
        If it does not exist, is cut short, changed, of another version, or not a calibration.
    """
    try:
        text = read_text(path)
    except FileNotFoundError:
        raise SpotsError(
            f"there is no file {path}: make it with 'spots calibrate position' and "
            "'spots calibrate force'"
        ) from None
    except OSError as error:
        raise SpotsError(f"cannot read {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise SpotsError(f"{path} is damaged: {_AGAIN}") from None
    version = re.search(r"^version = (\d+)$", text, re.MULTILINE)
    if version and version[1] != str(VERSION):
        raise SpotsError(
            f"{path} is of version {version[1]}, this program reads {VERSION}: update whichever "
            "is older"
        )
    body, end, tail = text.partition(_END)
    found = re.fullmatch(r'crc32 = "([0-9a-f]{8})"\n?', tail)
    if not end or (found is None and len(tail) < len('crc32 = "00000000"')):
        raise SpotsError(f"{path} is cut short: {_AGAIN}")
    if found is None or found[1] != _crc32(body):
        raise SpotsError(f"{path} was changed after it was written, the checksum differs: {_AGAIN}")
    return _checked(path, body)


def send(board: Board, calibration: CalibrationFile) -> str:
    """Upload a calibration to a board and store it there.

    Parameters
    ----------
    board : Board
    calibration : CalibrationFile

    Returns
    -------
    str
        The calibration's name, as ``hello`` reports it.

    Raises
    ------
    SpotsError
        If it was made on another board or at other settings; the board is then unchanged.
    """
    upload(board, calibration.lines)
    board.command("save")
    return checksum(list(calibration.lines))


def _crc32(text: str) -> str:
    return f"{zlib.crc32(text.encode()):08x}"


def _checked(path: Path, body: str) -> CalibrationFile:
    try:
        content = toml.loads(body)
        content.pop("version")
        found = toml.convert(content, CalibrationFile)
        made = Calibration(found.lines)
        if found.original:
            Calibration(found.original)
    except (msgspec.ValidationError, CalibrationError, KeyError) as error:
        raise SpotsError(f"{path} is not a calibration ({error}): {_AGAIN}") from None
    reason = made.mismatch(found.conditions)
    if reason is not None:
        raise SpotsError(f"{path} contradicts itself ({reason}): {_AGAIN}")
    return found


def _text(calibration: CalibrationFile) -> str:
    fields = msgspec.to_builtins(calibration)
    date, lines, original = map(fields.pop, ("date", "lines", "original"))
    tables = "residuals", "joint", "marks", "joint_marks", "rezeros"
    residuals, joint, marks, joint_marks, rezeros = map(fields.pop, tables)
    rows = [
        "# The calibration of one SPOTS board, made by 'spots calibrate'.",
        f"version = {VERSION}",
        f"date = {date}",
        *_keys(fields),
        "# What the board is given, see docs/protocol.md.",
        "lines = [",
        *_quoted(lines),
    ]
    if original:
        rows += ["# As calibrated, before any re-zero.", "original = [", *_quoted(original)]
    for residual in residuals:
        rows += ["", "[[residuals]]", *_keys(residual)]
    if joint is not None:
        rows += ["", "# angle in degrees = zero_deg + deg_per_um * position in um"]
        rows += ["[joint]", *_keys(joint)]
    if marks is not None:
        rows += ["", "# log2 of the counts of presses that 'spots rezero' repeats."]
        rows += ["[marks]", *_keys(marks)]
    if joint_marks is not None:
        rows += ["", "# The same, of stops of the joint: 'spots rezero --joint'."]
        rows += ["[joint_marks]", *_keys(joint_marks)]
    for rezero in rezeros:
        rows += ["", "[[rezeros]]", f"date = {rezero.pop('date')}", *_keys(rezero)]
    return "\n".join([*rows, "", ""])


def _quoted(lines: list[str]) -> list[str]:
    return [*(f"  {json.dumps(line)}," for line in lines), "]"]


def _keys(fields: dict) -> list[str]:
    # What JSON writes of a number, a text or a list is TOML, too.
    return [f"{name} = {json.dumps(value)}" for name, value in fields.items() if value is not None]
