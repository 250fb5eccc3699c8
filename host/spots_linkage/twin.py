"""``spots twin``: shows a linkage's digital twin, or calibrates or simulates a linkage."""

import argparse
import json
import math
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path

from spots.common.atomic import check_writable, write_text
from spots.common.other_clock import OtherClock
from spots.common.plugins import entry_points
from spots.errors import CalibrationError, SettingError, missing, printable
from spots.link.board import Board
from spots.link.ports import offered
from spots.terminal.opening import doubted
from spots.terminal.view import Pace, drawn

from . import mounted
from .digital_twin import Terminal
from .mjcf import mjcf
from .twin_points import fit, measure
from .twin_source import Source, has_boards, is_recording, opened, paced
from .twin_view import TwinView

_LINES_PER_S = 4
_JOINTS = "joint1", "joint2"  # as in the model for MuJoCo


def twin_command(options: argparse.Namespace) -> None:
    """Run ``spots twin``; SpotsError if a file is wrong, or two options exclude each other."""
    ports = options.port
    played = any(map(is_recording, ports))
    boards = has_boards(options.linkage, ports)
    if not boards and options.linkage.endswith(".toml") and not Path(options.linkage).exists():
        mounted.load(options.linkage)  # raises the error about the file, before others follow
    if options.measure and (played or not boards):
        raise SettingError(
            "--measure needs real boards, because you move the end point by hand: name the boards "
            "with --port"
        )
    if options.picture and (ports or boards):
        raise SettingError(
            "--picture shows a simulated linkage: leave out --port, and name no linkage file of "
            "real boards"
        )
    if options.mjcf:
        _export(options)
        return
    if options.out and not options.calibrate:
        raise SettingError("--out writes what --calibrate finds: add --calibrate POINTS.csv")
    if options.calibrate:
        others = "port", "seconds", "json", "record", "measure", "picture"
        if any(getattr(options, name) for name in others):
            raise SettingError(
                "--calibrate reads a file of points and no board: leave out all options except "
                "--linkage, --place-sigma-mm and --out"
            )
        out = options.out and Path(options.out)
        sigma_mm = options.place_sigma_mm
        print(fit(Path(options.calibrate), Path(options.linkage), sigma_mm, out))
    elif boards:
        if options.measure:
            check_writable(Path(options.measure), append=True)
        with opened(options.linkage, ports, options.record) as source:
            if options.measure:
                _measure(source, Path(options.measure), options.linkage)
                return
            for board in dict.fromkeys(source.boards):
                doubted(board)
            with ExitStack() as stack:
                publish = _publisher(stack, source.boards[0]) if options.publish else None
                count = show(source, options.seconds, options.json, played, publish)
            if not count and all(board.ended for board in source.boards):
                raise CalibrationError(
                    "the recordings give no position: name recordings in which both strips are "
                    "pressed at the same time"
                )
    else:
        offered("virtual", "run_linkage")(options)


def show(
    source: Source,
    seconds: float | None,
    as_json: bool = False,
    played: bool = False,
    publish: Callable[[Terminal], object] | None = None,
) -> int:
    """Show a linkage's digital twin as a live picture or as lines, until Ctrl-C or `seconds`.

    It ends when recordings end, too. With `as_json`, each position is a JSON object. Otherwise a
    terminal window shows a picture, and any other output gets at most four lines a second. With
    `played`, a picture shows recordings at their original pace. Returned is the number of values
    that the twin computed, including those without a position. PortError if a board is lost.
    """
    pace, count = Pace(), 0
    on_terminal = _json if as_json else Lines()
    view = TwinView(source.twin, [board.port for board in source.boards])
    with suppress(KeyboardInterrupt), drawn(not as_json) as display:
        pairs = source.readings(seconds)
        for joint, touch in paced(pairs) if played and display else pairs:
            for terminal in source.twin.take(joint, touch):
                count += 1
                if publish:
                    publish(terminal)
                if not display:
                    on_terminal(terminal)
            if display and pace.due(touch.time_s):
                stats = [board.stats for board in source.boards]
                display.update(view.picture(stats, touch.time_s), refresh=True)
    return count


def _publisher(stack: ExitStack, board: Board) -> Callable[[Terminal], object]:
    made = [one.load() for one in entry_points(group="spots.commands", name="joints.ros2")]
    if not made:
        raise missing("--publish needs", "the package for networks", "zenoh")
    node = made[0]()
    stack.callback(node.close)

    utc = OtherClock(time.time, board.now_s)

    def put(terminal: Terminal) -> None:
        utc_s = utc.at(terminal.time_s)
        node.put_angles(dict(zip(_JOINTS, terminal.theta_rad)), utc_s)
        if terminal.x_mm is not None and terminal.y_mm is not None:
            node.put_point(terminal.x_mm, terminal.y_mm, utc_s)

    return put


def _export(options: argparse.Namespace) -> None:
    others = "port", "seconds", "json", "record", "measure", "picture", "calibrate", "out"
    if any(getattr(options, name) for name in others):
        raise SettingError(
            "--mjcf writes the linkage of a linkage file: leave out all options except --linkage"
        )
    if not options.linkage.endswith(".toml"):
        raise SettingError(
            f"--mjcf cannot write the simulated linkage '{options.linkage}': name a linkage file "
            "of real boards; docs/play/linkage.md shows how to write one"
        )
    linkage = mounted.load(options.linkage).linkage
    write_text(mjcf(linkage), options.mjcf, None)
    print(f"wrote a model for MuJoCo: {printable(options.mjcf)}")


def _measure(source: Source, points: Path, linkage: str) -> None:
    shown, arm = printable(str(points)), printable(linkage)
    try:
        count = measure(source, points)
    except (EOFError, KeyboardInterrupt):
        kept = f"{shown} keeps its points" if points.exists() else "nothing is stored"
        print(f"\nstopped: {kept}; the same command adds more points")
        return
    print(f"{shown} has {count} points; next: spots twin --linkage {arm} --calibrate {shown}")


def _json(terminal: Terminal) -> None:
    print(json.dumps(terminal.message()), flush=True)


class Lines:
    """Prints positions of the end point as lines, at most four in a second."""

    def __init__(self):
        self._began_s: float | None = None
        self._pace = Pace(_LINES_PER_S)

    def __call__(self, terminal: Terminal) -> None:
        if self._began_s is None:
            self._began_s = terminal.time_s
        if self._pace.due(terminal.time_s):
            print(line(terminal, self._began_s), flush=True)


def line(terminal: Terminal, began_s: float) -> str:
    """Return a position as text; `began_s` is the time of `Terminal.time_s` that counts as 0 s."""
    theta = "  ".join(f"{math.degrees(angle):8.2f}" for angle in terminal.theta_rad)
    text = f"{terminal.time_s - began_s:7.2f} s  joints {theta} deg"
    if not terminal.limit:
        major, minor, angle = terminal.ellipse
        text += (
            f"  end point {terminal.x_mm:8.2f} {terminal.y_mm:8.2f} mm  "
            f"+- {major:.3f} x {minor:.3f} mm at {math.degrees(angle):4.0f} deg"
        )
        if terminal.velocity_mm_s is not None:
            text += f"  {math.hypot(*terminal.velocity_mm_s):6.1f} mm/s"
    return f"{text}  {terminal.remark}".rstrip()
