"""The linkage file: a five-bar linkage as built, and how the strips are mounted in its joints."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import msgspec

from .. import atomic, toml
from ..bounded import read_text
from ..calibrate import calibration_file as calibrations
from ..calibrate.calibration_file import CalibrationFile
from ..errors import SpotsError
from .encoder import Encoder
from .fivebar import Linkage
from .kinematics import Kinematics

# Shorter ones are lengths in metres.
_Length = Annotated[float, msgspec.Meta(ge=1, le=10_000)]
_Degrees = Annotated[float, msgspec.Meta(ge=-360, le=360)]
_GAINS = 0.5, 2.0
# Keys that a file of a simulated linkage does not have.
_OWN = {"joint", "assembly"}


class _Struct(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    pass


class Mounting(_Struct, kw_only=True):
    """How a strip sits in a joint: angle = offset + gain * angle by its own calibration.

    Attributes
    ----------
    calibration : str
        File of the strip with its joint, beside the linkage file.
    offset_deg : float
        The joint's angle by Eqs. 3 and 4 where its own calibration has 0.
    gain : float
        About 1; about -1, if the two count in opposite ways.
    """

    calibration: str
    offset_deg: _Degrees
    gain: float = 1.0

    def __post_init__(self):
        low, high = _GAINS
        if not low <= abs(self.gain) <= high:
            raise ValueError("a gain is about 1, or about -1 if the joint turns the other way")


class Mounted(_Struct, kw_only=True):
    """A linkage file.

    Attributes
    ----------
    bar_mm : tuple of 4 floats
        Inner bar 1, outer bar 1, outer bar 2, inner bar 2.
    base_mm : float
    assembly : str
        ``far`` or ``near``, see `Linkage`.
    joint : list of Mounting
        Joint 1, at (0, 0), and joint 2.
    """

    bar_mm: tuple[_Length, _Length, _Length, _Length]
    base_mm: _Length
    assembly: str = "far"
    joint: list[Mounting]

    def __post_init__(self):
        if len(self.joint) != 2:
            raise ValueError(
                f"there are {len(self.joint)} [[joint]], and a linkage has two: at (0, 0), then at "
                "(base, 0)"
            )
        try:
            self.linkage  # noqa: B018
        except SpotsError as error:
            raise ValueError(str(error)) from None

    @property
    def linkage(self) -> Linkage:
        """The linkage, in the frame of its base joints."""
        return Linkage(self.bar_mm, self.base_mm, self.assembly)

    @property
    def offset_rad(self) -> tuple[float, ...]:
        """Of both encoders."""
        return tuple(math.radians(joint.offset_deg) for joint in self.joint)

    @property
    def gain(self) -> tuple[float, ...]:
        """Of both encoders."""
        return tuple(joint.gain for joint in self.joint)

    def strips(self, path: Path) -> list[CalibrationFile]:
        """Return the calibrations of both strips, of the file at a path.

        Raises
        ------
        SpotsError
            If one cannot be read, or is without a joint.
        """
        found = []
        for number, joint in enumerate(self.joint, 1):
            beside = path.parent / joint.calibration
            try:
                found.append(calibrations.load(beside))
            except SpotsError as error:
                raise SpotsError(f"linkage file {path}, joint {number}: {error}") from None
            if found[-1].joint is None:
                raise SpotsError(
                    f"linkage file {path}, joint {number}: {beside} holds no joint: run "
                    "'spots calibrate joint' with its session"
                )
        return found

    def encoders(self, strips: list[CalibrationFile]) -> tuple[Encoder, Encoder]:
        """Return new encoders of the strips."""
        return tuple(
            Encoder(strip.joint, *mounting)
            for strip, *mounting in zip(strips, self.offset_rad, self.gain)
        )

    def found(self, kinematics: Kinematics) -> Mounted:
        """Return the same with the lengths and the mounting that a calibration found."""
        joints = (
            msgspec.structs.replace(
                joint, offset_deg=round(math.degrees(offset_rad), 5), gain=round(gain, 7)
            )
            for joint, offset_rad, gain in zip(self.joint, kinematics.offset_rad, kinematics.gain)
        )
        linkage = kinematics.linkage
        return msgspec.structs.replace(
            self,
            bar_mm=tuple(round(bar, 5) for bar in linkage.bar_mm),
            base_mm=round(linkage.base_mm, 5),
            joint=list(joints),
        )


def is_mounted(name: str) -> bool:
    """Return whether a name is that of a linkage file, and not of a simulated linkage."""
    try:
        content = toml.loads(read_text(name))
    except (OSError, ValueError, msgspec.ValidationError, SpotsError):
        return False  # `load` reports what is wrong
    return bool(_OWN & content.keys())


def load(path: str | Path) -> Mounted:
    """Read a linkage file.

    Raises
    ------
    SpotsError
        If it cannot be read, or a key in it is unknown, missing or out of range.
    """
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError):
        raise SpotsError(
            f"cannot read the linkage file {path}: name one with --linkage; docs/fivebar.md shows "
            "how to write it"
        ) from None
    return toml.checked(text, Mounted, f"linkage file {path}")


def save(mounted: Mounted, path: Path, comment: str = "") -> None:
    """Write a linkage file, or replace it, atomically.

    Parameters
    ----------
    mounted : Mounted
    path : Path
    comment : str
        Lines about it.

    Raises
    ------
    SpotsError
        If it cannot be written.
    """
    atomic.write_text(_text(mounted, comment), path)


def _text(mounted: Mounted, comment: str) -> str:
    rows = [
        "# A five-bar linkage and the strips in its joints, see docs/fivebar.md.",
        *(f"# {line}" for line in comment.splitlines()),
        "",
        "# Inner bar 1, outer bar 1, outer bar 2, inner bar 2.",
        f"bar_mm = [{', '.join(map(repr, mounted.bar_mm))}]",
        f"base_mm = {mounted.base_mm!r}",
        f'assembly = "{mounted.assembly}"',
    ]
    for joint, where in zip(mounted.joint, ("(0, 0)", "(base, 0)")):
        # A JSON string is a TOML one.
        name = msgspec.json.encode(joint.calibration).decode()
        rows += ["", f"[[joint]]  # at {where}", f"calibration = {name}"]
        rows += [f"offset_deg = {joint.offset_deg!r}", f"gain = {joint.gain!r}"]
    return "\n".join([*rows, ""])
