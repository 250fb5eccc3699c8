"""Measures the position error of a finger that slides while another finger rests.

Run it with ``PYTHONPATH=tools python -m evidence.anchored 50``; the arguments are speeds of the
sliding finger in mm/s. The resting finger touches the strip first and is called the first finger.
"""

from __future__ import annotations

import argparse
import math
import random

from spots.advice.contact_finder import ContactFinder
from spots.cli.arguments import number
from spots.link.frames import Touch
from spots_device.fingers.contacts import PROVISIONAL
from spots_sim.demo.demo import open_fast
from spots_sim.strip.files import Finger, ScenarioFile
from spots_sim.strip.scenario import Scenario

_START_S = 3.0  # before this time, a virtual board takes its first dark frames
_EVERY_S = 0.05  # time between two points of a path
_APART_MM = 15.0  # smallest distance between the fingers, and length of the slide
_FORCE_MN = 3000.0
_SIGMA_MM = 3.0  # the applications use no position with a larger uncertainty
_SPEED = number("a speed in mm/s", 0.1, 10_000)
_SHARE = number("a share of the force", 0, 1)


def sliding(
    mm_per_s: float,
    seed: int,
    wobble: float = 0.1,
    places_mm: tuple[float, float, float] | None = None,
) -> ScenarioFile:
    """Return a scenario in which one finger rests, and a second finger slides beside it.

    `wobble` is the largest change of the second finger's force, as a share of it; that of the first
    finger is at most a tenth. `places_mm` is the position of the first finger, and the first and
    last position of the second, which stays on one side of the first. By default, the positions are
    random on a strip of 85 mm, at least 15 mm apart.
    """
    rng = random.Random(seed)
    while places_mm is None:
        first_mm, from_mm, to_mm = (rng.uniform(6, 79) for _ in range(3))
        side = 1 if from_mm > first_mm else -1
        if min(side * (from_mm - first_mm), side * (to_mm - first_mm), abs(to_mm - from_mm)) > (
            _APART_MM
        ):
            places_mm = first_mm, from_mm, to_mm
    first_mm, from_mm, to_mm = places_mm
    arrives_s = 0.5 + abs(to_mm - from_mm) / mm_per_s
    ends_s = arrives_s + 0.2

    def path(begins_s: float, ends_s: float, moving: bool, share: float) -> Finger:
        count = round((ends_s - begins_s) / _EVERY_S)
        points = []
        for i in range(count + 1):
            time_s = begins_s + i * _EVERY_S
            gone = min(max((time_s - 0.5) / (arrives_s - 0.5), 0.0), 1.0)
            at_mm = from_mm + gone * (to_mm - from_mm) if moving else first_mm
            force_mN = _FORCE_MN * (1 + rng.uniform(-share, share)) if 0 < i < count else 0.0
            points.append((_START_S + time_s, at_mm, force_mN))
        return Finger(points=points)

    fingers = [path(0.0, ends_s + 0.4, False, wobble / 10), path(0.3, ends_s, True, wobble)]
    return ScenarioFile(seconds=_START_S + ends_s + 1.0, touch=fingers)


def followed(file: ScenarioFile, seed: int) -> list[tuple[float, float]]:
    """Run a scenario of `sliding`; return errors and standard deviations of the second position.

    Both are in mm; the deviation is that of `ContactFinder`. Readings in which it does not find two
    fingers are left out, and those while the second finger arrives or lifts.
    """
    truth = Scenario(file)
    points = file.touch[1].points
    board, _ = open_fast("default", truth, seed)
    found = []
    with board:
        info = board.info
        finder = ContactFinder(info["length_um"] or 0, info["decay"], info["cross"])
        board.command("stream touch")
        for touch in board.frames(file.seconds - board.now_s()):
            if not isinstance(touch, Touch):
                continue
            contacts = [one for one in finder.take(touch) if one.state == PROVISIONAL]
            time_s = touch.time_s or 0.0
            if points[1][0] < time_s < points[-2][0] and len(contacts) == 2:
                at_mm = truth.presses(time_s)[1].position_mm
                second = contacts[1]
                found.append((second.position_um / 1000 - at_mm, second.sigma_um / 1000))
    return found


def summary(found: list[tuple[float, float]]) -> dict:
    """Return statistics of the position errors of `followed`, as a dict.

    `located_percent` is the share of positions whose standard deviation is at most 3 mm; the other
    values use only these. `rms_of_error_by_sigma` is the root mean square of error divided by
    standard deviation; it is 1 if the computed deviations are right.
    """
    located = [one for one in found if one[1] <= _SIGMA_MM]
    squares = sorted(error**2 for error, _ in located)
    shares = [(error / sigma) ** 2 for error, sigma in located]
    return {
        "readings": len(found),
        "located_percent": round(100 * len(located) / len(found), 1),
        "rms_mm": round(math.sqrt(sum(squares) / len(squares)), 2),
        "p95_mm": round(math.sqrt(squares[len(squares) * 95 // 100]), 2),
        "rms_of_error_by_sigma": round(math.sqrt(sum(shares) / len(shares)), 2),
    }


def main() -> None:
    """Parse the command line, and print the results for each speed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "mm_per_s", type=_SPEED, nargs="+", help="speed of the second finger in mm/s"
    )
    parser.add_argument("--seeds", type=int, default=20, help="number of runs at each speed (20)")
    parser.add_argument(
        "--wobble",
        type=_SHARE,
        default=0.1,
        help="largest change of the second finger's force, as a share of this force (0.1); the "
        "force of the first finger changes by at most a tenth of this share",
    )
    options = parser.parse_args()
    for speed in options.mm_per_s:
        runs = [
            followed(sliding(speed, seed, options.wobble), seed) for seed in range(options.seeds)
        ]
        print(f"{speed:g} mm/s: {summary([one for run in runs for one in run])}", flush=True)


if __name__ == "__main__":
    main()
