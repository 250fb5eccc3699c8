"""Reads the simulator's TOML files; names of keys end in their units, and every key is validated.

A sensor file describes a strip and its chip. A scenario file describes fingers, strain and light
over time. A linkage file describes a five-bar linkage. A path file describes the path along which a
hand guides this linkage. A change file describes changes of a sensor since its calibration. The
comments in the package's files ``data/*/*.toml`` name the source of each value.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import msgspec

from spots.common import atomic, toml

from . import spectrum
from .change import Change, ChangeInTime, Temperature
from .silicone import Silicone

DATA = Path(__file__).parents[1] / "data"

_MOST = 1e12  # excludes infinity
Positive = Annotated[float, msgspec.Meta(gt=0, le=_MOST)]
NotNegative = Annotated[float, msgspec.Meta(ge=0, le=_MOST)]
Time = NotNegative
Cycle = Annotated[float, msgspec.Meta(ge=0.01, le=_MOST)]
Place = Annotated[float, msgspec.Meta(ge=0, le=10_000)]
Percent = Annotated[float, msgspec.Meta(ge=0, le=100)]
Shift = Annotated[float, msgspec.Meta(ge=-100, le=100)]
Strain = Annotated[float, msgspec.Meta(ge=0, le=50)]
Bend = Annotated[float, msgspec.Meta(ge=0, le=360)]
PercentOff = Annotated[float, msgspec.Meta(ge=-10, le=10)]
Degrees = Annotated[float, msgspec.Meta(ge=-360, le=360)]
Coordinate = Annotated[float, msgspec.Meta(ge=-10_000, le=10_000)]
Wavelength = Annotated[float, msgspec.Meta(ge=350, le=1000)]
Spectrum = str | tuple[tuple[Wavelength, NotNegative], ...]


class Led(toml.Strict):
    """A phosphor-converted white LED: two Gaussian peaks.

    Attributes
    ----------
    blue_nm, phosphor_nm : float
        Centre wavelengths of the peaks.
    blue_fwhm_nm, phosphor_fwhm_nm : float
        Full widths of the peaks at half maximum.
    blue_share : float
        Share of the blue peak in the light, 0 to 1.
    irradiance_uW_cm2_per_mA : float
        Irradiance at the sensor per mA of LED current, for a press at the sensor's end of the
        strip with full contact.
    bend_mA : float
        Constant of the LED's droop: at a current I, the light is proportional to
        I / (1 + I / bend_mA).
    noise_ppm_10ms : float
        Relative standard deviation of the light in an exposure of 10 ms.
    warm_up_percent, warm_up_s : float
        Additional light at power-on in per cent, and the time constant of its decay in s.
    spectrum : str or tuple of tuple
        Measured spectrum in place of the two peaks: a CSV file, its path relative to the sensor
        file; or its rows, wavelength in nm and power in any unit. The peaks then only describe
        how `change.Change` changes this spectrum.
    """

    blue_nm: Wavelength
    blue_fwhm_nm: Positive
    blue_share: Annotated[float, msgspec.Meta(ge=0, le=1)]
    phosphor_nm: Wavelength
    phosphor_fwhm_nm: Positive
    irradiance_uW_cm2_per_mA: Positive
    bend_mA: Positive
    noise_ppm_10ms: NotNegative
    warm_up_percent: Annotated[float, msgspec.Meta(gt=-100, le=100)]
    warm_up_s: Positive
    # Wiring of the LED, one of `board.light.LEDS`. The chip sets the current only for `ldr`;
    # for the others, the current is `fixed_mA`.
    wired: Literal["ldr", "gpio", "always"] = "ldr"
    fixed_mA: Positive = 20.0
    spectrum: Spectrum = ()

    def current_mA(self, driver_mA: float) -> float:
        """Return the current of a lit LED: `driver_mA` if the chip sets it, else `fixed_mA`."""
        return driver_mA if self.wired == "ldr" else self.fixed_mA


class Dye(toml.Strict):
    """Decay of the light in the dyed guide, as a function of the wavelength.

    Attributes
    ----------
    strength_per_mm : float
        Decay coefficient of the dye at wavelengths below the absorption edge.
    edge_nm, edge_width_nm : float
        Wavelength and width of the absorption edge; above the edge, the dye is clear.
    clear_per_mm : float
        Decay coefficient of the clear material at every wavelength.
    spectrum : str or tuple of tuple
        Measured absorbance in place of the edge: a CSV file, its path relative to the sensor file;
        or its rows, wavelength in nm and absorbance in any unit. `strength_per_mm` is the decay
        coefficient at its maximum.
    uneven_percent, uneven_mm, uneven_phase_deg : float
        Dye that was there at the calibration already, but is uneven along the strip: amplitude in
        per cent of the strength, length of a period, and its phase at the sensor's end.
    far_end_percent : float
        Share of the light that the far end of the dyed guide reflects, in per cent.
    """

    strength_per_mm: NotNegative
    edge_nm: Wavelength
    edge_width_nm: Positive
    clear_per_mm: NotNegative
    spectrum: Spectrum = ()
    uneven_percent: Shift = 0.0
    uneven_mm: Positive = 30.0
    uneven_phase_deg: Degrees = 0.0
    far_end_percent: Percent = 0.0


class ContactFile(toml.Strict):
    """Coupled light by force, as a share of the light at full contact, see `contact.coupling`.

    With `gap_percent` or `mode_percent`, the colour of a press depends on its force, too. In both,
    s is the contact share: the contact area divided by that of a full contact.

    Attributes
    ----------
    threshold_mN : float
        Force of the first contact, in mN.
    half_mN : float
        Increase of the force above `threshold_mN` that gives about half of full contact, in mN.
    early_share, early_mN : float
        Light coupled just below the threshold, as a share of the light at full contact. Each
        decrease of the force by `early_mN` divides this light by e.
    gap_percent : float
        Share g of the light that crosses gaps of less than a wavelength beside the contact
        (frustrated total reflection): it is proportional to the wavelength, and vanishes at a full
        contact. The light is multiplied by 1 + g (1 - s) (wavelength - 565 nm) / 565 nm.
    mode_percent : float
        Increase m of the path in the dyed guide: a larger contact couples steeper modes. The path
        is multiplied by 1 + m (s - s at 6 N).
    dust : tuple of tuple
        Places where the guides always touch, because of dust or a kink: distance from the sensor's
        end of the unstretched strip in mm, and contact in per cent of a full contact. The light
        of the dust adds to that of a press.
    sticking_percent, sticking_s : float
        Share of the contact that remains where a press has lifted, and the time constant of its
        decay in s.
    skin_percent : float
        Red light that the skin of a finger reflects back into the strip, in per cent of the light
        of the press; an indenter is black. Skin reflects less green and blue light.
    """

    threshold_mN: NotNegative
    half_mN: Positive
    early_share: Annotated[float, msgspec.Meta(ge=0, lt=0.1)] = 0.0
    early_mN: Positive = 50.0
    gap_percent: Shift = 0.0
    mode_percent: Shift = 0.0
    dust: tuple[tuple[Place, Percent], ...] = ()
    sticking_percent: Percent = 0.0
    sticking_s: Positive = 1.0
    skin_percent: Percent = 0.0


class Converter(toml.Strict):
    """The chip's noise, and its behaviour that no document defines.

    `chip.ChipNoise` and `chip.Quirks` describe the attributes; there, `read_noise_counts` is named
    ``read_counts``, and `ratio_noise_ppm` is named ``ratio_ppm``.
    """

    read_noise_counts: NotNegative
    electrons_per_count_1x: Positive
    dark_counts_512x: NotNegative
    auto_zero_at_every_start: bool = True
    avalid_clears_on_read: bool = False
    aint_needs_sp_ien: bool = True
    smux_us: NotNegative = 200.0
    ratio_noise_ppm: NotNegative = 0.0
    clock_error_percent: Annotated[float, msgspec.Meta(ge=-6, le=6)] = 0.0


class Stretch(toml.Strict):
    """Effect of stretching and bending on the light guides, see `optics.Optics.press`.

    Attributes
    ----------
    poisson_ratio : float
        Poisson's ratio of the material.
    bend_loss_percent : float
        Loss of light at a bend of 180 degrees, in per cent.
    bend_path_percent, bend_mm, bend_at_percent : float
        Increase of the path in the dyed guide at a bend of 90 degrees, in per cent; length of the
        bent piece in mm; and its middle, in per cent of the strip's length.
    """

    poisson_ratio: Annotated[float, msgspec.Meta(ge=0, le=0.5)] = 0.45
    bend_loss_percent: Annotated[float, msgspec.Meta(ge=0, lt=100)] = 5.0
    bend_path_percent: Shift = 0.0
    bend_mm: Positive = 20.0
    bend_at_percent: Percent = 50.0


class Surroundings(toml.Strict):
    """Ambient light with a constant mean and with flicker; a scenario can add more light.

    Attributes
    ----------
    irradiance_uW_cm2 : float
        Mean irradiance in uW/cm2.
    flicker_percent, flicker_hz, flicker_phase_deg : float
        Amplitude in per cent of the mean, frequency and phase of the flicker.
    shaded_percent : float
        Share of this light that the hand shades while a finger presses.
    """

    irradiance_uW_cm2: NotNegative = 0.0
    flicker_percent: Annotated[float, msgspec.Meta(ge=0, le=100)] = 0.0
    flicker_hz: Positive = 100.0
    flicker_phase_deg: Degrees = 0.0
    shaded_percent: Percent = 0.0


JOINT_TRAVEL = (0.1, 0.9)  # ends of the indenter's travel, as shares of the strip's length


class JointFile(toml.Strict):
    """A joint that slides an indenter along the strip.

    Attributes
    ----------
    radius_mm : float
        Distance in mm that the indenter slides on the strip per radian of the joint.
    force_mN : float
        Force of the indenter in mN.
    play_deg : float
        Backlash of the joint in degrees.
    """

    radius_mm: Positive = 25.0
    force_mN: Positive = 4000.0
    play_deg: NotNegative = 0.02

    @property
    def um_per_deg(self) -> float:
        """Distance in um that the indenter slides per degree of the joint."""
        return 1000 * self.radius_mm * math.pi / 180


class SensorFile(toml.Strict):
    """A strip and the chip at its end.

    Attributes
    ----------
    length_mm : float
        Length of the strip at rest, in mm.
    led, dye, contact, silicone, converter, stretch, surroundings, joint, temperature
        Tables of the file; the class of each table describes it.
    change : change.Change
        Change of the sensor since its calibration.
    """

    length_mm: Positive
    led: Led
    dye: Dye
    contact: ContactFile
    converter: Converter
    stretch: Stretch = Stretch()
    surroundings: Surroundings = Surroundings()
    joint: JointFile = JointFile()
    temperature: Temperature = Temperature()
    silicone: Silicone = Silicone()
    change: Change = Change()

    @property
    def mains_hz(self) -> int:
        """Mains frequency in Hz of lamps that flicker at 100 or 120 Hz: 50 or 60; otherwise 0."""
        around = self.surroundings
        lamps = {100.0: 50, 120.0: 60} if around.flicker_percent else {}
        return lamps.get(around.flicker_hz, 0)

    @property
    def joint_travel_deg(self) -> float:
        """Angle in degrees by which the joint turns for the whole travel of its indenter."""
        start, end = JOINT_TRAVEL
        return 1000 * (end - start) * self.length_mm / self.joint.um_per_deg

    def indenter_um(self, angle_deg: float, direction: int) -> float:
        """Return the position of a joint's indenter, in um from the sensor's end.

        `direction` is 1 if the joint has reached the angle from below, -1 if from above. The
        indenter lags behind the joint by half the backlash.
        """
        lagging_deg = angle_deg - direction * self.joint.play_deg / 2
        return 1000 * JOINT_TRAVEL[0] * self.length_mm + lagging_deg * self.joint.um_per_deg

    def unchanged(self) -> SensorFile:
        """Return a copy of the sensor without its change since the calibration."""
        return msgspec.structs.replace(self, change=Change())


class Finger(toml.Strict):
    """A finger that touches the strip: path, force, width, tilt, and how it moves by itself.

    Fingers roll, slide as they lift, and tremble. `hands.HANDS` has sizes of these movements.

    Attributes
    ----------
    points : list of tuple
        Points (time in s, position in mm, force in mN) of the path, joined by straight lines.
    width_mm : float
        Width of the finger along the strip, in mm.
    tilt_percent : float
        Pressure at the edge of the finger that is far from the sensor, minus the mean pressure, in
        per cent of the mean pressure.
    roll_mm : float
        Distance that the contact moves during the touch, in mm, in addition to `points`; it grows
        evenly from the first to the last point.
    slide_mm : float
        Distance that the contact moves between the last two points, in mm, in addition to `points`
        and `roll_mm`: a finger that slides while it lifts.
    tremor_percent : float
        Amplitude of the force's tremor, in per cent of the force.
    """

    points: Annotated[list[tuple[Time, Place, NotNegative]], msgspec.Meta(min_length=2)]
    width_mm: NotNegative = 4.0
    tilt_percent: Shift = 0.0
    roll_mm: Shift = 0.0
    slide_mm: Shift = 0.0
    tremor_percent: Percent = 0.0

    def __post_init__(self):
        times = [point[0] for point in self.points]
        if any(b <= a for a, b in zip(times, times[1:])):
            raise ValueError(
                "the times of a touch must ascend: sort its points, and remove equal times"
            )


class Ambient(toml.Strict):
    """Ambient light that changes in steps.

    Attributes
    ----------
    steps : list of tuple
        Each step: time in s, and irradiance in uW/cm2 from that time on.
    flicker_percent, flicker_hz, flicker_phase_deg : float
        Amplitude in per cent of the mean, frequency and phase of the flicker.
    leaves_percent, leaves_hz : float
        Irregular changes of the light, as of the sun through moving leaves: largest amplitude in
        per cent of the mean, and the lowest frequency.
    shaded_percent : float
        Share of this light that the hand shades while a finger presses.
    """

    steps: Annotated[list[tuple[Time, NotNegative]], msgspec.Meta(min_length=1)]
    flicker_percent: Annotated[float, msgspec.Meta(ge=0, le=100)] = 0.0
    flicker_hz: Positive = 100.0
    flicker_phase_deg: Degrees = 0.0
    leaves_percent: Percent = 0.0
    leaves_hz: Positive = 1.0
    shaded_percent: Percent = 0.0

    def __post_init__(self):
        times = [step[0] for step in self.steps]
        if any(b <= a for a, b in zip(times, times[1:])):
            raise ValueError(
                "the times of the steps must ascend: sort them, and remove equal times"
            )


class Moments(toml.Strict):
    """Start times and duration of a fault: fixed times, random times, or both.

    Attributes
    ----------
    at_s : list of float
        Fixed start times, in s from the start of the scenario; repeated with the scenario.
    per_min : float
        Mean number of random start times in a minute.
    last_ms : float
        Duration of the fault in ms.
    """

    at_s: list[Time] = []
    per_min: Annotated[float, msgspec.Meta(ge=0, le=6000)] = 0.0
    last_ms: Annotated[float, msgspec.Meta(gt=0, le=3_600_000)] = 100.0


class Bursts(Moments):
    """Intervals in which `damage_percent` of the bytes are flipped, lost, doubled or inserted."""

    damage_percent: Percent = 100.0


class SerialFaults(toml.Strict):
    """Damage to the bytes on the serial link, in one direction.

    Attributes
    ----------
    flip_percent, drop_percent, double_percent, insert_percent : float
        Shares of all bytes, in per cent: bytes with a flipped bit, lost bytes, doubled bytes, and
        bytes before which a random byte is inserted.
    bursts : Bursts
        Intervals of dense damage.
    """

    flip_percent: Percent = 0.0
    drop_percent: Percent = 0.0
    double_percent: Percent = 0.0
    insert_percent: Percent = 0.0
    bursts: Bursts = Bursts()

    def __post_init__(self):
        shares = self.flip_percent, self.drop_percent, self.double_percent, self.insert_percent
        if sum(shares) > 100:
            raise ValueError("the shares of damaged bytes must add up to at most 100 %")


class BusFaults(toml.Strict):
    """Damage to transfers on the I2C bus.

    Of all transfers, `nack_percent` are not acknowledged, and `wrong_percent` have a wrong bit. In
    the intervals `nack_bursts`, no transfer is acknowledged. In each interval of `sda_low`, SDA is
    low until the interval ends or the board sends nine clocks.
    """

    nack_percent: Percent = 0.0
    nack_bursts: Moments = Moments()
    wrong_percent: Percent = 0.0
    sda_low: Moments = Moments()


class PowerFaults(toml.Strict):
    """Brown-outs of board and sensor, resets of the sensor, and times without a sensor."""

    brown_outs: Moments = Moments()
    sensor_resets: Moments = Moments()
    sensor_unplugged: Moments = Moments()


class ClockFaults(toml.Strict):
    """Error of the board's oscillator (positive if fast), and times when the processor stops."""

    oscillator_ppm: Annotated[float, msgspec.Meta(ge=-1000, le=1000)] = 0.0
    stalls: Moments = Moments()


