"""Measures a simulated sensor as section III of the paper does, through the firmware.

docs/science/definitions.md defines resolution, accuracy, bias and noise. All readings come from
the real firmware; the simulated stage gives the true position and force.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from spots.calibrate.fit.decoded import coarse_of
from spots.errors import SettingError
from spots_device.reading.calibration import Calibration
from spots_device.reading.decode import TOO_DARK, TOUCHING

from ..strip.change import NAMES, NONE, Change
from ..strip.files import SensorFile
from .bound import Bound
from .pair import OnePair
from .rezeroed import NO_HAND, Hand, age
from .rig import Rig

PLACES = np.linspace(0.05, 0.95, 19)  # shares of the length; the calibration uses others
FORCE_MN = 3000.0
STRAINS_PERCENT = (0, 5, 10, 15, 20, 25)
BENDS_DEG = (0, 45, 90, 135, 180)
_FORCES_MN = (600.0, 9500.0)
_FORCE_STEPS = 16
_FORCE_PLACES = np.linspace(0.05, 0.95, 5)
_JITTER_UM, _JITTER_FORCE = 50.0, 0.05  # largest offset; the force as a share of `FORCE_MN`
_JOINT_ANGLES = 31
_JOINT_MOST_DEG = 180.0
_THRESHOLD_STEP_MN = 2.0
_LIFT_S = 0.5  # between two places, so that the board measures the light that sticks
# Number of readings or presses of each kind; reduced if a reading takes long.
_AT_REST = 40
_JITTERED = 80
_ACCURACY = 14
_HELD = 6
_LEAST = 5
# Largest cost of a reading, in ms, at which no reading is left out. The cost is the duration of the
# reading plus 30 ms for each sample, because the simulator needs time for both.
_ALL_UP_TO_MS, _SAMPLE_MS = 140, 30


@dataclass
class Run:
    """Results of a characterisation.

    `summary` is what ``spots characterize --json`` prints. Keys end in their units; ``crb`` is the
    Cramer-Rao bound. `series` has the arrays for the figures by measurement, such as ``position``,
    and by name, such as ``x_um``.
    """

    summary: dict = field(default_factory=dict)
    series: dict = field(default_factory=dict)


def characterize(
    sensor: SensorFile,
    seed: int = 0,
    exposure_us: int = 100_000,
    average: int = 1,
    progress: Callable[[str], None] = lambda step: None,
    change: Change = NONE,
    hand: Hand = NO_HAND,
) -> Run:
    """Measure the accuracy of a simulated sensor.

    Position and force are measured on the flat strip. Position is also measured on the bent and on
    the stretched strip, and the angle of a joint with the strip in the joint. `change` is added to
    the table ``[change]`` of the sensor file. After it, `hand` re-zeroes the calibration with a few
    presses. ``progress(name)`` is called at the start of each step. SpotsError if the sensor cannot
    be calibrated at this exposure.
    """
    run = Run()
    rng = np.random.default_rng(seed + 1)
    progress("exposure and calibration")
    change = sensor.change + change
    with Rig(sensor, seed, exposure_us, average) as rig:
        touch_mN = Calibration(rig.lines).touch_on_mN
        if touch_mN > FORCE_MN:
            raise SettingError(
                f"this strip needs {touch_mN / 1000:g} N for a touch, but is measured with "
                f"{FORCE_MN / 1000:.0f} N: choose a brighter strip or a longer exposure"
            )
        drift = age(rig, change, hand, seed)
        progress("position")
        _position(rig, rng, run)
        progress("force")
        _force(rig, run)
        progress("bending")
        _bending(rig, rng, run)
        progress("joint")
        _joint(rig, run)
        progress("strain")
        _strain(rig, rng, run)
        conditions = rig.conditions
        run.summary |= {
            "exposure_us": conditions.exposure_us,
            "average": average,
            "reading_ms": rig.reading_us / 1000,
            "gain": conditions.gain,
            "led_mA": conditions.led_mA,
            "plan": list(conditions.plan),
            "change": {name: getattr(change, name) for name in NAMES if getattr(change, name)},
            "rezero": vars(hand) | {"drift": drift},
        }
    return run


def crb_ratio(rig: Rig, seed: int, jittered: int = _JITTERED) -> float:
    """Return the standard deviation of the measured position divided by its Cramer-Rao bound.

    It is the mean over `PLACES`, with `jittered` presses at each; 1 for an efficient estimator.
    """
    rng = np.random.default_rng(seed)
    bound, pair = bound_of(rig), OnePair(rig.along[0], rig.noise)
    ratios = [
        scatter / least
        for _, scatter, _, least, _ in (
            _scatter(rig, rng, share * rig.stage.length_um, jittered, bound, pair)
            for share in PLACES
        )
    ]
    return _mean(ratios)


def bound_of(rig: Rig) -> Bound:
    """Return the Cramer-Rao bound of a calibrated strip's readings, for its present settings."""
    c = rig.conditions
    return Bound(
        rig.stage.sensor,
        c.plan,
        c.gain,
        c.exposure_us,
        c.led_mA,
        rig.average,
        rig.stage.held.changed,
    )


