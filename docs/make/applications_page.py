"""Writes docs/evidence/applications.md: errors of keyboard and controller, on three strips."""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from spots.common import atomic
from spots_sim.demo.demo import demo
from spots_sim.demo.typing_speed import added, evidence_seed, typed
from spots_sim.measure.figures import folder
from spots_sim.measure.typing_errors import CAUSES
from spots_sim.person.stage import calibrate
from spots_sim.strip.files import SensorFile, load

# Name of the column; sensor file; whether the calibration was corrected after the change of the
# strip (re-zero); whether the LED is warm at the start.
STRIPS = (
    ("ideal strip", "default", False, False),
    ("aged strip, not re-zeroed", "real", False, True),
    ("aged strip, re-zeroed", "real", True, True),
    ("aged strip, re-zeroed, LED cold", "real", True, False),
    ("home-made strip, re-zeroed", "first", True, True),
)
WORDS_PER_MIN = (60, 100)
TOUCHES = 200
SEEDS = 15
# The rows that others quote have more touches: their speeds, and the number of their seeds.
HEADLINES = (60, "people")
HEADLINE_SEEDS = 100
EXPOSURE_US = 5000
FIVE_KEYS = """name = "five"
[[layer]]
name = "five"
keys = ["1", "2", "3", "4", "5"]
"""
# Rows of the second table: name, and arguments of `typed`.
FINGERS = (
    ("ten people at their own speeds", "people", {}),
    ("40 words a minute", 40, {}),
    ("80 words a minute", 80, {}),
    ("100 words a minute, exposure of 5 ms", 100, {"exposure": True}),
    ("120 words a minute, only five keys", 120, {"five": True}),
    ("60 words a minute, fingers 14 to 18 mm wide", 60, {"hands": "wide"}),
    ("the same, force trembles by 15 to 30 %", 60, {"hands": "trembling"}),
    ("the same, fingers roll by 2 to 3 mm", 60, {"hands": "rolling"}),
    ("the same, fingers slide by 3 to 6 mm in a lift of 12 to 30 ms", 60, {"hands": "sliding"}),
    ("the same, in a lift of 30 to 60 ms", 60, {"hands": "sliding-slowly"}),
    ("the same, the palm rests at the far end", 60, {"hands": "resting-palm"}),
    ("the same, the palm wobbles", 60, {"hands": "wobbling-palm"}),
    (
        "two fingers whose touches overlap, the second 30 to 150 ms later, 9 to 60 mm apart",
        "two-fingers",
        {},
    ),
    (
        "two fingers that touch within 15 ms, 20 to 45 mm apart, after each single touch",
        "together",
        {},
    ),
    ("the same, 10 to 20 mm apart", "together-near", {}),
    ("the same, 20 to 45 mm apart, without single touches", "chords", {}),
)
_SECONDS = 10.0
_TEXT = """# Typing and controller, on simulated strips

`make paper` writes this document, and measures all numbers. It compares the errors of typing and of
the game controller on simulated strips. **Nobody has measured a person on a real strip.**

| strip | sensor file | what it is |
|---|---|---|
| ideal | `default` | has not changed since its calibration |
| aged | `real` | has aged and warmed up since its calibration, and is under a lamp |
| home-made | `first` | has [assumed effects](../science/sensor-files.md) of home-made strips |

The aged strip has a [drift](../calibrate/drift.md): wrong positions. It was re-zeroed with one
press of each mark (a known position), after the LED had warmed up. The column "LED cold" is
measured after power-on, while the LED warms up.

For each seed, a simulated person types {touches} touches on ten keys, with exposures of 10 ms.
Usual fingers at 60 words a minute and the ten people have {headline_seeds} seeds: {most} touches.
Other rows have {seeds} seeds: {all} touches. The first seed is computed from the version of
SPOTS, so nobody chooses it.

The times are those of real people on usual keyboards, and the forces are from a publication
([times](../../host/spots_sim/person/times.py), [hands](../../host/spots_sim/person/hands.py)).
"Errors" are wrong, missed and extra keys; "no finger" are wrong or extra keys that no finger
touched. Both are in per cent of the touches.

The 95 % confidence interval (Wilson) follows in brackets. It contains the chance of these touches
only: a real person or strip may differ by more. The latency is the time from the start of a touch
to the report of the correct key; its percentiles are those of all touches.

In the rows `controller`, the simulated fingers of the demo move the axes of the game controller for
{seconds:g} s. The rms error is the difference between X and the value for the true position of the
finger, including lag.

The largest jump is the largest step of X between two states, minus the
finger's movement. Both are in per cent of the range from rest to an end. A return to rest up to 0.1
s before the finger lifts is no jump.

These commands measure the column "aged strip, re-zeroed":

<!-- not run: they take some minutes -->
```sh
python -m spots_sim.demo.typing_speed 60 {headline} --sensor real --rezero --warm
python -m spots_sim.demo.typing_speed 100 {same_seeds} --sensor real --rezero --warm
spots demo --use controller --fast --json --seconds {seconds:g} --sensor real --rezero --warm
```

"""


_FINGERS = """
## Other speeds, and fingers that roll, slide or tremble

This table shows the ideal strip. The sizes of the behaviours are *assumed*: nobody has measured
fingers on a strip. In each row, all fingers behave so;
[the typist](../../host/spots_sim/person/typist.py) describes the pairs of two fingers.

A finger that rolls or slides is one key, because a position within 4.5 mm of a finger is taken for
this finger. Most of the remaining errors occur when a finger moves or changes its force while the
next finger touches. These commands measure the row "roll by 2 to 3 mm" and the row of two fingers:

<!-- not run: they take some minutes -->
```sh
python -m spots_sim.demo.typing_speed 60 {same_seeds} --hands rolling
python -m spots_sim.demo.typing_speed two-fingers {same_seeds}
```

In a scenario, the keys `width_mm`, `roll_mm`, `slide_mm` and `tremor_percent` of a `[[touch]]` give
a finger the same behaviours.

"""