class FaultsFile(toml.Strict):
    """Faults of a scenario, see `faults`. All but `oscillator_ppm` begin at `from_s` or later."""

    from_s: Time = 0.0
    to_host: SerialFaults = SerialFaults()
    to_board: SerialFaults = SerialFaults()
    i2c: BusFaults = BusFaults()
    power: PowerFaults = PowerFaults()
    clock: ClockFaults = ClockFaults()

    def moments(self) -> dict[str, Moments]:
        """Return the times of all faults by their keys in the file, such as ``clock.stalls``."""
        parts = (getattr(self, name) for name in self.__struct_fields__[1:])
        return {
            f"{part}.{name}": value
            for part, table in zip(self.__struct_fields__[1:], parts)
            for name, value in msgspec.structs.asdict(table).items()
            if isinstance(value, Moments)
        }


class ScenarioFile(toml.Strict):
    """Fingers, strain, light and faults over time; the scenario repeats after `seconds`.

    `strain`, `bend`, `leak` and each key of `change` are lists of points, joined by straight lines.
    Before the first and after the last point, the value is constant. Positions are measured along
    the stretched strip.

    Attributes
    ----------
    seconds : float
        Duration of the scenario in s.
    strain_percent, bend_deg : float
        Constant strain, used if `strain` is empty; constant bending angle, used if `bend` is empty.
    strain : list of tuple
        Points (time in s, strain in per cent).
    bend : list of tuple
        Points (time in s, bending angle in degrees).
    leak : list of tuple
        Points (time in s, share of full contact, position in mm) of light that couples at a
        position without a finger.
    touch : list of Finger
        Fingers that touch the strip.
    ambient : Ambient or None
        Ambient light, in addition to the `Surroundings` of the sensor.
    change : ChangeInTime
        For each attribute of `change.Change`: points (time in s, change since the calibration).
    faults : FaultsFile or None
        Faults of the board and its connections.
    """

    seconds: Cycle
    strain_percent: Strain = 0.0
    bend_deg: Bend = 0.0
    strain: list[tuple[Time, Strain]] = []
    bend: list[tuple[Time, Bend]] = []
    leak: list[tuple[Time, Annotated[float, msgspec.Meta(ge=0, le=1)], Place]] = []
    touch: list[Finger] = []
    ambient: Ambient | None = None
    change: ChangeInTime = ChangeInTime()
    faults: FaultsFile | None = None

    def __post_init__(self):
        if any(touch.points[-1][0] > self.seconds for touch in self.touch):
            raise ValueError(
                f"a touch lasts beyond the end of the scenario ({self.seconds:g} s): shorten the "
                "touch"
            )
        for name, constant in (("strain", "strain_percent"), ("bend", "bend_deg")):
            if getattr(self, name) and getattr(self, constant):
                raise ValueError(f"{name} and {constant} are both given: remove one of them")
        lines = {name: getattr(self, name) for name in ("strain", "bend", "leak")}
        lines |= {f"change.{k}": v for k, v in msgspec.structs.asdict(self.change).items()}
        for name, points in lines.items():
            times = [point[0] for point in points]
            if any(b <= a for a, b in zip(times, times[1:])):
                raise ValueError(
                    f"the times of {name} must ascend: sort them, and remove equal times"
                )
            if times and times[-1] > self.seconds:
                raise ValueError(
                    f"{name} has points after the end of the scenario ({self.seconds:g} s): "
                    "remove these points"
                )
        for place, moments in self.faults.moments().items() if self.faults else ():
            if any(at_s >= self.seconds for at_s in moments.at_s):
                raise ValueError(
                    f"faults.{place} has a time that is not before the end of the scenario "
                    f"({self.seconds:g} s): remove this time"
                )