def _fewer(rig: Rig, count: int) -> int:
    cost_ms = rig.reading_us / 1000 + _SAMPLE_MS * rig.average
    return min(count, max(_LEAST, round(count * _ALL_UP_TO_MS / cost_ms)))


def _jittered(rig: Rig, rng, place_um: float, count: int):
    """Press `count` times around `place_um`, with random offsets of position and force.

    Yields a tuple for each press: true position in um, true force in mN, reading, counts.
    """
    for _ in range(count):
        at_um = place_um + rng.uniform(-_JITTER_UM, _JITTER_UM)
        force_mN = FORCE_MN * (1 + rng.uniform(-_JITTER_FORCE, _JITTER_FORCE))
        (reading,), counts = rig.readings(at_um, force_mN, 1)
        yield at_um, force_mN, reading, counts[0]


def _scatter(rig: Rig, rng, place_um: float, count: int, bound: Bound, pair: OnePair):
    """Press `count` times around `place_um`; compare the position errors with the Cramer-Rao bound.

    Returned are, in um: the errors, shape (count,), their standard deviation, that of the estimate
    `pair` from two channels, and the bound; then the share of untrusted readings in per cent.
    """
    true_um, _, readings, counts = zip(*_jittered(rig, rng, place_um, count))
    errors = np.array([r.position_um for r in readings]) - true_um
    untrusted = 100 * np.mean([not r.trusted for r in readings])
    pair_errors = pair.position_um(np.array(counts)) - true_um
    # The bound is nearly linear over this short distance, so its mean is its value in the middle.
    least, _ = bound.sigma(place_um, FORCE_MN)
    return errors, errors.std(ddof=1), pair_errors.std(ddof=1), least, untrusted


def _position(rig: Rig, rng, run: Run, places=PLACES) -> None:
    pair, bound = OnePair(rig.along[0], rig.noise), bound_of(rig)
    x_um = places * rig.stage.length_um
    names = ("resolution", "accuracy", "bias", "rms", "scatter", "bound", "pair", "untrusted")
    columns = {name: [] for name in names}
    snr = []
    for place_um in x_um:
        rig.lift(_LIFT_S)
        rest, samples = rig.readings(place_um, FORCE_MN, _fewer(rig, _AT_REST))
        columns["resolution"].append(np.std([r.position_um for r in rest], ddof=1))
        if rig.average == 1:
            snr.append(_light_over_noise(samples))
        count = _fewer(rig, _JITTERED)
        errors, *found = _scatter(rig, rng, place_um, count, bound, pair)
        scatter, by_pair, least, untrusted = found
        columns["accuracy"].append(np.mean(np.abs(errors)))
        columns["bias"].append(np.mean(errors))
        columns["rms"].append(np.sqrt(np.mean(errors**2)))
        columns["untrusted"].append(untrusted)
        columns["scatter"].append(scatter)
        columns["bound"].append(least)
        columns["pair"].append(by_pair / least)
    series = {name: np.array(values) for name, values in columns.items()}
    if rig.average > 1:
        series["pair"], snr = _of_one_sample(rig, rng, pair, x_um)
    along = rig.along[0]
    response = pair.log_ratio(along.counts)
    channels = [rig.conditions.plan[i] for i in pair.channels]
    run.series["position"] = series | {
        "x_um": x_um,
        "along_um": along.position_um,
        "log_ratio": response,
        "channels": channels,
    }
    run.summary["position"] = {
        "r2": _r2(along.position_um, along.logs @ np.array(coarse_of(Calibration(rig.lines)))),
        "resolution_um": _mean(series["resolution"]),
        "accuracy_um": _mean(series["accuracy"]),
        "bound_um": _mean(series["bound"]),
        "crb_ratio": _mean(series["scatter"] / series["bound"]),
        "rms_ratio": _mean(series["rms"] / series["bound"]),
        "untrusted_percent": _mean(series["untrusted"]),
        "one_pair": {
            "channels": channels,
            "scatter_um": _mean(series["pair"] * series["bound"]),
            "crb_ratio": _mean(series["pair"]),
        },
    }
    run.summary["snr_db"] = round(20 * np.log10(np.mean(snr)), 1)