_CAUSES = """
## In which circumstances errors occur

The columns have the errors of usual fingers on the ideal strip, in {most} touches. Each error is
counted once, in the first row that applies, see
[the rules](../../host/spots_sim/measure/typing_errors.py).

"""


def _run(who: float | str, *strip, **options) -> dict:
    """Type as `typed` does, with the seeds of the row of `who`, and return the sums."""
    usual = options.get("hands", "usual") == "usual"
    count = HEADLINE_SEEDS if usual and who in HEADLINES else SEEDS
    first = evidence_seed()
    seeds = range(first, first + count)
    one = partial(_typed, who, TOUCHES, strip, options)
    with ProcessPoolExecutor() as pool:  # alone, the page takes 40 minutes
        return added(list(pool.map(one, seeds)))


def _typed(who: float | str, touches: int, strip: tuple, options: dict, seed: int) -> dict:
    return typed(who, touches, seed, *strip, **options)


def measured(causes: dict[str, dict]) -> list[tuple[str, list[str]]]:
    """Return the table's rows: the name of a quantity, and its value for each of `STRIPS`.

    Adds to `causes` the errors of the headline row on the ideal strip, see `typing_errors`.
    """
    rows = []
    for speed in WORDS_PER_MIN:
        print(f"typing, {speed} words a minute ...", file=sys.stderr)
        runs = [_run(speed, *strip) for _, *strip in STRIPS]
        if speed in HEADLINES:
            causes[f"{speed} words a minute"] = runs[0]["causes"]
        rows.append((f"{speed} words a minute: errors, no finger", [_typing(run) for run in runs]))
        rows.append((f"{speed} words a minute: latency p50, p99", [_latency(run) for run in runs]))
    print("controller ...", file=sys.stderr)
    played = [
        demo(sensor, None, 0, _SECONDS, True, True, "controller", None, *strip)
        for _, sensor, *strip in STRIPS
    ]
    for what, name in (
        ("controller: rms error of the axis X", "x_rms_percent"),
        (
            "controller: largest jump of X beyond the finger's movement",
            "largest_unexplained_jump_percent",
        ),
    ):
        rows.append((what, [f"{run[name]:.1f} %" for run in played]))
    rows.append(("controller: states sent", [str(run["states"]) for run in played]))
    return rows


def fingers(causes: dict[str, dict]) -> list[tuple[str, list[str]]]:
    """Return the rows of the table of fingers: name, errors, keys without a finger, latency.

    Adds to `causes` as `measured` does.
    """
    rows = []
    lines = calibrate(load(SensorFile, "default"), EXPOSURE_US)
    with TemporaryDirectory() as scratch:
        five = Path(scratch) / "five.toml"
        five.write_text(FIVE_KEYS)
        for name, speed, how in FINGERS:
            print(f"{name} ...", file=sys.stderr)
            options = {"hands": how.get("hands", "usual")}
            if how.get("exposure"):
                options["lines"] = lines
            if how.get("five"):
                options["layout"] = str(five)
            run = _run(speed, **options)
            if speed in HEADLINES and not how:
                causes[name] = run["causes"]
            rows.append((name, [*_shares(run), _latency(run)]))
    return rows


def document(
    rows: list[tuple[str, list[str]]],
    others: list[tuple[str, list[str]]],
    causes: dict[str, dict],
) -> str:
    """Return the text of applications.md, with the results of `measured` and `fingers`."""
    first = f"--first-seed {evidence_seed()} --touches {TOUCHES}"
    known = {
        "seeds": SEEDS,
        "headline_seeds": HEADLINE_SEEDS,
        "touches": TOUCHES,
        "all": SEEDS * TOUCHES,
        "most": HEADLINE_SEEDS * TOUCHES,
        "same_seeds": f"--seeds {SEEDS} {first}",
        "headline": f"--seeds {HEADLINE_SEEDS} {first}",
        "seconds": _SECONDS,
    }
    text = _TEXT.format(**known) + _table(["", *(name for name, *_ in STRIPS)], rows)
    text += _FINGERS.format(**known)
    text += _table(["", "errors", "no finger", "latency p50, p99"], others)
    table = [(name, [str(of.get(name, 0)) for of in causes.values()]) for name in CAUSES]
    return text + _CAUSES.format(**known) + _table(["", *causes], table)


def _table(names: list[str], rows: list[tuple[str, list[str]]]) -> str:
    lines = [names, ["---"] * len(names), *([what, *of] for what, of in rows)]
    return "".join("| " + " | ".join(cells) + " |\n" for cells in lines)


def _shares(run: dict) -> list[str]:
    cells = []
    for percent, interval in (
        (run["error_percent"], run["error_interval_percent"]),
        (100 * run["no_finger"] / run["touches"], run["no_finger_interval_percent"]),
    ):
        cells.append("{:.2f} % ({:.2f} to {:.2f})".format(percent, *interval))
    return cells


def _typing(run: dict) -> str:
    return ", ".join(_shares(run))


def _latency(run: dict) -> str:
    return "{p50:.0f} ms, {p99:.0f} ms".format(**run["pooled_latency_ms"]) if run["right"] else ""


def main(docs: Path) -> None:
    """Measure, then write applications.md into the folder of the documents."""
    page = folder(docs / "evidence") / "applications.md"
    causes: dict[str, dict] = {}
    rows = measured(causes), fingers(causes)
    atomic.write_text(document(*rows, causes), page, atomic.begins("a page", b"# "))
    print(page)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