class LinkageFile(toml.Strict):
    """A five-bar linkage with a strip in each base joint: nominal dimensions and their errors.

    Attributes
    ----------
    bar_mm, base_mm : tuple of float, float
        Nominal lengths in mm: inner bar 1, outer bar 1, outer bar 2, inner bar 2; and the base.
    lowest_deg : tuple of float
        Angle of each joint at which the travel of its indenter begins, in degrees as defined in
        Eqs. 3 and 4 of the paper.
    bar_error_percent, base_error_percent : tuple of float, float
        Relative errors of these lengths, in per cent.
    mount_error_deg : tuple of float
        Error of the mounting angle of each joint, in degrees.
    """

    bar_mm: tuple[Positive, Positive, Positive, Positive]
    base_mm: Positive
    lowest_deg: tuple[Degrees, Degrees]
    bar_error_percent: tuple[PercentOff, PercentOff, PercentOff, PercentOff] = (0.0, 0.0, 0.0, 0.0)
    base_error_percent: PercentOff = 0.0
    mount_error_deg: tuple[Degrees, Degrees] = (0.0, 0.0)


class Stroke(toml.Strict):
    """Part of a path: straight lines through points (x mm, y mm); a curve if `smooth` is true."""

    points: Annotated[list[tuple[Coordinate, Coordinate]], msgspec.Meta(min_length=2)]
    smooth: bool = False


