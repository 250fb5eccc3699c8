"""Writes docs/fivebar.md: what the simulated five-bar linkage measures, with its pictures."""

from __future__ import annotations

import sys
from pathlib import Path

from spots import atomic
from spots.linkage.fivebar import Linkage
from spots_sim import maps
from spots_sim.figures import folder, require
from spots_sim.files import LinkageFile, PathFile, SensorFile, load
from spots_sim.mechanism import Mechanism
from spots_sim.survey import CALIBRATION_PLACES, PLACE_SIGMA_MM, PathRun, Survey, follow, survey

SEEDS = range(5)
EXPOSURES_US = (10_000, 30_000, 50_000)
_SURVEY_US, _FOLLOW_US = 100_000, 30_000

_HEAD = """# The five-bar linkage and its twin

Written by `make paper`; it measures every number but the published one. Two strips in
the base joints of a planar five-bar linkage are its encoders and give the terminal's position
(paper, section IV, Eqs. 3 and 4, Fig. 7).

![Bars, and where the terminal is with either joint at an angle](fivebar/angles.png)

```python
import spots

linkage = spots.Linkage(bar_mm=100, base_mm=80)  # bars: or inner 1, outer 1, outer 2, inner 2
theta1_rad, theta2_rad = linkage.inverse(40, 150)
x_mm, y_mm = linkage.forward(theta1_rad, theta2_rad)
```

All of it takes scalars or arrays, in every quadrant. Where there is no answer, a scalar raises
an error with the reason in a sentence; an array is returned masked, and `forward_limits` and
`inverse_limits` give the reason for each element (`spots.linkage.fivebar.Limit`). Two terminals go
with the same two angles: `assembly="far"`, the usual one, has the terminal beyond the elbows,
`"near"` the other. `jacobian` and `covariance` say how errors of the angles become errors of the
terminal. They grow without bound as the outer bars come into line; the workspace here keeps
these at least 30° from it, the usual rule.

## A joint, a twin

```sh
python examples/track_joint.py CALIBRATION.toml      # a joint's angle and speed
spots twin --linkage arm.toml                        # two boards on USB, found by their ids
spots twin --linkage arm.toml --port /dev/ttyACM0 --port /dev/ttyACM1
spots twin --port virtual                            # no hardware: a simulated linkage writes SUST
spots twin --json --picture sust.png                 # the same in simulated time, against the truth
```

![The twin in a terminal: bars, path, and the terminal in figures](fivebar/twin.svg)

On a terminal it is a picture with position, standard error, velocity, and limits and
singularities by name; elsewhere lines, or with `--json` an object for each terminal. Its keys are
those of the page's message ([page.md](page.md)), and `velocity_mm_s`, `sigma_mm`, `limit`,
`singular` and `within` (where the joints were calibrated). The same on the page:
`spots serve --linkage arm.toml`, or without hardware `make demo ARGS="--use fivebar --page"`.

`spots.Encoder` turns readings into angles with the line of `spots calibrate joint`. Half the
play is added or taken off as soon as the position has moved by more than its noise; at rest the
joint may stand anywhere in its play, and the standard error says so. The speed is by the board's
clock. `spots.Twin` takes the readings of both joints as they come, live or from recordings, and
returns the terminal at the time of each reading, with the other joint interpolated between two of
its own: nothing is extrapolated, and it makes no difference which board sent first. The boards'
clocks are compared with the computer's, see `Touch.time_s`. A board that restarts is given its
calibration again.

```python
from spots.linkage.twin_source import opened

with opened("arm.toml") as source:  # or opened("arm.toml", ["/dev/ttyACM0", "/dev/ttyACM1"])
    for terminal in source.follow():
        print(terminal.x_mm, terminal.y_mm, terminal.sigma_mm)
```

With `--record a.spots --record b.spots` both boards are recorded, and
`--port recording:a.spots --port recording:b.spots` gives exactly the same terminals again.

The firmware reads one sensor, so a linkage takes two boards. Frames have room for a sensor's
number: a board of yours that sends two, 0 for joint 1 and 1 for joint 2, is taken with one
`--port`, and has to hold its calibrations itself.

## The linkage file

```toml
# arm.toml, as drawn. Inner bar 1, outer bar 1, outer bar 2, inner bar 2.
bar_mm = [100.0, 100.0, 100.0, 100.0]
base_mm = 80.0
assembly = "far"

[[joint]]  # at (0, 0)
calibration = "a.toml"  # of its strip, with 'spots calibrate joint'; beside this file
offset_deg = -108.0     # where that calibration has 0, counted as above
gain = 1.0              # -1.0 for a strip that counts the other way

[[joint]]  # at (base, 0)
calibration = "b.toml"
offset_deg = -108.0
```

A calibration stores its board's id, which identifies the joint of each board.
"""

