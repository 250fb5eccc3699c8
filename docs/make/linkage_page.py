"""Writes docs/evidence/linkage.md: measurements of a simulated five-bar linkage, and pictures."""

from __future__ import annotations

import sys
from functools import partial
from operator import attrgetter
from pathlib import Path

from spots.common import atomic
from spots_linkage.fivebar import Linkage
from spots_linkage.twin_points import LASTS_S
from spots_sim.measure import maps
from spots_sim.measure.figures import folder, require
from spots_sim.measure.survey import (
    CALIBRATION_PLACES,
    PLACE_SIGMA_MM,
    PathRun,
    Survey,
    follow,
    survey,
)
from spots_sim.person.mechanism import Mechanism
from spots_sim.strip.files import (
    LinkageFile,
    PathFile,
    SensorFile,
    load,
)

# Name in the tables; sensor file; options of `simulated_linkage.Simulation` for the change of the
# strips that the sensor file describes.
STRIPS = {
    "ideal strips": ("default", {}),
    "aged strips, not re-zeroed": ("real", {"misfits": True}),
    "aged strips, re-zeroed": ("real", {"rezeroed": True}),
    "home-made strips": ("first", {}),
}
SEEDS = range(5)
# Seeds of the surveys with both strips on one board, which cover only the workspace.
ONE_BOARD = {"ideal strips": range(11), "aged strips, re-zeroed": range(11)}
EXPOSURES_US = (10_000, 30_000, 50_000)
_SURVEY_US, _FOLLOW_US = 100_000, 30_000

PAPER_MM = 0.64  # largest error in the paper, Fig. 7C

_HEAD = """# Errors of the five-bar linkage

`make paper` writes this document, and measures all numbers except the one from the paper (row
"paper, Fig. 7C"). [Follow a five-bar linkage](../play/linkage.md) shows how to use one, and
[how two angles become a position](../play/linkage-model.md) defines it.
"""

_CALIBRATION = """
## Fitted lengths

"""


def document(
    surveys: dict[str, list[Survey]],
    one_board: dict[str, list[Survey]],
    runs: dict[str, dict[int, list[PathRun]]],
    linkage: LinkageFile,
    mechanism: Mechanism,
) -> str:
    """Return the text of docs/evidence/linkage.md.

    Parameters
    ----------
    surveys : dict of str to list of Survey
        Surveys of the workspace by name in `STRIPS`, one for each seed; ideal strips come first.
    one_board : dict of str to list of Survey
        Surveys with both strips on one board, by name in `ONE_BOARD`; one for each seed.
    runs : dict of str to dict of int to list of PathRun
        Runs on a path, by name in `STRIPS` and by exposure in us; one for each seed.
    linkage : LinkageFile
        Nominal linkage and its errors.
    mechanism : Mechanism
        Linkage with its true lengths.
    """
    lines = [_HEAD, _accuracy(surveys), _workspace(surveys, linkage, mechanism)]
    lines += [_both(one_board), _CALIBRATION]
    first = next(iter(surveys.values()))[0].kinematics
    lines.append(
        f"A fit to {CALIBRATION_PLACES} places, each measured to {PLACE_SIGMA_MM:g} mm, gives "
        "these values for the first seed:\n\n"
        "| | nominal | true | fitted | standard error |\n"
        "| --- | --- | --- | --- | --- |\n"
    )
    truth = (*mechanism.bar_mm, mechanism.base_mm)
    names = ("inner bar 1", "outer bar 1", "outer bar 2", "inner bar 2", "base")
    for key, name, drew, true in zip(first.names, names, (*linkage.bar_mm, linkage.base_mm), truth):
        found, error = first.values[key], first.standard_errors[key]
        lines.append(f"| {name} (mm) | {drew:g} | {true:.2f} | {found:.2f} | {error:.2f} |\n")
    lines.append(
        f"\nThe places determine {first.rank} of the {len(first.names)} fitted parameters. The "
        f"condition number of the fit is {first.condition:.0f}, and the\nresiduals are "
        f"{first.misfit:.2f} times those expected from the standard errors. The end point is more "
        "accurate than the\nlengths, because correlated errors cancel.\n"
    )
    lines.append(_path(runs))
    return "".join(lines)


