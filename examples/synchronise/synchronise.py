"""Find the clock of another device in a recording, by taps that both have seen.

Tap the strip five times or more while both record, some taps at the beginning and some at the end.
The CSV file of the other device has two columns: its time in s, and a signal that rises with each
tap, such as a force. Prints how to convert its times to the times of the recording's exports.
"""

import argparse
import csv

import numpy as np

import spots

LEAST_S = 0.15  # two taps are farther apart than this


def onsets_s(times_s: np.ndarray, signal: np.ndarray) -> np.ndarray:
    """Return when the signal rises through half of its largest value; times between two samples."""
    level = np.nanmax(signal) / 2
    above = np.nan_to_num(signal) > level
    at = np.flatnonzero(above[1:] & ~above[:-1])
    share = (level - signal[at]) / (signal[at + 1] - signal[at])
    found = times_s[at] + share * (times_s[at + 1] - times_s[at])
    return found[np.diff(found, prepend=-np.inf) > LEAST_S]


def fitted(ours_s: np.ndarray, theirs_s: np.ndarray) -> tuple[float, float, float]:
    """Return offset, rate and their error in s: ours = offset + rate * theirs, from the same taps.

    The error is the standard error of a converted time in the middle of the taps.
    """
    count = min(len(ours_s), len(theirs_s))
    if count < 3 or len(ours_s) != len(theirs_s):
        raise SystemExit(
            f"{len(ours_s)} and {len(theirs_s)} taps were found: tap again, and clearly"
        )
    rate, offset_s = np.polyfit(theirs_s, ours_s, 1)
    left_s = ours_s - (offset_s + rate * theirs_s)
    return offset_s, rate, float(np.sqrt((left_s**2).sum() / (count - 2) / count))


def main() -> None:
    """Read both files, and print the conversion."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", help="file of 'spots record'")
    parser.add_argument("other", help="CSV file of the other device: time in s, signal")
    options = parser.parse_args()
    try:
        table = spots.read_dataframe(options.recording)
    except spots.SpotsError as error:
        parser.error(str(error))
    with open(options.other, newline="") as file:
        rows = [row[:2] for row in csv.reader(file) if row[0][:1].isdigit()]
    other = np.array(rows, float)
    force = table.force_mN.fillna(0).to_numpy()
    ours_s = onsets_s(table.time_s.to_numpy(), force)
    theirs_s = onsets_s(other[:, 0], other[:, 1])
    offset_s, rate, error_s = fitted(ours_s, theirs_s)
    print(f"time_s = {offset_s:.6f} + {rate:.9f} * their time, +- {1000 * error_s:.2f} ms")


if __name__ == "__main__":
    main()
