"""Prints the tables of `spots_sim.person.times` from a public data set of key presses.

Run it with the folder ``Facebook`` of https://github.com/AlvinKuruvilla/keystroke-data. Only
letters count. A burst is a run of touches that begin less than 1 s apart.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np

from spots_sim.person.times import PERCENT, SPEEDS

# The ten people of `times.PEOPLE`; the tables of `times.AT_SPEED` are of everybody.
_PEOPLE = "01", "05", "11", "13", "17", "18", "23", "25", "27", "98"
_BURST_S = 1.0
_STRETCH = 15  # touches, whose mean interval is the speed of a stretch
_LEAST = 600  # touches of a person who is counted
_LETTERS = frozenset("abcdefghijklmnopqrstuvwxyz")


def touches(path: Path) -> np.ndarray:
    """Return the touches of a file, one row each: start and end in s, in the order of the starts.

    Parameters
    ----------
    path : Path
        CSV file without a header: ``P`` (pressed) or ``R`` (released), key, time in ns.
    """
    with path.open(newline="", errors="replace") as lines:
        rows = [row for row in csv.reader(lines) if len(row) == 3 and row[2]]
    events = sorted((int(float(t)), kind, key.strip(" '").lower()) for kind, key, t in rows)
    down: dict[str, int] = {}
    found = []
    for time_ns, kind, key in events:
        if key not in _LETTERS:
            continue
        if kind == "P":
            down.setdefault(key, time_ns)
        elif key in down:
            began_ns = down.pop(key)
            if 5e6 < time_ns - began_ns < 1e9:  # other durations are lost events
                found.append((began_ns / 1e9, time_ns / 1e9))
    return np.array(sorted(found)).reshape(-1, 2)


def _stretches(people: list[np.ndarray]) -> dict[int, list[np.ndarray]]:
    # The holds and intervals of all stretches of about each of `SPEEDS`.
    found: dict[int, list[np.ndarray]] = {speed: [] for speed in SPEEDS}
    for one in people:
        for i in range(0, len(one) - _STRETCH, _STRETCH):
            held_s = np.diff(one[i : i + _STRETCH])[:, 0]
            intervals_s = np.diff(one[i : i + _STRETCH + 1, 0])
            mean_s = intervals_s.mean()
            for speed in SPEEDS:
                if intervals_s.max() < _BURST_S and 0.87 < 12 / mean_s / speed < 1.15:
                    found[speed].append(np.column_stack([held_s, intervals_s / mean_s]))
    return found


def _row(name: object, values: np.ndarray, scale: float, digits: int) -> str:
    at = np.round(scale * np.percentile(values, PERCENT), digits)
    return f"{name}: " + ", ".join(f"{value:.{digits}f}" for value in at)


def main(folder: Path) -> None:
    """Print, for each person and for each speed, the percentiles of holds and intervals."""
    for name in _PEOPLE:
        one = touches(folder / f"f_{name}.csv")
        held_s, intervals_s = one[:, 1] - one[:, 0], np.diff(one[:, 0])
        burst = intervals_s < _BURST_S
        overlap = (one[1:, 0] < one[:-1, 1])[burst].mean()
        print(f"{name}: {len(one)} touches, {100 * overlap:.0f} % overlap")
        print(_row("  held ms", held_s, 1000, 0))
        print(_row("  interval ms", intervals_s[burst], 1000, 0))
    everybody = [touches(path) for path in sorted(folder.glob("f_*.csv"))]
    everybody = [one for one in everybody if len(one) >= _LEAST]
    print(f"{len(everybody)} people, {sum(map(len, everybody))} touches")
    stretches = _stretches(everybody)
    at = {speed: np.concatenate(found) for speed, found in stretches.items()}
    print(_row("held ms", np.concatenate(list(at.values()))[:, 0], 1000, 0))
    for speed, all_of in at.items():
        overlap = (all_of[:, 1] * 12 / speed < all_of[:, 0]).mean()
        print(f"{speed} words a minute: {len(all_of)} touches, {100 * overlap:.0f} % overlap")
        print(_row("  interval / mean", all_of[:, 1], 1, 2))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
