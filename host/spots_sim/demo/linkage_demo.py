"""Runs a simulated five-bar linkage in real time, or measures its twin's error in simulated time.

The digital twin (`spots_linkage.Twin`) computes the position of the end point. Its input is the
readings of two strips, one in each base joint of the linkage.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from spots.errors import FileError, SettingError
from spots_linkage.digital_twin import Terminal, Twin
from spots_linkage.mounted import is_mounted
from spots_linkage.twin import Lines, show
from spots_linkage.twin_source import DrivenLinkage, Source, record_all

from ..board.runtimes import headline
from ..measure import maps
from ..measure.simulated_linkage import EXPOSURE_US, PATH, Endless
from ..measure.survey import follow
from ..strip.defaults import given
from ..strip.files import (
    LinkageFile,
    PathFile,
    SensorFile,
    load,
)

_KINDS = SensorFile, LinkageFile, PathFile


def endless(
    sensor: str = "default",
    linkage: str = "default",
    path: str = PATH,
    seed: int = 0,
    exposure_us: int = EXPOSURE_US,
) -> Endless:
    """Return a simulated linkage that repeats a path without end, in real time.

    Parameters
    ----------
    sensor, linkage, path : str
        Sensor, linkage and path file: each a path, or a name such as ``default`` or ``sust``.
    seed : int
        Random seed of the noise.
    exposure_us : int
        Integration time of both strips, in us.

    Returns
    -------
    Endless
        Its boards start when `Endless.open` is called.

    Raises
    ------
    SettingError
        If a file is missing or invalid, the linkage cannot follow the path, or `linkage` is the
        file of a real linkage.
    """
    if is_mounted(linkage):
        raise SettingError(
            f"{linkage} is the file of a linkage with real boards: leave out --port virtual, or "
            "name the file of a simulated linkage, such as 'default'"
        )
    files = [load(kind, name) for kind, name in zip(_KINDS, (sensor, linkage, path))]
    print("calibrating two simulated strips (some seconds) ...", file=sys.stderr, flush=True)
    return Endless(*files, seed, exposure_us)


@contextmanager
def driven(machine: DrivenLinkage, record: list[str] = ()) -> Iterator[Source]:
    """Open both boards of a simulated linkage; use this function in a ``with`` statement.

    Parameters
    ----------
    machine : DrivenLinkage
        The simulated linkage; `driven` opens its boards and closes them at the end.
    record : list of str
        Paths of two recordings to write, one for each board. Empty for no recording.

    Yields
    ------
    Source
        The linkage's digital twin, and the two boards that it reads.

    Raises
    ------
    SpotsError
        If a board cannot be opened.
    """
    with ExitStack() as stack:
        boards = [stack.enter_context(machine.open(joint)) for joint in (0, 1)]
        record_all(stack, boards, record)
        yield Source(Twin(machine.linkage, machine.encoders()), boards, (0, 0))


def run(options) -> None:
    """Run ``spots twin`` on a simulated linkage.

    With ``--port``, the linkage moves in real time. Without ``--port``, `compare` moves it in
    simulated time.

    Parameters
    ----------
    options : argparse.Namespace
        Options of ``spots twin``.

    Raises
    ------
    SettingError
        If a file is missing or invalid, an option needs ``--port``, or several ports are named.
    """
    options = given(options)
    if len(options.port) > 1:
        raise SettingError(
            f"'virtual' simulates a whole linkage, but --port was given {len(options.port)} times: "
            "give --port virtual once, or name the ports of real boards"
        )
    if options.port:
        chosen = {"path": options.path, "exposure_us": options.exposure_us}
        chosen = {name: value for name, value in chosen.items() if value is not None}
        linkage = endless(options.sensor, options.linkage, seed=options.seed, **chosen)
        with driven(linkage, options.record) as source:
            show(source, options.seconds, options.json)
    elif options.record or options.seconds:
        raise SettingError("--record and --seconds need boards: name the boards with --port")
    else:
        compare(options)


def demonstrate(sensor: str, seed: int, seconds: float | None, fast: bool, quiet: bool) -> dict:
    """Show the default linkage following the default path, and return the results of the run.

    Parameters
    ----------
    sensor : str
        Sensor file: a path, or a name such as ``default``.
    seed : int
        Random seed of the noise.
    seconds : float or None
        Duration in seconds of real time; None for no limit. Ignored if `fast` is true.
    fast : bool
        True for simulated time; the linkage then follows its path one time.
    quiet : bool
        True to print nothing on standard output.

    Returns
    -------
    dict
        Results of the run: in simulated time those of `survey.PathRun.summary`. In real time,
        ``terminals``: number of estimates, including those without a position (`Terminal.limit`);
        ``frames`` and ``lost``: numbers of received and of lost frames, of both boards together.

    Raises
    ------
    SpotsError
        If the sensor file is missing or invalid.
    """
    if fast:
        files = [load(kind, name) for kind, name in zip(_KINDS, (sensor, "default", PATH))]
        if not quiet:
            print(headline(), flush=True)
        return follow(*files, seed, report=_ignore if quiet else Lines()).summary()
    machine = endless(sensor, seed=seed)
    if not quiet:
        print(headline(), flush=True)
    with driven(machine) as source:
        shown = sum(1 for _ in source.follow(seconds)) if quiet else show(source, seconds)
        stats = [board.stats for board in source.boards]
    return {
        "terminals": shown,
        "frames": sum(one.frames for one in stats),
        "lost": sum(one.lost for one in stats),
    }


def compare(options) -> None:
    """Move a linkage along a path in simulated time, and print the error of its digital twin.

    Parameters
    ----------
    options : argparse.Namespace
        Options of ``spots twin``.

    Raises
    ------
    FileError, SettingError
        If a file is missing or invalid, the linkage cannot follow the path, or the picture cannot
        be written.
    """
    picture = options.picture and Path(options.picture)
    names = options.sensor, options.linkage, options.path or PATH
    files = [load(kind, name) for kind, name in zip(_KINDS, names)]
    if picture:
        maps.require()
        if picture.suffix.lower() != ".png":
            raise SettingError(f"--picture needs a file name that ends in .png, not '{picture}'")
        if not picture.parent.is_dir():
            raise FileError(f"there is no folder {picture.parent}: make it first", picture.parent)
    exposure_us = options.exposure_us or EXPOSURE_US
    found = follow(*files, options.seed, exposure_us, _ignore if options.json else Lines())
    if picture:
        maps.trajectory(found, picture)
    summary = found.summary()
    if options.json:
        print(json.dumps(summary))
        return
    error = summary["error_mm"]
    print(
        f"{summary['terminals']} estimates, {summary['rate_hz']:g} a second; error: "
        f"{error['mean']:.3f} mm mean, {error['max']:.3f} mm maximum"
    )


def _ignore(terminal: Terminal) -> None:
    pass
