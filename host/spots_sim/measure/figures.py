"""Draws the figures of a characterisation as PNG files. Needs matplotlib (extra ``plots``)."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from spots.common import atomic
from spots.errors import FileError, missing

# Okabe and Ito's colours, distinct with any colour vision; markers differ as well.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_MARKERS = ("o", "s", "^", "D", "v", "P")
_GREY = "#555555"
_LEGEND = 0.25  # space above the curves for a legend, as a share of their height
_DPI = 110
_PNG = atomic.begins("a PNG picture", b"\x89PNG\r\n\x1a\n")


def require() -> None:
    """Raise SpotsError if matplotlib is not installed."""
    if find_spec("matplotlib") is None:
        raise missing("drawing figures needs", "matplotlib", "plots")


def folder(path: str | Path) -> Path:
    """Create a folder unless it exists, and return its path; FileError if this is impossible."""
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(
            f"cannot make the folder {path} ({error.strerror}): name another folder", path
        ) from None
    return path


def check_folder(path: str | Path) -> None:
    """Raise FileError if a path is a file, so that `folder` could not create a folder there."""
    if Path(path).is_file():
        raise FileError(f"{path} is a file: name a folder", path)


def draw(run, responses: dict, out: Path) -> list[Path]:
    """Draw all figures of a characterisation as PNG files in an existing folder.

    `responses` are those of `family.family`.
    """
    reading = f"{run.summary['reading_ms']:.3g} ms a reading"
    made = {
        "position": _position(run),
        "resolution": _resolution(run, reading),
        "dye_and_length": _family(run, responses),
        "force": _force(run, reading),
        "strain": _strain(run, reading),
        "bending": _bending(run, reading),
        "joint": _joint(run, reading),
    }
    return [save(figure, out / f"{name}.png") for name, figure in made.items()]


def save(figure, path: Path) -> Path:
    """Write a figure to a PNG file, and free the figure's memory; return `path`."""
    with atomic.replacing(path, _PNG) as file:
        # Without versions and dates, which would change the file although the picture is the same.
        figure.savefig(file, format="png", dpi=_DPI, metadata={"Software": None})
    return path