_CALIBRATION = """
## Lengths that nobody knows

Parts come out wrong, and a protractor is set by eye.

```sh
spots twin --linkage drawn.toml --measure points.csv     # hold the terminal still, type where it is
spots twin --linkage drawn.toml --calibrate points.csv --out arm.toml
```

From the encoders' angles at some places and the terminal's position on a grid or machine laid
anyhow, this finds the four bars, the base, the joints' offsets and gains and the frame of the
grid, by robust least squares (`pip install 'spots-tactile[kinematics]'`). It names points that do
not fit, gives standard errors, and names parameters that these places cannot separate: a picture
of unknown scale, for example, gives ratios of lengths only. `--place-sigma-mm` is how well the
places are known. The table may come from elsewhere: its columns are `x_mm`, `y_mm`, `joint1_deg`,
`joint2_deg`, `sigma1_deg` and `sigma2_deg`, the joints by their own calibrations.

```python
from spots.linkage import kinematics

found = kinematics.calibrate(
    angles_rad, x_mm, y_mm, start=spots.Linkage(100, 80), angle_sigma_rad=2e-4, place_sigma_mm=0.02
)
print(found.report())
linkage, offsets, gains = found.linkage, found.offset_rad, found.gain
```

"""


def document(
    surveys: list[Survey],
    runs: dict[int, list[PathRun]],
    linkage: LinkageFile,
    mechanism: Mechanism,
) -> str:
    """Return the text of docs/fivebar.md.

    Parameters
    ----------
    surveys : list of Survey
        By seed.
    runs : dict of int to list of PathRun
        By exposure in us, then by seed.
    linkage : LinkageFile
    mechanism : Mechanism
    """
    lines = [_HEAD, _workspace(surveys, linkage, mechanism), _CALIBRATION]
    first = surveys[0].kinematics
    lines.append(
        f"From {CALIBRATION_PLACES} places, known to {PLACE_SIGMA_MM:g} mm, of the simulated "
        "linkage (the first seed):\n\n| | as drawn | truth | found | standard error |\n"
        "| --- | --- | --- | --- | --- |\n"
    )
    truth = (*mechanism.bar_mm, mechanism.base_mm)
    names = ("inner bar 1", "outer bar 1", "outer bar 2", "inner bar 2", "base")
    for key, name, drew, true in zip(first.names, names, (*linkage.bar_mm, linkage.base_mm), truth):
        found, error = first.values[key], first.standard_errors[key]
        lines.append(f"| {name} (mm) | {drew:g} | {true:.2f} | {found:.2f} | {error:.2f} |\n")
    lines.append(
        f"\nThe rank is {first.rank} of {len(first.names)}, the condition {first.condition:.0f}, "
        f"and the residuals are {first.misfit:.2f} times what the errors explain.\nThe lengths are "
        "known less well than the terminal, because errors that go together cancel.\n"
    )
    lines.append(_path(runs))
    return "".join(lines)


