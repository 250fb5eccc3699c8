"""``spots twin``: a linkage's twin as a picture, lines, JSON, or against a simulated truth."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

from rich.console import Console

from ..errors import SpotsError, printable
from ..link.ports import offered
from ..terminal.view import Pace, live
from .digital_twin import Terminal
from .mounted import is_mounted
from .twin_points import fit, measure
from .twin_source import Source, driven, is_recording, linkage_of, opened, paced
from .twin_view import TwinView

_LINES_PER_S = 4


def twin_command(options: argparse.Namespace) -> None:
    """Run ``spots twin`` with the options that `cli` parsed.

    Raises
    ------
    SpotsError
        If a file or an option does not allow it.
    """
    ports = options.port
    simulated = linkage_of(ports)
    on_terminal = _json if options.json else None
    boards = (ports and not simulated) or is_mounted(options.linkage)
    if options.measure and simulated:
        raise SpotsError("--measure is for boards: nobody can move a simulated linkage by hand")
    if options.picture and (simulated or boards):
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
        print(fit(Path(options.calibrate), Path(options.linkage), sigma_mm, out))
    elif simulated:
        given = {"path": options.path, "exposure_us": options.exposure_us}
        given = {name: value for name, value in given.items() if value is not None}
        linkage = simulated(options.sensor, options.linkage, seed=options.seed, **given)
        with driven(linkage, options.record) as source:
            show(source, options.seconds, on_terminal)
    elif boards:
        played = any(map(is_recording, ports))
        if options.measure and played:
            raise SpotsError("--measure is for boards: a recording cannot be asked for a place")
        with opened(options.linkage, ports, options.record) as source:
            if options.measure:
                _measure(source, Path(options.measure))
            else:
                show(source, options.seconds, on_terminal, played)
    elif options.record or options.measure or options.seconds:
        raise SpotsError("--record, --measure and --seconds are for boards: name them with --port")
    else:
        compare = offered("virtual", "compare_linkage")
        if compare is None:
            raise SpotsError("name a linkage file with --linkage, or boards with --port")
        compare(options)


def show(
    source: Source,
    seconds: float | None,
    on_terminal: Callable[[Terminal], None] | None = None,
    played: bool = False,
) -> int:
    """Show a twin until the time is over or Ctrl-C, and return how many terminals there were.

    Parameters
    ----------
    source : Source
    seconds : float or None
    on_terminal : callable, optional
        Called with each terminal; if not given, there is a live picture on a terminal and plain
        lines elsewhere.
    played : bool
        Whether it is a recording, which is paced for a picture, else read as fast as possible.

    Returns
    -------
    int

    Raises
    ------
    SpotsError
        If a board is lost, or recordings that are played give no terminal.
    """
    console = Console()
    drawing = console.is_terminal and on_terminal is None
    on_terminal = on_terminal or Lines()
    view = TwinView(source.twin, source.names)
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
                        on_terminal(terminal)
                if drawing and pace.due(touch.time_s):
                    display.update(view.picture(source.stats(), touch.time_s), refresh=True)
    except KeyboardInterrupt:
        return count
    if played and not count:
        raise SpotsError("the recordings have no terminal: were they made at the same time?")
    return count


def _measure(source: Source, points: Path) -> None:
    try:
        count = measure(source, points)
    except (EOFError, KeyboardInterrupt):
        print()
        return
    shown = printable(str(points))
    print(f"{shown} has {count} points; 'spots twin --calibrate {shown}' goes on from there")


def _json(terminal: Terminal) -> None:
    print(json.dumps(terminal.message()), flush=True)


class Lines:
    """Prints a line now and then."""

    def __init__(self):
        self._began_s: float | None = None
        self._pace = Pace(_LINES_PER_S)

    def __call__(self, terminal: Terminal) -> None:
        if self._began_s is None:
            self._began_s = terminal.time_s
        if self._pace.due(terminal.time_s):
            print(line(terminal, self._began_s), flush=True)


def line(terminal: Terminal, began_s: float) -> str:
    """Return a terminal as a line of text.

    Parameters
    ----------
    terminal : Terminal
        An estimate.
    began_s : float
        Where its time counts from, in seconds by the clock of the readings.

    Returns
    -------
    str
        Time in s, joints in degrees, place and standard errors in mm.
    """
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