def panels(columns: int = 1, rows: int = 1, width: float = 7.0, height: float = 4.0, **options):
    """Create a figure with a grid of axes; its size is in inches.

    Returned are the figure, and axes in the shape of `matplotlib.figure.Figure.subplots`, which
    gets the `options`.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, **options)
    for axis in np.ravel(axes):
        axis.set_axisbelow(True)
        axis.grid(alpha=0.3)
        axis.spines[["top", "right"]].set_visible(False)
    return figure, axes


def label(axis, title: str, x: str, y: str, **limits) -> None:
    """Set title and labels of axes; `limits` go to `matplotlib.axes.Axes.set`."""
    axis.set_title(title, loc="left", fontsize=11)
    axis.set(xlabel=x, ylabel=y, **limits)


def line(axis, i: int, x: ArrayLike, y: ArrayLike, name: str | None = None, **options) -> None:
    """Draw points joined by a line in colour and marker number `i`, with `name` in the legend."""
    style = {"color": _COLOURS[i], "marker": _MARKERS[i], "markersize": 4, "linewidth": 1.3}
    axis.plot(x, y, label=name, **(style | options))


def legend(axis, **options) -> None:
    """Draw a legend without a frame."""
    axis.legend(**({"frameon": False, "fontsize": 9} | options))


def _ratio_name(run) -> str:
    near, far = run.series["position"]["channels"]
    return f"ln of the counts, {far} over {near}"


def _position(run):
    series = run.series["position"]
    x_mm, response = series["along_um"] / 1000, series["log_ratio"]
    slope, zero = np.polyfit(x_mm, response, 1)
    figure, (top, bottom) = panels(rows=2, height=5.5, sharex=True, height_ratios=(2, 1))
    line(top, 0, x_mm, response, "measured", linestyle="none")
    top.plot(x_mm, zero + slope * x_mm, color=_COLOURS[1], label="straight line", zorder=1)
    r2 = np.corrcoef(x_mm, response)[0, 1] ** 2
    title = f"The log ratio is nearly linear in the position: R² = {r2:.6f}"
    label(top, title, "", _ratio_name(run))
    legend(top)
    residual_um = 1000 * (response - zero - slope * x_mm) / slope
    line(bottom, 0, x_mm, residual_um)
    bottom.axhline(0, color=_GREY, linewidth=1)
    title = "Deviation from the line; the calibration's tables correct it"
    label(bottom, title, "position (mm)", "residual (µm)")
    return figure


def _resolution(run, reading: str):
    from matplotlib.ticker import LogLocator, NullFormatter

    series, found = run.series["position"], run.summary["position"]
    x_mm = series["x_um"] / 1000
    near, far = series["channels"]
    figure, axis = panels(height=4.8)
    line(axis, 1, x_mm, series["pair"] * series["bound"], f"scatter by one pair, {far} over {near}")
    line(axis, 0, x_mm, series["scatter"], "scatter by six channels")
    axis.plot(x_mm, series["bound"], color="black", linewidth=2, label="least possible scatter")
    line(axis, 2, x_mm, series["resolution"], "resolution: scatter at rest", linestyle="none")
    line(axis, 4, x_mm, series["accuracy"], "accuracy: mean absolute error", linestyle=":")
    title = (
        f"Scatter is {found['crb_ratio']:.2f} times the bound, "
        f"{found['one_pair']['crb_ratio']:.2f} times by the best pair ({reading})"
    )
    label(axis, title, "position (mm)", "µm", yscale="log")
    axis.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.yaxis.set_major_formatter("{x:g}")
    axis.yaxis.set_minor_formatter(NullFormatter())
    legend(axis, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2)
    return figure


def _family(run, responses: dict):
    figure, (left, right) = panels(columns=2, width=10, sharey=True)
    for i, (length_mm, response) in enumerate(sorted(responses["length"].items(), reverse=True)):
        # The longest strip is drawn first, with a wide line, so that the other lines are visible.
        wide = {"linewidth": 6 - 2.2 * i, "alpha": 0.45 + 0.25 * i, "markersize": 5}
        line(left, i, response.x_um / 1000, response.log_ratio, f"{length_mm:g} mm", **wide)
    title = "Same dye: strips of other lengths share one response"
    label(left, title, "position (mm)", _ratio_name(run))
    legend(left, title="length")
    for i, (times, response) in enumerate(responses["dye"].items()):
        line(right, 3 + i, response.x_um / 1000, response.log_ratio, f"{times:g}")
    label(right, "More dye: a steeper response", "position (mm)", "")
    legend(right, title="times the dye")
    return figure


def _force(run, reading: str):
    series, found = run.series["force"], run.summary["force"]
    figure, (left, right) = panels(columns=2, width=10)
    shares = np.unique(series["share"])
    middle = shares[len(shares) // 2]
    for i, share in enumerate(shares):
        rows = series["share"] == share
        force_N = series["force_mN"][rows] / 1000
        if share == middle:
            light = 2.0 ** series["brightness"][rows]
            line(left, 0, force_N, light / light.max(), "in the middle of the strip")
        line(right, i, force_N, series["error_mN"][rows] / 1000, f"{share:.1%}")
    left.axvspan(0, found["threshold_mN"] / 1000, color=_GREY, alpha=0.35, label="dead zone")
    title = "Light against force: the slope decreases"
    label(left, title, "force (N)", "light, share of its maximum", xlim=(0, None), ylim=(0, 1.05))
    legend(left)
    right.axhline(0, color=_GREY, linewidth=1)
    title = f"Accuracy {found['accuracy_N']:.3f} N, {reading}"
    label(right, title, "force (N)", "mean error of held presses (N)")
    legend(right, title="position / length")
    return figure


def _strain(run, reading: str):
    figure, (left, right) = panels(columns=2, width=10)
    series = run.series["strain"]
    slope, zero = np.polyfit(series[0]["along_um"], series[0]["log_ratio"], 1)
    for i, (percent, found) in enumerate(series.items()):
        beyond = found["log_ratio"] - zero - slope * found["along_um"]
        line(left, i, found["along_um"] / 1000, beyond, f"{percent} %", markersize=3)
    left.axhline(0, color=_GREY, linewidth=1)
    title = "Each strain has its own response"
    label(left, title, "position on the stretched strip (mm)", "ln ratio minus the line at rest")
    legend(left, title="strain", ncols=2)
    _bars(right, {percent: found["accuracy"][2] for percent, found in series.items()})
    title = f"Accuracy when the strain is known, {reading}"
    label(right, title, "strain (%)", "mean absolute error (µm)")
    return figure


def _bars(axis, errors_um: dict) -> None:
    at = np.arange(len(errors_um))
    means = [errors.mean() for errors in errors_um.values()]
    axis.bar(at, means, 0.6, color=_COLOURS[5], label="mean along the strip")
    dots = {"linestyle": "none", "marker": "o", "markersize": 3, "color": _GREY, "alpha": 0.6}
    for i, errors in enumerate(errors_um.values()):
        axis.plot(np.full(len(errors), i), errors, label=None if i else "at a place", **dots)
    axis.set_xticks(at, [f"{condition:g}" for condition in errors_um])
    axis.set_ylim(0, 1.3 * max(errors.max() for errors in errors_um.values()))
    legend(axis, ncols=2)


def _bending(run, reading: str):
    series = run.series["bend"]
    figure, (left, right) = panels(columns=2, width=10)
    for i, (degrees, (x_um, error_um, _)) in enumerate(series.items()):
        line(left, i, x_um / 1000, error_um, f"{degrees}°", linewidth=1)
    left.axhline(0, color=_GREY, linewidth=1)
    label(left, "Errors of the bent strip", "position (mm)", "mean error (µm)")
    low_um, high_um = left.get_ylim()
    left.set_ylim(low_um, high_um + _LEGEND * (high_um - low_um))
    legend(left, title="bend", ncols=3, loc="upper left")
    _bars(right, {degrees: found[2] for degrees, found in series.items()})
    title = f"Bent, calibrated straight, {reading}"
    label(right, title, "bend (°)", "mean absolute error (µm)")
    return figure


def _joint(run, reading: str):
    series, found = run.series["joint"], run.summary["joint"]
    figure, (left, right) = panels(columns=2, width=10)
    for i, (direction, name) in enumerate({1: "opening", -1: "closing"}.items()):
        rows = series["direction"] == direction
        angle, position_mm = series["angle_deg"][rows], series["position_um"][rows] / 1000
        apart = {"markersize": 5 + 3 * i} | ({"markerfacecolor": "none"} if i else {})
        line(left, i, angle, position_mm, name, linestyle="none", **apart)
        line(right, i, angle, series["error_deg"][rows], name)
    title = f"A soft encoder: R² = {found['r2']:.7f}"
    label(left, title, "angle of the joint (°)", "position (mm)")
    legend(left)
    right.axhline(0, color=_GREY, linewidth=1)
    title = f"Backlash {found['backlash_deg']:.3f}°, {reading}"
    label(right, title, "angle of the joint (°)", "mean error of held angles (°)")
    legend(right)
    return figure