def _spans(surveys: dict[str, list[Survey]], *names: str) -> list[str]:
    cells = []
    for found in surveys.values():
        for get in map(attrgetter, names):
            values = [get(one) for one in found]
            cells.append(f"{min(values):.3f} to {max(values):.3f}")
    return cells


def _accuracy(surveys: dict[str, list[Survey]]) -> str:
    """Return the result in short: the largest error of each kind of strip, over all seeds."""
    each = (
        f"{max(one.calibrated.max_mm for one in found):.2f} mm with {strips}"
        for strips, found in surveys.items()
        if "not re-zeroed" not in strips
    )
    return (
        "\nAccuracy of the end point after a kinematic calibration (fitted lengths), simulated: at "
        f"most {', '.join(each)}.\n"
        f"The paper states {PAPER_MM:g} mm for another linkage, a physical one.\n"
    )


def _workspace(surveys: dict[str, list[Survey]], linkage: LinkageFile, mechanism: Mechanism) -> str:
    spans = partial(_spans, surveys)
    rows = [
        ["", *(f"{strip}, {what}" for strip in surveys for what in ("mean", "at most"))],
        ["---"] * (1 + 2 * len(surveys)),
        ["paper, Fig. 7C, another linkage", "", f"{PAPER_MM:g}", *[""] * (2 * len(surveys) - 2)],
        ["nominal lengths and mounting", *spans("drawn.mean_mm", "drawn.max_mm")],
        ["true lengths and mounting", *spans("given.mean_mm", "given.max_mm")],
        [
            f"fitted to {CALIBRATION_PLACES} places",
            *spans("calibrated.mean_mm", "calibrated.max_mm"),
        ],
        [
            "expected from the encoders' standard errors alone",
            *spans("expected_mean_mm", "expected_max_mm"),
        ],
    ]
    off = f"{max(map(abs, linkage.bar_error_percent)):g} %"
    turned = f"{max(map(abs, linkage.mount_error_deg)):g}°"
    travel, places = f"{mechanism.travel_deg:.0f}°", len(next(iter(surveys.values()))[0].x_mm)
    bar, base, each = linkage.bar_mm[0], linkage.base_mm, _SURVEY_US / 1000
    text = f"""
## Over the workspace

A **simulated** linkage (`host/spots_sim/data/linkages/default.toml`) has nominal bars of {bar:g} mm
and a base of {base:g} mm. The true lengths differ from these by up to {off}, and the true mounting
angles of the joints differ by up to {turned}. Each joint moves an indenter with backlash along its
own strip, over {travel}. The real firmware reads each strip in simulated time. Each strip is
calibrated, and then its joint is calibrated.

The end point stops at {places} points of a grid over the workspace. The twin computes its position
from one reading of {each:g} ms of each joint. The table shows the distance from the true position
in mm, for seeds {min(SEEDS)} to {max(SEEDS)}. A range goes from the smallest to the largest value
of these seeds. In the rows, "nominal", "true" and "fitted" are the lengths that the twin uses:

"""
    text += "".join("| " + " | ".join(cells) + " |\n" for cells in rows)
    return (
        text
        + """
With the true lengths, only the errors of the encoders remain. A kinematic calibration, which fits
lengths and mounting to 40 places ([below](#fitted-lengths)), is nearly as accurate. The paper's
number includes all errors of a real mechanism, such as bearings and bending bars. The simulated
mechanism has only backlash and wrong lengths.

The strips are those of [typing and controller](applications.md), with warm LEDs. A re-zero
(`spots rezero --joint`) corrects the calibration of an aged strip at three angles of the
joint. Without it, many readings do not fit the calibration: encoders normally ignore these, but
used them for this table. A kinematic calibration also corrects the strips' errors, until the strips
change further.

![Deviation over the workspace, before and after calibration](../pictures/linkage/deviation.png)
"""
    )