def _light_over_noise(counts: np.ndarray) -> float:
    light = counts.sum(axis=1)
    return light.mean() / light.std(ddof=1)


def _of_one_sample(rig: Rig, rng, pair: OnePair, x_um) -> tuple[np.ndarray, list[float]]:
    """Return for each position of the estimate `pair` scatter by bound, and signal-to-noise ratio.

    Readings of several samples cannot be used: the board rounds their mean counts, and this changes
    the noise.
    """
    average = rig.average
    rig.set_average(1)
    bound = bound_of(rig)
    ratios, snr = [], []
    for place_um in x_um:
        _, counts = rig.readings(place_um, FORCE_MN, _AT_REST)
        snr.append(_light_over_noise(counts))
        _, _, scatter, least, _ = _scatter(rig, rng, place_um, _JITTERED // 4, bound, pair)
        ratios.append(scatter / least)
    rig.set_average(average)
    return np.array(ratios), snr


def _force(rig: Rig, run: Run) -> None:
    threshold_mN, bound = _threshold_mN(rig), bound_of(rig)
    least_mN = max(_FORCES_MN[0], 2 * threshold_mN)
    rows = []
    for share in _FORCE_PLACES:
        rising = np.linspace(least_mN, _FORCES_MN[1], _FORCE_STEPS)
        # Forces fall again without a release, which shows the hysteresis.
        for force_mN in (*rising, *rising[::-1]):
            held, _ = rig.readings(share * rig.stage.length_um, force_mN, _fewer(rig, _HELD))
            forces = np.array([r.force_mN for r in held], dtype=float)
            errors = forces - force_mN
            brightness = np.mean([r.brightness for r in held])
            rows.append(
                (
                    share,
                    force_mN,
                    errors.mean(),
                    np.abs(errors).mean(),
                    forces.std(ddof=1),
                    brightness,
                    bound.force_sigma_mN(share * rig.stage.length_um, force_mN),
                )
            )
    share, truth, error, accuracy, sigma, brightness, least = np.array(rows).T
    run.series["force"] = {
        "share": share,
        "force_mN": truth,
        "error_mN": error,
        "sigma_mN": sigma,
        "brightness": brightness,
        "threshold_mN": threshold_mN,
    }
    run.summary["force"] = {
        "resolution_mN": _mean(sigma),
        "bound_mN": _mean(least),
        "accuracy_N": round(float(np.mean(accuracy)) / 1000, 5),
        "threshold_mN": threshold_mN,
    }


def _threshold_mN(rig: Rig) -> float:
    """Return the least force in mN at which a press in the strip's middle gives a position."""
    low, high = 0.0, FORCE_MN
    while high - low > _THRESHOLD_STEP_MN:
        middle = (low + high) / 2
        rig.readings(rig.stage.length_um / 2, 0.0, 1)  # so that each press is a first load
        readings, _ = rig.readings(rig.stage.length_um / 2, middle, 3)
        if any(r.flags & (TOO_DARK | TOUCHING) == TOO_DARK for r in readings):
            low = middle
        else:
            high = middle
    rig.settle()  # the board may have taken a press below the threshold for light without a press
    return round(high, 1)


def _accuracy_um(rig: Rig, rng) -> np.ndarray:
    """Measure the position accuracy along a calibrated strip, with random presses.

    Returns an array of shape (3, n) for n positions: positions, mean errors and mean absolute
    errors, all in um.
    """
    x_um = PLACES * rig.stage.length_um
    count = _fewer(rig, _ACCURACY)
    rows = []
    for place_um in x_um:
        rig.lift(_LIFT_S)
        rows.append([r.position_um - at for at, _, r, _ in _jittered(rig, rng, place_um, count)])
    errors = np.array(rows)
    return np.array([x_um, errors.mean(axis=1), np.abs(errors).mean(axis=1)])


def _flat(run: Run) -> np.ndarray:
    """Return the errors of the flat, unstretched strip, in the form that `_accuracy_um` returns."""
    position = run.series["position"]
    return np.array([position["x_um"], position["bias"], position["accuracy"]])


def _bending(rig: Rig, rng, run: Run) -> None:
    run.summary["bend"], run.series["bend"] = [], {}
    for degrees in BENDS_DEG:
        rig.stage.held.bend_deg = float(degrees)
        found = _accuracy_um(rig, rng) if degrees else _flat(run)
        run.series["bend"][degrees] = found
        run.summary["bend"].append({"degrees": degrees, "accuracy_um": _mean(found[2])})
    rig.stage.held.bend_deg = 0.0


def _strain(rig: Rig, rng, run: Run) -> None:
    rig.learn_strains(STRAINS_PERCENT[1:])
    pair = OnePair(rig.along[0], rig.noise)
    bound = bound_of(rig)
    run.summary["strain"], run.series["strain"] = [], {}
    for percent in STRAINS_PERCENT:
        rig.stage.held.strain = percent / 100
        rig.board.command(f"set strain_ppm={10_000 * percent}")
        found = _accuracy_um(rig, rng) if percent else _flat(run)
        along = rig.along[10_000 * percent]
        run.series["strain"][percent] = {
            "accuracy": found,
            "along_um": along.position_um,
            "log_ratio": pair.log_ratio(along.counts),
        }
        least = [bound.sigma(x_um, FORCE_MN, strain=percent / 100)[0] for x_um in found[0]]
        run.summary["strain"].append(
            {"percent": percent, "accuracy_um": _mean(found[2]), "bound_um": _mean(least)}
        )
    rig.board.command("set strain_ppm=0")
    rig.stage.held.strain = 0.0


def _joint(rig: Rig, run: Run) -> None:
    up = np.linspace(0, min(rig.stage.sensor.joint_travel_deg, _JOINT_MOST_DEG), _JOINT_ANGLES)
    held = _fewer(rig, _HELD)
    rows, angles = [], []
    for direction, sweep in {1: up, -1: up[::-1]}.items():
        for angle in sweep:
            readings, _ = rig.turned(angle, direction, held)
            rows.append([r.position_um for r in readings])
            angles.append((direction, angle))
    rig.stage.held.bend_deg = 0.0
    (direction, angle), position = np.array(angles).T, np.array(rows, dtype=float)
    # Every second angle is for the fit, the others for the test. Errors are of single readings.
    learn = np.arange(len(angle)) % 2 == 0
    slope, zero = np.polyfit(position[learn].ravel(), np.repeat(angle[learn], held), 1)
    error = slope * position + zero - angle[:, None]
    backlash = abs(error[direction > 0].mean() - error[direction < 0].mean())
    run.series["joint"] = {
        "direction": direction,
        "angle_deg": angle,
        "position_um": position.mean(axis=1),
        "error_deg": error.mean(axis=1),
        "tested": ~learn,
    }
    run.summary["joint"] = {
        "r2": _r2(position.ravel(), np.repeat(angle, held)),
        "resolution_deg": round(abs(slope) * float(position.std(axis=1, ddof=1).mean()), 5),
        "accuracy_deg": round(float(np.abs(error[~learn]).mean()), 5),
        "backlash_deg": round(float(backlash), 5),
    }


def _r2(x: np.ndarray, y: np.ndarray) -> float:
    residual = y - np.polyval(np.polyfit(x, y, 1), x)
    return round(1 - float((residual**2).sum() / ((y - y.mean()) ** 2).sum()), 8)


def _mean(values) -> float:
    return round(float(np.mean(values)), 3)