def _workspace(surveys: list[Survey], linkage: LinkageFile, mechanism: Mechanism) -> str:
    def span(get, form="{:.3f}"):
        found = [get(one) for one in surveys]
        return f"{form.format(min(found))} to {form.format(max(found))}"

    rows = [
        ("paper, Fig. 7C, a linkage of its own", "", "0.64"),
        (
            "lengths and mounting as drawn",
            span(lambda s: s.drawn.mean_mm, "{:.2f}"),
            span(lambda s: s.drawn.max_mm, "{:.2f}"),
        ),
        (
            "the true ones given",
            span(lambda s: s.given.mean_mm),
            span(lambda s: s.given.max_mm),
        ),
        (
            f"found from {CALIBRATION_PLACES} places, none given",
            span(lambda s: s.calibrated.mean_mm),
            span(lambda s: s.calibrated.max_mm),
        ),
        (
            "what the encoders' standard errors alone let expect",
            span(lambda s: s.expected_mean_mm),
            span(lambda s: s.expected_max_mm),
        ),
    ]
    off = f"{max(map(abs, linkage.bar_error_percent)):g} %"
    turned = f"{max(map(abs, linkage.mount_error_deg)):g}°"
    travel, places = f"{mechanism.travel_deg:.0f}°", len(surveys[0].x_mm)
    bar, base, each = linkage.bar_mm[0], linkage.base_mm, _SURVEY_US / 1000
    text = f"""
## Over the workspace

A **simulated** linkage (`host/spots_sim/data/linkages/default.toml`): bars of {bar:g} mm on a
base of {base:g} mm, as drawn; as it came out, bars off by up to {off} and joints mounted up to
{turned} off. Each joint moves an indenter with play along a default strip of its own, over
{travel}. Each strip is read through the real firmware in simulated time, calibrated, and its
joint calibrated with it. The terminal stops at {places} places of a grid over the workspace; one
reading of {each:g} ms of each joint gives its position. Seeds {min(SEEDS)} to {max(SEEDS)}:

| distance from the truth (mm) | mean | at most |
| --- | --- | --- |
"""
    text += "".join(f"| {what} | {mean} | {most} |\n" for what, mean, most in rows)
    return (
        text
        + """
With the lengths known the encoders' own errors are all that is left, and a kinematic calibration
comes as near. The paper's figure holds the errors of a real mechanism (bearings, bars that bend,
a frame that gives), of which only play and wrong lengths are simulated.

![Deviation over the workspace, before and after calibration](fivebar/deviation.png)
"""
    )


def _path(runs: dict[int, list[PathRun]]) -> str:
    text = f"""
## On a path

A hand that trembles guides the terminal along "SUST" (`host/spots_sim/data/paths/sust.toml`);
the twin knows the true lengths. Seeds {min(SEEDS)} to {max(SEEDS)}, in mm:

| exposure | terminals a second | mean error | 95 % below | at most | rms | rms expected |
| --- | --- | --- | --- | --- | --- | --- |
"""
    for exposure_us, of_seeds in runs.items():
        found = [run.summary() for run in of_seeds]
        cells = [
            [summary["error_mm"][name] for summary in found]
            for name in ("mean", "p95", "max", "rms")
        ]
        cells.append([summary["expected_rms_mm"] for summary in found])
        spans = " | ".join(f"{min(cell):.3f} to {max(cell):.3f}" for cell in cells)
        rate_hz = found[0]["rate_hz"]
        text += f"| {exposure_us / 1000:g} ms | {rate_hz:.0f} | {spans} |\n"
    return (
        text
        + f"""
The expected error is what the twin reports with each terminal: the noise of the strips, their
joints' straight lines and the play, through the Jacobian. Two things are not in it: what the
terminal did between two readings, and the error of the dark frame. The board takes one at its
start, and never again as long as the strip is pressed, which a joint's strip always is; beside the
little noise of a longer exposure it shows.

![SUST: the terminal's path and the twin's estimate, at {_FOLLOW_US / 1000:g} ms](fivebar/sust.png)
"""
    )


def main(docs: Path) -> None:
    """Measure, then write fivebar.md and its pictures into the folder of the documents."""
    require()
    sensor, linkage = load(SensorFile, "default"), load(LinkageFile, "default")
    path, mechanism = load(PathFile, "sust"), Mechanism(linkage, sensor)
    surveys = []
    for seed in SEEDS:
        print(f"linkage, seed {seed} ...", file=sys.stderr)
        surveys.append(survey(sensor, linkage, seed, _SURVEY_US))
    runs = {}
    for us in EXPOSURES_US:
        print(f"path, {us} us ...", file=sys.stderr)
        runs[us] = [follow(sensor, linkage, path, seed, us) for seed in SEEDS]
    out = folder(docs / "fivebar")
    drawn = Linkage(linkage.bar_mm, linkage.base_mm)
    print(maps.angles(drawn, out / "angles.png", mechanism=mechanism))
    print(maps.deviation(surveys[0], out / "deviation.png"))
    print(maps.trajectory(runs[_FOLLOW_US][0], out / "sust.png"))
    page = docs / "fivebar.md"
    atomic.write_text(document(surveys, runs, linkage, mechanism), page)
    print(page)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
