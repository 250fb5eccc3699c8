"""``spots twin``: the twin of a simulated linkage on a path, as lines, figures or a picture."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

from ..errors import SpotsError
from ..sim.files import LinkageFile, PathFile, SensorFile, load
from . import maps
from .survey import follow
from .twin import Terminal

_LINES_PER_S = 4


def run(
    sensor: str,
    linkage: str,
    path: str,
    seed: int,
    exposure_us: int,
    as_json: bool,
    picture: str | None,
) -> None:
    """Follow a path and print what the twin told.

    Parameters
    ----------
    sensor, linkage, path : str
        Files, by path or name.
    seed : int
        Of the noise.
    exposure_us : int
        Of the strips.
    as_json : bool
        Print one JSON object: the errors against the truth.
    picture : str or None
        A PNG file.

    Raises
    ------
    SpotsError
        If a file or an option does not allow it.
    """
    files = load(SensorFile, sensor), load(LinkageFile, linkage), load(PathFile, path)
    if picture is not None:
        maps.require()
        if Path(picture).suffix.lower() != ".png":
            raise SpotsError(f"--picture takes the name of a PNG file, not '{picture}'")
        if not Path(picture).parent.is_dir():
            raise SpotsError(f"there is no folder {Path(picture).parent} for the picture")
    found = follow(*files, seed, exposure_us, (lambda terminal: None) if as_json else _Lines())
    if picture is not None:
        maps.trajectory(found, Path(picture))
    summary = found.summary()
    if as_json:
        print(json.dumps(summary))
        return
    error = summary["error_mm"]
    print(
        f"{summary['terminals']} terminals, {summary['rate_hz']:g} a second; off by "
        f"{error['mean']:.3f} mm in the mean, {error['max']:.3f} mm at most"
    )


class _Lines:
    """Prints a line now and then."""

    def __init__(self):
        self._began_s: float | None = None
        self._due_s = -math.inf

    def __call__(self, terminal: Terminal) -> None:
        if self._began_s is None:
            self._began_s = terminal.time_s
        if terminal.time_s >= self._due_s:
            self._due_s = terminal.time_s + 1 / _LINES_PER_S
            print(line(terminal, self._began_s), flush=sys.stdout.isatty())


def line(terminal: Terminal, began_s: float) -> str:
    """Return a terminal as a line of text."""
    theta = "  ".join(f"{math.degrees(angle):8.2f}" for angle in terminal.theta_rad)
    head = f"{terminal.time_s - began_s:7.2f} s  joints {theta} deg"
    if terminal.limit:
        return f"{head}  {terminal.limit.sentence}"
    major, minor, angle = terminal.ellipse
    text = (
        f"{head}  terminal {terminal.x_mm:8.2f} {terminal.y_mm:8.2f} mm  "
        f"+- {major:.3f} x {minor:.3f} mm at {math.degrees(angle):4.0f} deg"
    )
    if terminal.velocity_mm_s is not None:
        text += f"  {math.hypot(*terminal.velocity_mm_s):6.1f} mm/s"
    if terminal.singular:
        text += "  near singular"
    if not terminal.within:
        text += "  beyond what was calibrated"
    return text
