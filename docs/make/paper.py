"""Writes docs/evidence/paper.md: published results beside those of the simulated default sensor."""

from __future__ import annotations

import sys
from pathlib import Path

from spots.common import atomic
from spots_sim.measure import figures
from spots_sim.measure.family import LENGTHS_MM, departure_um, family
from spots_sim.measure.measurements import Run, characterize
from spots_sim.measure.rezeroed import Hand
from spots_sim.strip.files import SensorFile, load

EXPOSURES_US = (10_000, 100_000)
_SEED = 0
_HEAD = """# The paper's figures, and those of the simulated sensor

`make paper` writes this document, and measures all numbers except the published ones. These are
from Nie, Fan, Huang, Liu and Dai, *Stretchable and High-Precision Optical Tactile Sensor for
Trajectory Tracking of Parallel Mechanisms*; the table names the sections.
[Definitions](../science/definitions.md) defines the quantities, and
[limits](../science/limits.md) compares the results in words.

| strip | sensor file | what it is |
| --- | --- | --- |
| ideal strip | `default` | {length_mm:g} mm long, **simulated** with seed {seed} |
| aged strip | `real` | **simulated**; has aged and warmed up, and is under a lamp |
| home-made strip | `first` | [assumed effects](../science/sensor-files.md) |

The aged strip was re-zeroed: its calibration was corrected with one press at each of three
marks, on a kitchen scale. The board compensates the creep and the hysteresis of its
[silicone](../science/silicone.md). An indenter calibrated the home-made strip; then a finger
re-zeroed it and pressed it. In the tests of the force, the force rises from 0.6 to 9.5 N and falls
again.

The column titles contain the duration of a reading, which the paper does not state.

"""
# Name of the columns of each sensor file.
_STRIPS = {"default": "ideal strip", "real": "aged strip", "first": "home-made strip"}
_PICTURES = {
    "position": "Response along the strip, and its deviation from a straight line.",
    "resolution": "Resolution, accuracy and scatter, and the Cramer-Rao bound of the scatter.",
    "dye_and_length": "Strips of other lengths and dyes.",
    "force": "Response to force, and its error.",
    "strain": "Responses and accuracy of the stretched strip.",
    "bending": "Errors of the bent strip.",
    "joint": "A joint's angle from the position of its indenter, in both directions.",
}


def rows(runs: list[Run], departures_um: list[float]) -> list[tuple]:
    """Return the rows of the table.

    Parameters
    ----------
    runs : list of Run
        Results of the default strip for each exposure, then those of the other sensor files.
    departures_um : list of float
        Results of `family.departure_um` for the default strip, for each exposure.

    Returns
    -------
    list of tuple
        Quantity, section of the paper, published value, list of simulated values (one for each
        run), and what the simulation cannot show.
    """
    found = [run.summary for run in runs]

    def each(form: str, get) -> list[str]:
        return [form.format(get(summary)) for summary in found]

    def bent(name: str):
        def span(summary):
            values = [row["accuracy_um"] for row in summary[name]]
            return f"{values[0]:.1f} µm, then {min(values[1:]):.1f} to {max(values[1:]):.1f} µm"

        return span

    pair = found[0]["position"]["one_pair"]["channels"]
    shortest, *_, longest = LENGTHS_MM
    return [
        (
            "R² of the response",
            "III.A",
            "> 0.996",
            each("{:.7f}", lambda s: s["position"]["r2"]),
            "The simulated dye's spectrum has a smooth absorption edge; with a physical pigment "
            "the response is less linear.",
        ),
        (
            "Position resolution",
            "III.A",
            "7 µm",
            each("{:.1f} µm", lambda s: s["position"]["resolution_um"]),
            "The resolution depends on the light of a physical strip, which is not published.",
        ),
        (
            "Position accuracy",
            "III.A",
            "16 µm",
            each("{:.1f} µm", lambda s: s["position"]["accuracy_um"]),
            "The simulated stage has no error; the default strip has no creep, dirt or warming.",
        ),
        (
            "Scatter divided by the Cramer-Rao bound, six channels",
            "",
            "",
            each("{:.2f}", lambda s: s["position"]["crb_ratio"]),
            "The bound assumes simulated noise of the counts, independent in each channel.",
        ),
        (
            "Scatter with one pair of channels (Eq. 2; here the best pair, "
            f"{pair[1]} over {pair[0]}), divided by the same bound",
            "III.A",
            "",
            each("{:.2f}", lambda s: s["position"]["one_pair"]["crb_ratio"]),
            "The paper does not name its pair, which may be another one.",
        ),
        (
            "Signal to noise",
            "III.A",
            "> 20 dB",
            each("{:.0f} dB", lambda s: s["snr_db"]),
            "The paper defines no ratio; here, light divided by scatter under a constant press.",
        ),
        (
            f"Strips of {shortest:g} to {longest:g} mm share one response",
            "III.A",
            "yes",
            [f"within {departure:.0f} µm" for departure in departures_um]
            + ["not measured"] * (len(runs) - len(departures_um)),
            "Every simulated strip has the same dye; physical batches differ.",
        ),
        (
            "Force resolution",
            "III.B",
            "5 mN",
            each("{:.1f} mN", lambda s: s["force"]["resolution_mN"]),
            "Contact area and a flat finger are assumed. The aged strip still creeps: "
            "readings begin immediately after each step of the force.",
        ),
        (
            "Cramer-Rao bound of the force, with the noise of the LED",
            "",
            "",
            each("{:.1f} mN", lambda s: s["force"]["bound_mN"]),
            "While nothing moves, part of the rounding is a constant error, so the resolution can "
            "be below the bound. The aged strip has softened.",
        ),
        (
            "Force accuracy",
            "III.B",
            "0.14 N",
            each("{:.3f} N", lambda s: s["force"]["accuracy_N"]),
            "Only the aged strip has hysteresis and creep; their laws and sizes are assumed.",
        ),
        (
            "Accuracy without strain, then under strain up to 25 %",
            "III.C",
            "similar",
            each("{}", bent("strain")),
            "The strain is known exactly and calibrated at each value. Beyond its marks, the "
            "re-zero is extrapolated: most of the error at 25 %.",
        ),
        (
            "Accuracy straight, then bent up to 180°",
            "III.C",
            "no significant loss",
            each("{}", bent("bend")),
            "Simulated bending only reduces light; a physical bend may press the guides together.",
        ),
        (
            "Joint: R²",
            "IV",
            "> 0.999",
            each("{:.7f}", lambda s: s["joint"]["r2"]),
            "The simulated indenter runs on a perfect circle.",
        ),
        (
            "Joint: resolution",
            "IV",
            "0.02°",
            each("{:.4f}°", lambda s: s["joint"]["resolution_deg"]),
            "This is the position resolution divided by the joint's radius. The paper does not "
            "state the radius.",
        ),
        (
            "Joint: accuracy",
            "IV",
            "0.04°",
            each("{:.4f}°", lambda s: s["joint"]["accuracy_deg"]),
            "Backlash is the only simulated mechanical error.",
        ),
    ]


