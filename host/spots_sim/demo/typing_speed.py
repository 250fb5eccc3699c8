"""Measures the errors of fast typing on a virtual board.

Run it with ``python -m spots_sim.demo.typing_speed 60 100``; the arguments are speeds in
words a minute. In place of a speed, ``people`` measures ten people who type at their own speeds,
one in each run, and ``two-fingers`` measures touches of two fingers at the same time. ``together``
and ``together-near`` measure two fingers that touch within 15 ms, among single touches, ``chords``
such fingers again and again.
"""

from __future__ import annotations

import argparse
from collections import Counter
from hashlib import sha256
from statistics import median

import numpy as np
from msgspec.structs import replace

from spots.cli.arguments import number
from spots.keyboard.layout import load as load_layout
from spots_device import __version__

from ..person.hands import HANDS
from ..person.stage import calibrate
from ..person.typist import fast_typing, together, two_fingers
from ..strip.files import ScenarioFile, SensorFile, load
from ..strip.scenario import Scenario
from .demo import open_fast
from .demo_applications import type_on_board

_COUNTS = "touches", "right", "wrong", "missed", "extra", "no_finger", "stuck"
PEOPLE, TWO_FINGERS = "people", "two-fingers"
# Fingers that do not type one after the other; arguments of `typist.together`.
_TOGETHER = {
    "together": {},
    "together-near": {"apart_mm": (10.0, 20.0)},
    "chords": {"alone": True},
}
_SPEED = number("a speed in words a minute", 1, 1000)
_SURE = 1.96  # standard deviations of a normal distribution in which 95 % of the values are


def _who(text: str) -> float | str:
    return text if text in (PEOPLE, TWO_FINGERS, *_TOGETHER) else _SPEED(text)


def typed(
    who: float | str,
    touches: int,
    seed: int,
    sensor: str = "default",
    rezeroed: bool = False,
    warm: bool = False,
    lines: tuple[str, ...] | None = None,
    layout: str = "digits",
    hands: str = "usual",
    world: dict | None = None,
) -> dict:
    """Type random keys on a virtual board in simulated time, and return the results.

    `who` is a speed in words a minute, of five keys each; `PEOPLE` for the person number `seed`
    modulo 10 at the own speed, see `typist.fast_typing`; or `TWO_FINGERS` or a key of `_TOGETHER`
    for pairs of fingers, which always have the usual hands. `rezeroed`, `warm` and `lines` are
    those of `demo.open_fast`. `world` has other attributes of `files.ScenarioFile`, such as
    ``bend_deg``. The results are those of `demo_applications.type_on_board`; ``late_ms`` is the
    latency of each correct press.
    """
    what = load_layout(layout), touches, load(SensorFile, sensor).length_mm, seed
    file = replace(_file(who, *what, hands), **(world or {}))
    truth = Scenario(file)
    board, _ = open_fast(sensor, truth, seed, rezeroed=rezeroed, warm=warm, lines=lines)
    late_ms: list[float] = []
    with board:
        seconds = file.seconds - board.now_s()
        run = type_on_board(board, truth, 0.0, seconds, True, layout, late_ms)
    return {**run, "late_ms": late_ms}


def _file(who, layout, touches, length_mm, seed, hands) -> ScenarioFile:
    if who == TWO_FINGERS:
        return two_fingers(layout, touches, length_mm, seed)
    if who in _TOGETHER:
        return together(layout, touches, length_mm, seed, **_TOGETHER[who])
    words_per_min = None if who == PEOPLE else who
    return fast_typing(layout, words_per_min, touches, length_mm, seed, hands=HANDS[hands])


def interval_percent(count: int, total: int) -> tuple[float, float]:
    """Return the 95 % confidence interval of a share, in per cent, by Wilson's method.

    With 0 events, the upper limit is about 380 / `total`. Source: E. B. Wilson, J. Am. Stat. Assoc.
    22, 209 (1927), doi 10.1080/01621459.1927.10502953.
    """
    share, z2 = count / total, _SURE**2 / total
    middle = (share + z2 / 2) / (1 + z2)
    half = _SURE / (1 + z2) * (share * (1 - share) / total + z2 / (4 * total)) ** 0.5
    return 100 * max(middle - half, 0.0), 100 * min(middle + half, 1.0)


