"""Writes docs/applications.md: errors of keyboard and controller, on two simulated strips."""

from __future__ import annotations

import sys
from pathlib import Path

from spots import atomic
from spots_sim.demo.demo import demo
from spots_sim.demo.typing_speed import added, typed

# Name of the column; sensor file; whether the calibration was corrected after the change of the
# strip (re-zero); whether the LED is warm at the start.
STRIPS = (
    ("ideal strip", "default", False, False),
    ("imperfect strip, not re-zeroed", "real", False, True),
    ("imperfect strip, re-zeroed", "real", True, True),
    ("imperfect strip, re-zeroed, LED cold", "real", True, False),
)
WORDS_PER_MIN = (40, 60, 80, 100)
SEEDS = range(5)
TOUCHES = 150
_SECONDS = 10.0
_TEXT = """# Typing and controller, on the ideal and on the imperfect strip

This document compares the errors of typing and of the game controller on two simulated strips.
`make paper` writes this document, and measures all numbers. The ideal strip (sensor file `default`)
has not changed since its calibration. The imperfect strip (sensor file `real`) has the faults of a
physical strip: it has aged and warmed up since its calibration, and is under a lamp. These changes
cause drift: wrong positions ([drift.md](drift.md)). A re-zero corrects the drift with presses at
known positions (the marks). For this table each mark was pressed one time, after the LED had warmed
up. The last column is measured after power-on, while the LED warms up.

A simulated person types {touches} touches on ten keys, for each of {seeds} seeds, with exposures of
10 ms. The statistics of these touches are from publications, which
[typist.py](../host/spots_sim/person/typist.py) cites. "Errors" are wrong, missed and extra keys;
"no finger" are wrong or extra keys that no finger touched. Both are in per cent of the touches. The
latency is the time from the start of a touch to the report of the correct key. For each of its
percentiles p50 and p99, the table shows the largest value of all seeds. In the rows `controller`,
the simulated fingers of the demo move the axes of the game controller for {seconds:g} s;
[controller.md](controller.md#untrusted-and-missing-readings) explains the values. These commands
measure the column "imperfect strip, re-zeroed":

```sh
python -m spots_sim.demo.typing_speed {speeds} --seeds {seeds} --sensor real --rezero --warm
spots demo --use controller --fast --json --seconds {seconds:g} --sensor real --rezero --warm
```

"""


def measured() -> list[tuple[str, list[str]]]:
    """Return the table's rows: the name of a quantity, and its value for each of `STRIPS`."""
    rows = []
    for speed in WORDS_PER_MIN:
        print(f"typing, {speed} words a minute ...", file=sys.stderr)
        runs = [
            added([typed(speed, TOUCHES, seed, *strip) for seed in SEEDS]) for _, *strip in STRIPS
        ]
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


def document(rows: list[tuple[str, list[str]]]) -> str:
    """Return the text of docs/applications.md, with the table's rows from `measured`."""
    text = _TEXT.format(
        seeds=len(SEEDS),
        touches=TOUCHES,
        seconds=_SECONDS,
        speeds=" ".join(map(str, WORDS_PER_MIN)),
    )
    names = [name for name, *_ in STRIPS]
    for cells in (["", *names], ["---"] * (1 + len(names)), *([what, *of] for what, of in rows)):
        text += "| " + " | ".join(cells) + " |\n"
    return text


def _typing(run: dict) -> str:
    return f"{run['error_percent']:.1f} %, {100 * run['no_finger'] / run['touches']:.1f} %"


def _latency(run: dict) -> str:
    return "{p50:.0f} ms, {p99:.0f} ms".format(**run["latency_ms"]) if run["right"] else ""


def main(docs: Path) -> None:
    """Measure, then write applications.md into the folder of the documents."""
    page = docs / "applications.md"
    atomic.write_text(document(measured()), page)
    print(page)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
