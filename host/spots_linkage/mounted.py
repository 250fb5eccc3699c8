"""The linkage file: lengths of a five-bar linkage, and the mounting of the strips in its joints."""

import math
from pathlib import Path
from typing import Annotated

import msgspec

from spots.calibrate import calibration_file as calibrations
from spots.calibrate.calibration_file import CalibrationFile
from spots.common import atomic, kinds, toml
from spots.common.bounded import read_text
from spots.errors import FileError, SpotsError

from .encoder import Encoder
from .fivebar import Linkage
from .kinematics import Kinematics

# In mm. A shorter length is probably in metres.
_Length = Annotated[float, msgspec.Meta(ge=1, le=10_000)]
_Degrees = Annotated[float, msgspec.Meta(ge=-360, le=360)]


class Mounting(toml.Strict, kw_only=True):
    """Mounting of a strip in a joint: joint angle = offset + gain * calibrated angle.

    `calibration` is a path relative to the folder of the linkage file. `gain` is about 1, or about
    -1 if the calibrated angle grows in the opposite direction. Angles are those of `Linkage`.
    """

    calibration: str
    offset_deg: _Degrees
    gain: float = 1.0

    def __post_init__(self):
        if not 0.5 <= abs(self.gain) <= 2:
            raise ValueError(
                "gain must be about 1, or about -1 if the calibrated angle grows in the opposite "
                "direction"
            )


class Mounted(toml.Strict, kw_only=True):
    """Content of a linkage file: the linkage's lengths, and the strips in its joints.

    The bars are inner bar 1, outer bar 1, outer bar 2 and inner bar 2; the assembly is ``far`` or
    ``near``, see `Linkage`. Joint 1 is at (0, 0) and joint 2 at (base, 0).
    """

    bar_mm: tuple[_Length, _Length, _Length, _Length]
    base_mm: _Length
    assembly: str = "far"
    joint: list[Mounting]

    def __post_init__(self):
        if len(self.joint) != 2:
            raise ValueError(
                f"there are {len(self.joint)} [[joint]] tables, but a linkage has two joints: "
                "write one for joint 1 at (0, 0), then one for joint 2 at (base, 0)"
            )
        try:
            self.linkage  # noqa: B018
        except SpotsError as error:
            raise ValueError(str(error)) from None

    @property
    def linkage(self) -> Linkage:
        """Linkage with this file's lengths; origin at joint 1, x axis towards joint 2."""
        return Linkage(self.bar_mm, self.base_mm, self.assembly)

    @property
    def offset_rad(self) -> tuple[float, ...]:
        """Joint angles at the calibrated angle 0, for encoder 1 and encoder 2, in rad."""
        return tuple(math.radians(joint.offset_deg) for joint in self.joint)

    @property
    def gain(self) -> tuple[float, ...]:
        """Gains of encoder 1 and encoder 2: joint angle per calibrated angle."""
        return tuple(joint.gain for joint in self.joint)

    def strips(self, path: Path) -> list[CalibrationFile]:
        """Read the calibration files of both strips; `path` is that of the linkage file.

        FileError if a calibration file cannot be read, or contains no calibration of a joint.
        """
        found = []
        for number, joint in enumerate(self.joint, 1):
            try:
                file = path.parent / joint.calibration
                found.append(calibrations.load(file))
                Encoder(file)
            except SpotsError as error:
                raise FileError(
                    f"linkage file {path}, joint {number}: {error}", path, f"joint {number}"
                ) from None
        return found

    def encoders(self, strips: list[CalibrationFile]) -> tuple[Encoder, Encoder]:
        """Return the encoder of each joint, from its strip's calibration and its mounting."""
        return tuple(
            Encoder(strip.joint, *mounting)
            for strip, *mounting in zip(strips, self.offset_rad, self.gain)
        )

    def found(self, kinematics: Kinematics, calibrations: list[str]) -> "Mounted":
        """Return a copy with the lengths and the mounting from a kinematic calibration.

        `calibrations` are paths relative to the folder of the new linkage file.
        """
        linkage = kinematics.linkage
        joints = [
            Mounting(
                calibration=name, offset_deg=round(math.degrees(offset), 5), gain=round(gain, 7)
            )
            for name, offset, gain in zip(calibrations, kinematics.offset_rad, kinematics.gain)
        ]
        bars = tuple(round(bar, 5) for bar in linkage.bar_mm)
        return Mounted(
            bar_mm=bars, base_mm=round(linkage.base_mm, 5), assembly=self.assembly, joint=joints
        )


def is_mounted(name: str) -> bool:
    """Return whether a linkage file is for real boards, and not for a simulated linkage.

    `name` is the file's path. The result is also False if the file cannot be read.
    """
    try:
        content = toml.loads(read_text(name))
    except (OSError, ValueError, msgspec.ValidationError, SpotsError):
        return False  # `load` reports the error
    return not content.keys().isdisjoint(("joint", "assembly"))


def load(path: str | Path) -> Mounted:
    """Read a linkage file; FileError if it is missing or invalid."""
    try:
        text = read_text(path)
    except FileNotFoundError:
        raise FileError(
            f"cannot read the linkage file {path}, because there is no such file: name another "
            "file; docs/play/linkage.md shows how to write one",
            path,
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise kinds.not_read(path, error, "a linkage file") from None
    return toml.checked(text, Mounted, "linkage", path)


KIND = atomic.Kind("a linkage file", load)


def save(mounted: Mounted, path: Path, before: Mounted | None, comment: str = "") -> None:
    """Write a linkage file. An existing linkage file is replaced atomically.

    `before` is the content that the file must still have, None if the file did not exist;
    ChangedError otherwise. The comment may have several lines.
    """
    rows = [
        "# A five-bar linkage and the strips in its joints, see docs/play/linkage.md.",
        *(f"# {line}" for line in comment.splitlines()),
        "",
        "# Joint 1 is at (0, 0), joint 2 at (base, 0).",
        "# Inner bar 1, outer bar 1, outer bar 2, inner bar 2.",
        toml.dumps(msgspec.to_builtins(mounted)),
        "",
    ]
    atomic.write_text("\n".join(rows), path, KIND, was=before)