def document(runs: list[Run], departures_um: list[float], length_mm: float) -> str:
    """Return the text of docs/evidence/paper.md.

    Parameters
    ----------
    runs, departures_um : list
        Results, see `rows`.
    length_mm : float
        Length of the default strip, in mm.
    """
    lines = [_HEAD.format(length_mm=length_mm, seed=_SEED)]
    columns = [
        f"{name}, {run.summary['reading_ms']:.3g} ms a reading"
        for name, of_exposures in _by_strip(runs, len(departures_um))
        for run in of_exposures
    ]
    head = ["", "section", "published", *columns, "what the simulation cannot show"]
    lines += [_row(head), _row(["---"] * len(head))]
    for what, section, published, ours, limit in rows(runs, departures_um):
        lines.append(_row([what, section, published, *ours, limit]))
    lines.append(_resolutions(runs, len(departures_um)))
    shown = runs[len(departures_um) - 1].summary["reading_ms"]
    lines.append("\n## Figures\n\nAll figures show the simulated default sensor ")
    lines.append(f"at {shown:.3g} ms a reading.\n\n")
    for name, text in _PICTURES.items():
        lines.append(f"![{text}](../pictures/paper/{name}.png)\n\n{text}\n\n")
    return "".join(lines).rstrip() + "\n"


def _by_strip(runs: list[Run], exposures: int) -> list[tuple[str, list[Run]]]:
    """Return the name of each strip, and its runs: one for each exposure."""
    starts = range(0, len(runs), exposures)
    return [(name, runs[i : i + exposures]) for name, i in zip(_STRIPS.values(), starts)]


def _resolutions(runs: list[Run], exposures: int) -> str:
    """Return a paragraph that compares the resolutions of position and force with the paper's."""
    text = (
        "\nThe paper states no integration time, no rate and no filter. Perhaps it measured "
        "both resolutions\nwith the same duration of a reading. In this case, compare the "
        "published force resolution with the\nrow whose position resolution is nearest to 7 µm:\n\n"
        "| duration of a reading | strip | position resolution | force resolution |\n"
        "| --- | --- | --- | --- |\n"
        "| not stated | paper | 7 µm | 5 mN |\n"
    )
    for i in range(exposures):
        for strip, of_exposures in _by_strip(runs, exposures):
            one = of_exposures[i].summary
            position, force = one["position"]["resolution_um"], one["force"]["resolution_mN"]
            text += (
                f"| {one['reading_ms']:.3g} ms | {strip} | {position:.1f} µm | {force:.1f} mN |\n"
            )
    return text


def _row(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |\n"


def main(docs: Path) -> None:
    """Measure, then write paper.md and its figures into the folder of the documents."""
    figures.require()
    sensor = load(SensorFile, "default")
    runs, departures_um = [], []
    for exposure_us in EXPOSURES_US:
        print(f"{exposure_us} us ...", file=sys.stderr)
        run = characterize(sensor, _SEED, exposure_us)
        responses = family(sensor, run.series["position"]["channels"], _SEED, exposure_us)
        departures_um.append(departure_um(responses["length"]))
        runs.append(run)
    for path in figures.draw(runs[-1], responses, figures.folder(docs / "pictures" / "paper")):
        print(path)
    _, *others = _STRIPS
    for name in others:
        hand = Hand(marks=3, scale=True, by_hand=True)
        for exposure_us in EXPOSURES_US:
            print(f"{name}, {exposure_us} us ...", file=sys.stderr)
            runs.append(characterize(load(SensorFile, name), _SEED, exposure_us, hand=hand))
    page = figures.folder(docs / "evidence") / "paper.md"
    atomic.write_text(
        document(runs, departures_um, sensor.length_mm), page, atomic.begins("a page", b"# ")
    )
    print(page)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
