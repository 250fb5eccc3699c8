"""Draws pictures of a five-bar linkage (paper, Fig. 7). Needs matplotlib (extra ``plots``)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from spots_linkage.fivebar import Linkage

from .figures import label, legend, panels, require, save
from .survey import LEAST_OUTER_RAD, PathRun, Survey

_RED, _BLUE, _GREY, _BLACK = "#D55E00", "#0072B2", "#999999", "#222222"
_SAMPLES = 721


def iso_angles(linkage: Linkage, joint: int, theta_rad: float, usable=None) -> tuple:
    """Return the end point's path while one joint is fixed and the other turns (paper, Fig. 7B).

    The arrays x_mm and y_mm are masked where the linkage cannot reach, or ``usable(x_mm, y_mm)`` (a
    bool array of positions in the workspace) is false.
    """
    other = np.linspace(-np.pi, np.pi, _SAMPLES)
    theta = (theta_rad, other) if joint == 0 else (other, theta_rad)
    x_mm, y_mm = linkage.forward(*theta)
    # Beyond a stretched arm the elbow turns inwards; Eqs. 3 and 4 of the paper do not hold there.
    back = linkage.inverse(x_mm, y_mm)[joint]
    keep = np.ma.filled(abs(back - theta_rad) < 1e-6, False)
    if usable is not None:
        keep &= usable(np.ma.filled(x_mm, np.nan), np.ma.filled(y_mm, np.nan))
    return np.ma.MaskedArray(x_mm, mask=~keep), np.ma.MaskedArray(y_mm, mask=~keep)


def angles(linkage: Linkage, path: Path, step_deg: int = 10, mechanism=None) -> Path:
    """Draw lines of equal joint angles over the workspace, as in Fig. 7B of the paper.

    The joints of `mechanism` limit the workspace by their travel; by default, any travel is
    allowed. Needs matplotlib, like the functions below: RequirementError.
    """
    require()

    def usable(x_mm, y_mm):
        apart = linkage.outer_angle(*linkage.inverse(x_mm, y_mm))
        keep = (np.ma.filled(apart, 0.0) >= LEAST_OUTER_RAD) & (y_mm > 0)
        return keep & mechanism.reaches(x_mm, y_mm) if mechanism is not None else keep

    figure, axis = panels(width=7.0, height=5.6)
    for joint, colour in ((0, _RED), (1, _BLUE)):
        named = False
        for degrees in range(-180, 180, step_deg):
            x_mm, y_mm = iso_angles(linkage, joint, np.radians(degrees), usable)
            if x_mm.count() < 2:
                continue
            name = None if named else f"joint {joint + 1} fixed, every {step_deg}°"
            strong = degrees % 30 == 0
            axis.plot(x_mm, y_mm, color=colour, linewidth=1.5 if strong else 0.7, label=name)
            named = True
            if strong:
                # The label is at the start of the line, on the edge of the workspace.
                i = int(np.ma.argmin(x_mm) if joint == 0 else np.ma.argmax(x_mm))
                side = "right" if joint == 0 else "left"
                offset = (-4 if joint == 0 else 4, -3)
                axis.annotate(
                    f"{degrees}°",
                    (x_mm[i], y_mm[i]),
                    offset,
                    textcoords="offset points",
                    ha=side,
                    color=colour,
                    fontsize=8,
                )
    _bars(axis, linkage, (linkage.base_mm / 2, 1.5 * linkage.bar_mm[0]))
    label(axis, "Positions of the end point with one joint fixed", "x (mm)", "y (mm)")
    axis.set_aspect("equal")
    legend(axis, loc="center", bbox_to_anchor=(0.5, 0.32))
    return save(figure, path)


def deviation(survey: Survey, path: Path) -> Path:
    """Draw the end point's error over the workspace, as in Fig. 7C of the paper.

    The picture has three maps: with nominal lengths, with true lengths, and after a kinematic
    calibration.
    """
    require()
    parts = {
        "Nominal lengths and mounting": survey.drawn,
        "True lengths and mounting": survey.given,
        "Calibrated at 40 places": survey.calibrated,
    }
    figure, axes = panels(columns=3, width=12.5, height=2.9, sharey=True)
    fine_mm = max(survey.given.max_mm, survey.calibrated.max_mm)
    for i, (axis, (title, part)) in enumerate(zip(axes, parts.items())):
        top_mm = part.max_mm if i == 0 else fine_mm
        dots = axis.scatter(
            survey.x_mm, survey.y_mm, c=part.error_mm, s=30, marker="s", vmin=0, vmax=top_mm
        )
        figure.colorbar(dots, ax=axis, label="deviation (mm)", shrink=0.75)
        title = f"{title}:\nmean {part.mean_mm:.3f} mm, at most {part.max_mm:.2f} mm"
        label(axis, title, "x (mm)", "" if i else "y (mm)")
        axis.set_aspect("equal")
    return save(figure, path)


def trajectory(run: PathRun, path: Path) -> Path:
    """Draw a path, its estimate by the digital twin, and the error over time (paper, Fig. 7D)."""
    require()
    estimated = [terminal for terminal in run.terminals if not terminal.limit]
    time_s, x_mm, y_mm = np.array([(t.time_s, t.x_mm, t.y_mm) for t in estimated]).T
    begun_s = run.motion.time_s[0]
    figure, (top, bottom) = panels(rows=2, width=9.0, height=5.6, height_ratios=(2.6, 1))
    motion = run.motion
    on = np.where(motion.drawing, 1.0, np.nan)
    top.plot(motion.x_mm, motion.y_mm, color=_GREY, linewidth=0.7, alpha=0.6)
    top.plot(on * motion.x_mm, on * motion.y_mm, color=_GREY, linewidth=6, alpha=0.5, label="truth")
    wrote = np.interp(time_s, motion.time_s, motion.drawing) > 0.5
    top.plot(x_mm[~wrote], y_mm[~wrote], color=_BLUE, alpha=0.3, marker=".", ls="", markersize=2)
    on = np.where(wrote, 1.0, np.nan)
    top.plot(on * x_mm, on * y_mm, color=_BLUE, lw=1, marker=".", markersize=3, label="twin")
    figures = run.summary()["error_mm"]
    title = f"The path of the end point: mean error {figures['mean']:.3f} mm"
    label(top, title, "x (mm)", "y (mm)")
    top.set_aspect("equal")
    legend(top, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    sigma_mm = np.array([terminal.sigma_mm for terminal in estimated])
    bottom.plot(time_s - begun_s, run.error_mm, color=_BLUE, linewidth=0.9, label="error")
    bottom.plot(time_s - begun_s, sigma_mm, color=_BLACK, linewidth=1.2, label="expected, rms")
    title = f"Distance from the truth: at most {figures['max']:.2f} mm"
    label(bottom, title, "time (s)", "mm", ylim=(0, None))
    legend(bottom, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return save(figure, path)


def _bars(axis, linkage: Linkage, at_mm) -> None:
    """Draw the bars of a linkage, whose end point is at `at_mm` (x, y), on matplotlib axes."""
    theta1, theta2 = linkage.inverse(*at_mm)
    a1, _, _, a2 = linkage.bar_mm
    elbow1 = (a1 * np.sin(theta1), a1 * np.cos(theta1))
    elbow2 = (linkage.base_mm - a2 * np.sin(theta2), a2 * np.cos(theta2))
    places = [(0, 0), elbow1, at_mm, elbow2, (linkage.base_mm, 0)]
    axis.plot(*np.array(places).T, color=_BLACK, linewidth=3, marker="o", markersize=6, alpha=0.8)
    for name, place in (("joint 1", places[0]), ("joint 2", places[-1]), ("end point", at_mm)):
        axis.annotate(
            name,
            place,
            (8, -4),
            textcoords="offset points",
            fontsize=9,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 1},
        )