class PathFile(toml.Strict):
    """Path along which a hand guides the end point of a linkage.

    Attributes
    ----------
    speed_mm_s : float
        Speed of the end point in mm/s.
    stroke : list of Stroke
        Strokes, joined by straight lines.
    tremor_mm, tremor_hz : float
        Amplitude in mm and frequency in Hz of the hand's tremor.
    """

    speed_mm_s: Positive
    stroke: Annotated[list[Stroke], msgspec.Meta(min_length=1)]
    tremor_mm: NotNegative = 0.0
    tremor_hz: Positive = 8.0


class _ChangeFile(toml.Strict):
    change: Change


_File = TypeVar("_File", SensorFile, ScenarioFile, LinkageFile, PathFile)
_KINDS = {
    SensorFile: "sensor",
    ScenarioFile: "scenario",
    LinkageFile: "linkage",
    PathFile: "path",
}


def to_toml(sensor: SensorFile) -> str:
    """Return the text of a sensor file in TOML, without comments."""
    lines, sections = [], []
    for name, value in msgspec.to_builtins(sensor).items():
        if isinstance(value, dict):
            sections += ["", f"[{name}]", *(_assignment(*item) for item in value.items())]
        else:
            lines.append(_assignment(name, value))
    return "\n".join(lines + sections) + "\n"