def _both(surveys: dict[str, list[Survey]]) -> str:
    rows = [
        ["", *(f"{strip}, {what}" for strip in surveys for what in ("mean", "at most"))],
        ["---"] * (1 + 2 * len(surveys)),
        [
            "true lengths and mounting, one reading",
            *_spans(surveys, "given.mean_mm", "given.max_mm"),
        ],
        [
            f"fitted to {CALIBRATION_PLACES} places, one reading",
            *_spans(surveys, "calibrated.mean_mm", "calibrated.max_mm"),
        ],
        [
            f"fitted to {CALIBRATION_PLACES} places, mean of a stop",
            *_spans(surveys, "rested.mean_mm", "rested.max_mm"),
        ],
        [
            "expected from the encoders' standard errors alone, one reading",
            *_spans(surveys, "expected_mean_mm", "expected_max_mm"),
        ],
    ]
    seeds = " and ".join(f"{len(found)} seeds ({strip})" for strip, found in surveys.items())
    return f"""
### Both strips on one board

The table shows the distance from the true position in mm if one board has both strips, for
{seeds}. The end point stops for {LASTS_S:g} s
at each point. For the fit, each angle is the mean over a stop. The encoders follow all movements,
so they correct the backlash. `spots twin --measure` does not correct the backlash, because it reads
the joints only while the end point rests.

""" + "".join("| " + " | ".join(cells) + " |\n" for cells in rows)


def _path(runs: dict[str, dict[int, list[PathRun]]]) -> str:
    text = f"""
## On a path

A hand with a tremor moves the end point along "SUST" (`host/spots_sim/data/paths/sust.toml`). The
twin uses the true lengths. The strips are described [above](#over-the-workspace). The table shows
the errors in mm, for seeds {min(SEEDS)} to {max(SEEDS)}:

| strips | exposure | positions a second | mean | 95 % below | at most | rms | expected rms |
| --- | --- | --- | --- | --- | --- | --- | --- |
"""
    for strips, of_exposures in runs.items():
        for exposure_us, of_seeds in of_exposures.items():
            found = [run.summary() for run in of_seeds]
            cells = [
                [summary["error_mm"][name] for summary in found]
                for name in ("mean", "p95", "max", "rms")
            ]
            cells.append([summary["expected_rms_mm"] for summary in found])
            spans = " | ".join(f"{min(cell):.3f} to {max(cell):.3f}" for cell in cells)
            rate_hz = found[0]["rate_hz"]
            text += f"| {strips} | {exposure_us / 1000:g} ms | {rate_hz:.0f} | {spans} |\n"
    return (
        text
        + f"""
The column "expected rms" is the error that the twin reports with each position. It is computed with
the Jacobian from the noise of the strips, the errors of the joint calibrations and the backlash. It
does not include movements between two readings, or the error of the dark frame.

![SUST: the path and the twin's estimate, at {_FOLLOW_US / 1000:g} ms](../pictures/linkage/sust.png)
"""
    )


def main(docs: Path) -> None:
    """Measure, then write linkage.md and its pictures into the folder of the documents."""
    require()
    linkage, path = load(LinkageFile, "default"), load(PathFile, "sust")
    surveys: dict[str, list[Survey]] = {}
    runs: dict[str, dict[int, list[PathRun]]] = {}
    for strips, (name, condition) in STRIPS.items():
        print(f"linkage with {strips} ...", file=sys.stderr)
        files = load(SensorFile, name), linkage
        surveys[strips] = [survey(*files, seed, _SURVEY_US, **condition) for seed in SEEDS]
        runs[strips] = {
            us: [follow(*files, path, seed, us, **condition) for seed in SEEDS]
            for us in EXPOSURES_US
        }
    one_board = {}
    for strips, seeds in ONE_BOARD.items():
        print(f"linkage with {strips} on one board ...", file=sys.stderr)
        name, condition = STRIPS[strips]
        files = load(SensorFile, name), linkage
        one_board[strips] = [
            survey(*files, seed, _SURVEY_US, one_board=True, **condition) for seed in seeds
        ]
    out = folder(docs / "pictures" / "linkage")
    drawn = Linkage(linkage.bar_mm, linkage.base_mm)
    mechanism = Mechanism(linkage, load(SensorFile, "default"))
    ideal, *_ = STRIPS
    print(maps.angles(drawn, out / "angles.png", mechanism=mechanism))
    print(maps.deviation(surveys[ideal][0], out / "deviation.png"))
    print(maps.trajectory(runs[ideal][_FOLLOW_US][0], out / "sust.png"))
    page = folder(docs / "evidence") / "linkage.md"
    atomic.write_text(
        document(surveys, one_board, runs, linkage, mechanism), page, atomic.begins("a page", b"# ")
    )
    print(page)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
