"""The measurements of the paper's section III, on any simulated sensor, through the firmware.

Definitions are those of docs/calibration.md. Everything is measured on readings that the board
made with its integers; the stage knows the truth.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.polynomial import Chebyshev

from ..connect import upload
from ..frames import Spectrum, Touch
from ..sim.files import SensorFile
from .bound import Bound
from .fit import fit
from .presses import Noise, Presses
from .stage import Stage

PLACES = np.linspace(0.05, 0.95, 19)  # shares of the length, none of them used to calibrate
_FORCE_MN = 3000.0
_TEST_FORCES_MN = np.linspace(600.0, 9500.0, 16)
_TEST_FORCE_PLACES = (0.2, 0.5, 0.8)
_AT_REST = 25  # readings
_JITTERED = 40  # presses at each place
_JITTER_UM, _JITTER_FORCE = 50.0, 0.05
STRAINS_PERCENT = (0, 5, 10, 15, 20, 25)
BENDS_DEG = (0, 45, 90, 135, 180)
_JOINT_ANGLES = 31
_JOINT_SHARE = (0.1, 0.9)  # of the strip, that the indenter travels
_THRESHOLD_STEP_MN = 2.0
_LED_OFF, _TOO_DARK = 0x80, 0x04


@dataclass
class Run:
    """Everything that was measured, for figures and for the summary.

    Attributes
    ----------
    summary : dict
        The figures, as ``spots characterize --json`` prints them.
    series : dict of dict of arrays
        By figure, what is drawn in it.
    """

    summary: dict = field(default_factory=dict)
    series: dict = field(default_factory=dict)


class Rig:
    """A calibrated simulated strip that gives readings of known presses."""

    def __init__(self, sensor: SensorFile, seed: int, exposure_us: int, average: int):
        self.stage = Stage(sensor, seed, f"exposure_us={exposure_us}")
        self.board = self.stage.board
        self.average = average
        self.along = {0: self.stage.along()}
        self.pressed = self.stage.pressed()
        self.noise = Noise.of(self.along[0], self.pressed)
        self._use()

    def learn_strains(self) -> None:
        """Calibrate at each strain."""
        self.board.command("set average=1")
        for percent in STRAINS_PERCENT[1:]:
            self.stage.held.strain = percent / 100
            self.stage.reader.set_up()
            self.along[10_000 * percent] = self.stage.along(samples=12)
        self.stage.held.strain = 0.0
        self._use()

    def _use(self) -> None:
        conditions = self.stage.reader.conditions
        self.lines = fit(self.along, self.pressed, self.noise, conditions)
        upload(self.board, self.lines)
        self.board.command(f"set average={self.average}")
        self.board.command("dark", timeout_s=60)
        self.board.command("stream touch spectrum")

    @property
    def reading_us(self) -> int:
        """How long one reading takes."""
        return self.stage.reader.info["exposure_us"] * self.average

    def readings(self, position_um: float, force_mN: float, count: int):
        """Press and return `count` readings that began under the press, with their spectra."""
        self.stage.press(position_um, force_mN)
        begun_s = self.board.now_s() + 0.5e-6 * self.reading_us
        touches, spectra = [], []
        for frame in self.board.frames():
            if frame.time_s < begun_s or frame.flags & _LED_OFF:
                continue
            if isinstance(frame, Touch):
                touches.append(frame)
            elif isinstance(frame, Spectrum):
                spectra.append(frame.counts)
                if len(spectra) == count:
                    return touches[:count], np.array(spectra, dtype=float)
        raise AssertionError("frames() without an end ended")


def characterize(
    sensor: SensorFile,
    seed: int = 0,
    exposure_us: int = 100_000,
    average: int = 1,
    progress: Callable[[str], None] = lambda step: None,
) -> Run:
    """Measure a sensor.

    Parameters
    ----------
    sensor : SensorFile
    seed : int
        Of the noise.
    exposure_us, average : int
        Integration time, and how many of them make a reading.
    progress : callable
        Told each step's name as it begins.

    Raises
    ------
    SpotsError
        If the sensor cannot be calibrated at this exposure.
    """
    run = Run()
    progress("calibration")
    rig = Rig(sensor, seed, exposure_us, average)
    rng = np.random.default_rng(seed + 1)
    with rig.stage:
        progress("position")
        _position(rig, rng, run)
        progress("force")
        _force(rig, run)
        progress("bending")
        _bending(rig, rng, run)
        progress("joint")
        _joint(rig, run)
        progress("strain")
        rig.learn_strains()
        _strain(rig, rng, run)
    run.summary |= {
        "exposure_us": rig.stage.reader.info["exposure_us"],
        "average": average,
        "reading_ms": rig.reading_us / 1000,
        "plan": list(rig.stage.reader.conditions.plan),
    }
    return run


def _jittered(rig: Rig, rng, place_um: float, count: int):
    """Yield (truth_um, truth_mN, reading, counts) of presses scattered about a place."""
    for _ in range(count):
        at_um = place_um + rng.uniform(-_JITTER_UM, _JITTER_UM)
        force_mN = _FORCE_MN * (1 + rng.uniform(-_JITTER_FORCE, _JITTER_FORCE))
        (reading,), counts = rig.readings(at_um, force_mN, 1)
        yield at_um, force_mN, reading, counts[0]


def _position(rig: Rig, rng, run: Run) -> None:
    conditions = rig.stage.reader.conditions
    bound = Bound(
        rig.stage.sensor,
        conditions.plan,
        conditions.gain,
        conditions.exposure_us,
        conditions.led_mA,
        rig.average,
    )
    pair = OnePair(rig.along[0], rig.noise)
    x_um = PLACES * rig.stage.length_um
    columns = {name: [] for name in ("resolution", "accuracy", "bias", "scatter", "bound", "pair")}
    snr = []
    for place_um in x_um:
        rest, spectra = rig.readings(place_um, _FORCE_MN, _AT_REST)
        columns["resolution"].append(np.std([r.position_um for r in rest], ddof=1))
        light = spectra.sum(axis=1)
        snr.append(light.mean() / light.std(ddof=1))
        errors, pair_errors, bounds = [], [], []
        for at_um, force_mN, reading, counts in _jittered(rig, rng, place_um, _JITTERED):
            errors.append(reading.position_um - at_um)
            pair_errors.append(pair.position_um(counts) - at_um)
            bounds.append(bound.sigma(at_um, force_mN)[0])
        columns["accuracy"].append(np.mean(np.abs(errors)))
        columns["bias"].append(np.mean(errors))
        columns["scatter"].append(np.std(errors, ddof=1))
        columns["pair"].append(np.std(pair_errors, ddof=1))
        columns["bound"].append(np.sqrt(np.mean(np.square(bounds))))
    series = {name: np.array(values) for name, values in columns.items()}
    run.series["position"] = series | {
        "x_um": x_um,
        "along_um": rig.along[0].position_um,
        "log_ratio": pair.log_ratio(rig.along[0].counts),
        "pair_names": [conditions.plan[i] for i in pair.channels],
    }
    run.summary["position"] = {
        "r2": _r2(rig.along[0].position_um, pair.log_ratio(rig.along[0].counts)),
        "resolution_um": _mean(series["resolution"]),
        "accuracy_um": _mean(series["accuracy"]),
        "crb_ratio": _mean(series["scatter"] / series["bound"]),
        "one_pair": {
            "channels": run.series["position"]["pair_names"],
            "crb_ratio": _mean(series["pair"] / series["bound"]),
        },
    }
    run.summary["snr_db"] = round(20 * np.log10(np.mean(snr)), 1)


class OnePair:
    """The paper's estimate (Eq. 2): ln of the ratio of two channels, here the best two.

    Parameters
    ----------
    along : Presses
    noise : Noise
    """

    def __init__(self, along: Presses, noise: Noise):
        slopes = np.polyfit(along.position_um, along.logs, 1)[0]
        variance = noise.log_variance(along.counts).mean(axis=0)

        def sigma(pair):
            i, j = pair
            return np.sqrt(variance[i] + variance[j]) / max(abs(slopes[i] - slopes[j]), 1e-12)

        self.channels = min(itertools.combinations(range(len(slopes)), 2), key=sigma)
        self._curve = Chebyshev.fit(self.log_ratio(along.counts), along.position_um, 7)

    def log_ratio(self, counts: np.ndarray) -> np.ndarray:
        """Return ln of the ratio of the two channels."""
        i, j = self.channels
        return np.log(counts[..., j] / counts[..., i])

    def position_um(self, counts: np.ndarray) -> float:
        """Return the position by this pair alone."""
        return float(self._curve(self.log_ratio(counts)))


def _force(rig: Rig, run: Run) -> None:
    truth, errors, sigmas, brightness = [], [], [], []
    for share in _TEST_FORCE_PLACES:
        for force_mN in _TEST_FORCES_MN:
            readings, _ = rig.readings(share * rig.stage.length_um, force_mN, 8)
            forces = np.array([r.force_mN for r in readings])
            truth.append(force_mN)
            errors.append(forces.mean() - force_mN)
            sigmas.append(forces.std(ddof=1))
            brightness.append(np.mean([r.brightness for r in readings]))
    run.series["force"] = {
        "force_mN": np.array(truth),
        "error_mN": np.array(errors),
        "sigma_mN": np.array(sigmas),
        "brightness": np.array(brightness),
    }
    run.summary["force"] = {
        "resolution_mN": _mean(sigmas),
        "accuracy_N": round(float(np.mean(np.abs(errors))) / 1000, 5),
        "threshold_mN": _threshold_mN(rig),
    }


def _threshold_mN(rig: Rig) -> float:
    """Return the dead zone: the least force, in the middle of the strip, that gives a reading."""
    low, high = 0.0, _FORCE_MN
    while high - low > _THRESHOLD_STEP_MN:
        middle = (low + high) / 2
        readings, _ = rig.readings(rig.stage.length_um / 2, middle, 3)
        if any(r.flags & _TOO_DARK for r in readings):
            low = middle
        else:
            high = middle
    return round(high, 1)


def _accuracy_um(rig: Rig, rng) -> tuple[np.ndarray, np.ndarray]:
    """Return the places and the mean absolute error at each."""
    x_um = PLACES * rig.stage.length_um
    errors = [
        np.mean([abs(r.position_um - at) for at, _, r, _ in _jittered(rig, rng, place_um, 6)])
        for place_um in x_um
    ]
    return x_um, np.array(errors)


def _bending(rig: Rig, rng, run: Run) -> None:
    run.summary["bend"], run.series["bend"] = [], {}
    for degrees in BENDS_DEG:
        rig.stage.held.bend_deg = float(degrees)
        x_um, errors = _accuracy_um(rig, rng)
        run.series["bend"][degrees] = (x_um, errors)
        run.summary["bend"].append({"degrees": degrees, "accuracy_um": _mean(errors)})
    rig.stage.held.bend_deg = 0.0


def _strain(rig: Rig, rng, run: Run) -> None:
    run.summary["strain"], run.series["strain"] = [], {}
    for percent in STRAINS_PERCENT:
        rig.stage.held.strain = percent / 100
        rig.board.command(f"set strain_ppm={10_000 * percent}")
        x_um, errors = _accuracy_um(rig, rng)
        along = rig.along[10_000 * percent]
        pair = OnePair(rig.along[0], rig.noise)
        run.series["strain"][percent] = (
            x_um,
            errors,
            along.position_um,
            pair.log_ratio(along.counts),
        )
        run.summary["strain"].append({"percent": percent, "accuracy_um": _mean(errors)})
    rig.board.command("set strain_ppm=0")
    rig.stage.held.strain = 0.0


def _joint(rig: Rig, run: Run) -> None:
    joint = rig.stage.sensor.joint
    travel_um = np.array(_JOINT_SHARE) * rig.stage.length_um
    start_um = travel_um[0]
    span_deg = np.degrees(np.ptp(travel_um) / 1000 / joint.radius_mm)
    um_per_deg = 1000 * joint.radius_mm * np.pi / 180
    up = np.linspace(0, span_deg, _JOINT_ANGLES)
    # The indenter lags behind the joint by half its play in either direction.
    sweeps = {1: up, -1: up[::-1]}
    rows = []
    for direction, angles in sweeps.items():
        for angle in angles:
            at_um = start_um + (angle - direction * joint.play_deg / 2) * um_per_deg
            readings, _ = rig.readings(at_um, joint.force_mN, 4)
            positions = np.array([r.position_um for r in readings])
            rows.append((direction, angle, positions.mean(), positions.std(ddof=1)))
    direction, angle, position, sigma = np.array(rows).T
    # Every second angle calibrates, the others test.
    learn = np.arange(len(angle)) % 2 == 0
    slope, zero = np.polyfit(position[learn], angle[learn], 1)
    error = slope * position + zero - angle
    backlash = abs(error[direction > 0].mean() - error[direction < 0].mean())
    run.series["joint"] = {
        "direction": direction,
        "angle_deg": angle,
        "position_um": position,
        "error_deg": error,
    }
    run.summary["joint"] = {
        "r2": _r2(position, angle),
        "resolution_deg": round(abs(slope) * float(sigma.mean()), 5),
        "accuracy_deg": round(float(np.abs(error[~learn]).mean()), 5),
        "backlash_deg": round(float(backlash), 5),
    }


def _r2(x: np.ndarray, y: np.ndarray) -> float:
    residual = y - np.polyval(np.polyfit(x, y, 1), x)
    return round(1 - float((residual**2).sum() / ((y - y.mean()) ** 2).sum()), 6)


def _mean(values) -> float:
    return round(float(np.mean(values)), 3)
