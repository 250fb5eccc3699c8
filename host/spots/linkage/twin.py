"""``spots twin``: a linkage's twin as a picture, lines, JSON, or against a simulated truth."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

from rich.console import Console

from spots_sim import maps
from spots_sim.files import LinkageFile, PathFile, SensorFile, load
from spots_sim.survey import follow

from ..errors import SpotsError, printable
from ..link.connect import RECORDING, VIRTUAL
from ..terminal.view import Pace, live
from .digital_twin import Terminal
from .mounted import is_mounted
from .twin_points import fit, measure
from .twin_source import Source, opened, paced, simulated
from .twin_view import View

_LINES_PER_S = 4


def run(options: argparse.Namespace) -> None:
    """Run ``spots twin`` with the options that `cli` parsed.

    Raises
    ------
    SpotsError
        If a file or an option does not allow it.
    """
    ports, virtual = options.port, VIRTUAL in options.port
    tell = _json if options.json else None
    boards = (ports and not virtual) or is_mounted(options.linkage)
    if options.measure and virtual:
        raise SpotsError("--measure is for boards: nobody can move a simulated linkage by hand")
    if options.picture and (virtual or boards):
        raise SpotsError(
            "--picture draws a simulated path: boards know no truth, and --port virtual has no end"
        )
    if options.out and not options.calibrate:
        raise SpotsError("--out is what --calibrate POINTS.csv finds: name the points, too")
    if options.calibrate:
        others = "port", "seconds", "json", "record", "measure", "picture"
        if any(getattr(options, name) for name in others):
            raise SpotsError(
                "--calibrate reads points, and no board: it goes with --linkage, --place-sigma-mm "
                "and --out alone"
            )
        out = options.out and Path(options.out)
        sigma_mm = options.place_sigma_mm
        print(printable(str(fit(Path(options.calibrate), Path(options.linkage), sigma_mm, out))))
    elif virtual:
        files = options.sensor, options.linkage, options.path, options.seed, options.exposure_us
        with simulated(*files, options.record) as source:
            show(source, options.seconds, tell)
    elif boards and options.measure:
        if any(port.startswith(RECORDING) for port in ports):
            raise SpotsError("--measure is for boards: a recording cannot be asked for a place")
        with opened(options.linkage, ports, options.record) as source:
            _measure(source, Path(options.measure))
    elif boards:
        with opened(options.linkage, ports, options.record) as source:
            played = bool(ports) and ports[0].startswith(RECORDING)
            show(source, options.seconds, tell, played)
    elif options.record or options.measure or options.seconds:
        raise SpotsError("--record, --measure and --seconds are for boards: name them with --port")
    else:
        _compare(options)


def demonstrate(sensor: str, seed: int, seconds: float | None, fast: bool, quiet: bool) -> dict:
    """Show the default linkage on its path, in real time or fast, and return the run in figures."""
    if fast:
        kinds, names = (SensorFile, LinkageFile, PathFile), (sensor, "default", "sust")
        tell = _ignore if quiet else _Lines()
        return follow(*map(load, kinds, names), seed, tell=tell).summary()
    with simulated(sensor, seed=seed) as source:
        told = show(source, seconds, tell=_ignore if quiet else None)
        stats = source.stats()
    return {
        "terminals": told,
        "frames": sum(one.frames for one in stats),
        "lost": sum(one.lost for one in stats),
    }


def show(
    source: Source,
    seconds: float | None,
    tell: Callable[[Terminal], None] | None = None,
    played: bool = False,
) -> int:
    """Show a twin until the time is over or Ctrl-C, and return how many terminals it told.

    Parameters
    ----------
    source : Source
    seconds : float or None
    tell : callable, optional
        Given each terminal; if none, a live picture on a terminal and plain lines elsewhere.
    played : bool
        Whether it is a recording, which waits for nobody but people.
    """
    console = Console()
    drawing = console.is_terminal and tell is None
    tell = tell or _Lines()
    view = View(source.twin, source.names)
    count = 0
    pairs = source.readings(seconds)
    pairs = paced(pairs) if played and drawing else pairs
    pace = Pace()
    try:
        with live(console) if drawing else nullcontext() as display:
            for joint, touch in pairs:
                for terminal in source.twin.take(joint, touch):
                    count += 1
                    if not drawing:
                        tell(terminal)
                if drawing and pace.due(touch.time_s):
                    display.update(view.picture(source.stats(), touch.time_s), refresh=True)
    except KeyboardInterrupt:
        return count
    if played and not count:
        raise SpotsError("the recordings tell no terminal: were they made at the same time?")
    return count


def _measure(source: Source, points: Path) -> None:
    try:
        count = measure(source, points)
    except (EOFError, KeyboardInterrupt):
        print()
        return
    shown = printable(str(points))
    print(f"{shown} has {count} points; 'spots twin --calibrate {shown}' goes on from there")


def _compare(options: argparse.Namespace) -> None:
    """Follow a path in simulated time, and tell how near the twin came to the truth."""
    picture = options.picture and Path(options.picture)
    files = [
        load(kind, name)
        for kind, name in (
            (SensorFile, options.sensor),
            (LinkageFile, options.linkage),
            (PathFile, options.path),
        )
    ]
    if picture:
        maps.require()
        if picture.suffix.lower() != ".png":
            raise SpotsError(f"--picture takes the name of a PNG file, not '{picture}'")
        if not picture.parent.is_dir():
            raise SpotsError(f"there is no folder {picture.parent} for the picture")
    tell = _ignore if options.json else _Lines()
    found = follow(*files, options.seed, options.exposure_us, tell)
    if picture:
        maps.trajectory(found, picture)
    summary = found.summary()
    if options.json:
        print(json.dumps(summary))
        return
    error = summary["error_mm"]
    print(
        f"{summary['terminals']} terminals, {summary['rate_hz']:g} a second; off by "
        f"{error['mean']:.3f} mm in the mean, {error['max']:.3f} mm at most"
    )


def _ignore(terminal: Terminal) -> None:
    pass


def _json(terminal: Terminal) -> None:
    print(json.dumps(terminal.message()), flush=True)


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
            print(line(terminal, self._began_s), flush=True)


def line(terminal: Terminal, began_s: float) -> str:
    """Return a terminal as a line of text."""
    theta = "  ".join(f"{math.degrees(angle):8.2f}" for angle in terminal.theta_rad)
    text = f"{terminal.time_s - began_s:7.2f} s  joints {theta} deg"
    if not terminal.limit:
        major, minor, angle = terminal.ellipse
        text += (
            f"  terminal {terminal.x_mm:8.2f} {terminal.y_mm:8.2f} mm  "
            f"+- {major:.3f} x {minor:.3f} mm at {math.degrees(angle):4.0f} deg"
        )
        if terminal.velocity_mm_s is not None:
            text += f"  {math.hypot(*terminal.velocity_mm_s):6.1f} mm/s"
    return f"{text}  {terminal.remark}".rstrip()