def _assignment(name: str, value: float | bool | str) -> str:
    return f"{name} = {json.dumps(value)}"  # JSON and TOML write these values alike


def load_change(name: str | Path) -> Change:
    """Read a change file: the keys of `Change`, at the top level or in a table ``[change]``.

    `name` is a path or a file of the package. FileError if it is missing or invalid.
    """
    path, text = toml.find(name, DATA / "changes", "change")
    if re.search(r"^[ \t]*\[change\]", text, re.MULTILINE):
        return toml.checked(text, _ChangeFile, "change", path).change
    return toml.checked(text, Change, "change", path)


@contextmanager
def changed(sensor: str, change: str | None) -> Iterator[str]:
    """Write a temporary sensor file that includes a change; remove it after the ``with`` block.

    Both are a path or a file of the package. Without a change, `sensor` is yielded unchanged.
    """
    if change is None:
        yield sensor
        return
    file = load(SensorFile, sensor)
    file = msgspec.structs.replace(file, change=file.change + load_change(change))
    with atomic.temporary() as folder:
        path = folder / "sensor.toml"
        path.write_text(to_toml(file), encoding="utf-8")
        yield str(path)


def load(kind: type[_File], name: str | Path) -> _File:
    """Read a file of the simulation: a path, or the name of a file of the package.

    FileError if it does not exist, or a key is unknown, missing or out of range.
    """
    what = _KINDS[kind]
    path, text = toml.find(name, DATA / f"{what}s", what)
    file = toml.checked(text, kind, what, path)
    return _with_spectra(file, path.parent) if isinstance(file, SensorFile) else file


def _with_spectra(sensor: SensorFile, folder: Path) -> SensorFile:
    for name in ("led", "dye"):
        table = getattr(sensor, name)
        if isinstance(table.spectrum, str):
            rows = spectrum.read(folder / table.spectrum)
            table = msgspec.structs.replace(table, spectrum=rows)
            sensor = msgspec.structs.replace(sensor, **{name: table})
    return sensor
