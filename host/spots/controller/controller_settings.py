"""Reads and writes the settings of the controller: a TOML file whose keys are validated.

The default file ``data/controller.toml`` explains each key. The zone of a button is the part of the
strip from `from_percent` to `to_percent`.
"""

from pathlib import Path
from typing import Annotated, Union

import msgspec

from ..common import atomic, toml

DEFAULT = Path(__file__).parent / "data" / "controller.toml"

Percent = Annotated[float, msgspec.Meta(ge=0, le=100)]
Share = Annotated[float, msgspec.Meta(ge=0, le=1)]
Force = Annotated[float, msgspec.Meta(ge=0, le=65_535)]
# Least force of a finger. A smaller value in a file is probably in N, because a strip cannot
# measure so light a press.
_FINGER_MN = 50
Time = Annotated[float, msgspec.Meta(ge=0, le=10_000)]
# At a lower rate, the lift of a finger would be reported too late.
Rate = Annotated[float, msgspec.Meta(ge=10, le=1000)]
Hertz = Annotated[float, msgspec.Meta(ge=0.01, le=1000)]


class Smooth(toml.Strict):
    """Settings of the 1-Euro filter that smooths the deflection of an axis, from -1 to 1.

    Attributes
    ----------
    min_cutoff_hz, beta, derivative_cutoff_hz : float
        Parameters of `one_euro.OneEuro`.
    """

    min_cutoff_hz: Hertz = 2.0
    beta: Annotated[float, msgspec.Meta(ge=0, le=1000)] = 16.0
    derivative_cutoff_hz: Hertz = 10.0


class _Axis(toml.Strict, tag_field="from"):
    deadband: Annotated[float, msgspec.Meta(ge=0, le=0.9)] = 0.0
    expo: Share = 0.0
    invert: bool = False
    smooth: Smooth = Smooth()


class PositionAxis(_Axis, tag="position"):
    """An axis that follows the position of the finger.

    Attributes
    ----------
    rest_percent, min_percent, max_percent : float
        Positions at which the axis is 0, -1 and 1, in % of the strip's length from the sensor.
    """

    rest_percent: Percent = 50.0
    min_percent: Percent = 5.0
    max_percent: Percent = 95.0

    def __post_init__(self):
        if not self.min_percent < self.rest_percent < self.max_percent:
            raise ValueError(
                "rest_percent must be above min_percent and below max_percent; invert = true "
                "reverses the axis"
            )


class ForceAxis(_Axis, tag="force"):
    """An axis that follows the force of the finger.

    Attributes
    ----------
    rest_mN, max_mN : float
        Forces at which the axis is 0 and 1, in mN.
    """

    rest_mN: Force = 300.0
    max_mN: Annotated[float, msgspec.Meta(ge=_FINGER_MN, le=65_535)] = 6000.0

    def __post_init__(self):
        if not self.rest_mN < self.max_mN:
            raise ValueError("rest_mN must be below max_mN")


class _Button(toml.Strict, tag_field="when"):
    number: Annotated[int, msgspec.Meta(ge=1, le=16)]
    from_percent: Percent = 0.0
    to_percent: Percent = 100.0

    def __post_init__(self):
        if not self.from_percent < self.to_percent:
            raise ValueError("from_percent must be below to_percent")


class Pressed(_Button, tag="pressed"):
    """A button that is down while a touch, which began in the button's zone, presses hard enough.

    Attributes
    ----------
    press_mN, release_mN : float
        Least force that presses the button, and force below which the button is released, in mN.
        If `press_mN` is 0, every touch presses the button. If `release_mN` is 0, the button stays
        down until the finger lifts.
    """

    press_mN: Force = 0.0
    release_mN: Force = 0.0

    def __post_init__(self):
        super().__post_init__()
        if 0 < self.press_mN < _FINGER_MN:
            raise ValueError(
                f"press_mN is {self.press_mN:g} mN, too little for a finger: write the force in "
                "mN, not in N"
            )
        if self.release_mN > self.press_mN:
            raise ValueError("release_mN must not be above press_mN")


class Tapped(_Button, tag="tapped"):
    """A button that is down for a short time after a short touch that began in the button's zone.

    Attributes
    ----------
    longest_ms : float
        Longest duration of the touch, in ms.
    pulse_ms : float
        Time for which the button is then down, in ms.
    """

    longest_ms: Annotated[float, msgspec.Meta(ge=10, le=10_000)] = 200.0
    pulse_ms: Annotated[float, msgspec.Meta(ge=1, le=10_000)] = 50.0


class Anchored(_Button, tag="anchored"):
    """A button that is down from a first touch in the button's zone until this finger lifts.

    This finger is the anchor: it moves no axis and presses no other kind of button. Position axes
    follow a second finger.
    """


class ControllerSettings(toml.Strict):
    """All settings of a controller.

    Attributes
    ----------
    hold_ms : float
        Time in ms for which the last valid state is kept while readings are untrusted or missing.
    release_ms : float
        Time in ms after which a touch ends if no light from a press is measured.
    rate_hz : float
        Largest number of states that are sent to the gamepad per second.
    x, y, z : PositionAxis, ForceAxis or None
        Settings of the axes; None for an axis that is not used. `z` cannot be a `PositionAxis`.
    button : list of Pressed, Tapped or Anchored
        Settings of the buttons.
    """

    hold_ms: Time = 100.0
    release_ms: Time = 15.0
    rate_hz: Rate = 125.0
    x: Union[PositionAxis, ForceAxis, None] = None
    y: Union[PositionAxis, ForceAxis, None] = None
    z: Union[ForceAxis, None] = None
    button: list[Union[Pressed, Tapped, Anchored]] = []

    def __post_init__(self):
        if self.z is not None and self.z.invert:
            raise ValueError("z is a one-sided axis and cannot be inverted: remove invert")


def load(path: str | Path = DEFAULT) -> ControllerSettings:
    """Read a settings file.

    Raises
    ------
    SpotsError
        If the file does not exist, or a key in it is unknown, missing or out of range.
    """
    path, text = toml.find(path, DEFAULT.parent, "settings")
    return parsed(text, path)


def parsed(text: str, path: Path) -> ControllerSettings:
    """Return the settings in the text of a settings file.

    Parameters
    ----------
    text : str
        Text of the file, in TOML.
    path : Path
        Path of the file, for error messages.

    Returns
    -------
    ControllerSettings
        The settings, with default values where the text has none.

    Raises
    ------
    SpotsError
        If a key is unknown, missing or out of range.
    """
    return toml.checked(text, ControllerSettings, "settings", path)


KIND = atomic.Kind("a settings file of a controller", load)


def save(settings: ControllerSettings, path: str | Path, before: ControllerSettings | None) -> None:
    """Write a settings file without comments. An existing file is replaced atomically.

    Parameters
    ----------
    settings : ControllerSettings
        Settings to write, including those that have default values.
    path : str or Path
        Path of the file.
    before : ControllerSettings or None
        Settings that the file must still have; None if the file did not exist.

    Raises
    ------
    SpotsError
        If the file cannot be written, or has other settings than `before`; an existing file is
        then unchanged.
    """
    text = toml.dumps(msgspec.to_builtins(settings)) + "\n"
    atomic.write_text(text, path, KIND, was=before)