def evidence_seed() -> int:
    """Return the first seed of published figures: computed from the version, so nobody chooses it.

    Use smaller seeds to tune the firmware.
    """
    return 100_000 + int(sha256(__version__.encode()).hexdigest(), 16) % 900_000


def added(runs: list[dict]) -> dict:
    """Return the sums of the counts of several runs of `typed`, and their latencies.

    ``error_percent`` is the number of wrong, missed and extra keys per hundred touches; ``causes``
    has their number in each circumstance, see `typing_errors`.
    ``error_interval_percent`` and ``no_finger_interval_percent`` are the 95 % confidence intervals
    of the errors and of the keys that no finger touched. ``latency_ms`` is the largest of the runs'
    percentiles, ``median_latency_ms`` their median, ``pooled_latency_ms`` the percentile over all
    presses of all runs.
    """
    total = {name: sum(run[name] for run in runs) for name in _COUNTS}
    off = total["wrong"] + total["missed"] + total["extra"]
    late = {p: [run["latency_ms"][p] for run in runs] for p in ("p50", "p99")}
    pooled = [one for run in runs for one in run["late_ms"]]
    causes: Counter[str] = Counter()
    for run in runs:
        causes.update(run["causes"])
    return {
        **total,
        "causes": dict(causes.most_common()),
        "error_percent": round(100 * off / total["touches"], 2),
        "error_interval_percent": _interval(off, total),
        "no_finger_interval_percent": _interval(total["no_finger"], total),
        "latency_ms": {p: max(of_runs) for p, of_runs in late.items()},
        "median_latency_ms": {p: median(of_runs) for p, of_runs in late.items()},
        "pooled_latency_ms": {f"p{p}": round(float(np.percentile(pooled, p)), 1) for p in (50, 99)},
    }


def _interval(count: int, total: dict) -> list[float]:
    return [round(limit, 2) for limit in interval_percent(count, total["touches"])]


def main() -> None:
    """Parse the command line, and print the results for each speed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "who",
        type=_who,
        nargs="+",
        help="speed in words a minute, of five keys each; or one of "
        + ", ".join((PEOPLE, TWO_FINGERS, *_TOGETHER)),
    )
    parser.add_argument(
        "--touches", type=int, default=150, help="number of touches in each run (150)"
    )
    parser.add_argument("--seeds", type=int, default=10, help="number of runs at each speed (10)")
    parser.add_argument("--first-seed", type=int, default=0, help="seed of the first run (0)")
    parser.add_argument(
        "--exposure-us", type=int, help="exposure in us; by default, the board searches for one"
    )
    parser.add_argument("--layout", default="digits", help="a key layout: name or path (digits)")
    parser.add_argument(
        "--hands", choices=HANDS, default="usual", help="how the simulated fingers move (usual)"
    )
    parser.add_argument("--sensor", default="default", help="sensor file: path or name (default)")
    parser.add_argument(
        "--rezero",
        action="store_true",
        help="correct the calibration with simulated presses after the change in the sensor file",
    )
    parser.add_argument("--warm", action="store_true", help="start with a warm LED")
    options = parser.parse_args()
    lines = None
    if options.exposure_us:
        lines = calibrate(load(SensorFile, options.sensor), options.exposure_us)
    strip = options.sensor, options.rezero, options.warm, lines, options.layout, options.hands
    for who in options.who:
        seeds = range(options.first_seed, options.first_seed + options.seeds)
        runs = [typed(who, options.touches, seed, *strip) for seed in seeds]
        name = who if isinstance(who, str) else f"{who:g} words a minute"
        print(f"{name}: {added(runs)}", flush=True)


if __name__ == "__main__":
    main()
