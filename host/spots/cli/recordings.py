"""Commands for recordings."""

import argparse
import json
import os
import sys
from pathlib import Path

from ..common.atomic import check_writable, exists
from ..errors import printable
from . import arguments
from .parser import Parser

PURPOSE = "record and replay"


def record(parser: Parser):
    """Record the data of a board in a file.

    examples:
      spots record run.spots
      spots record run.spots --seconds 60 --calibration calibration.toml
    """
    parser.option("file", "FILE.spots", "a new file")
    arguments.add_port(parser, without=["recording"])
    arguments.add_wait(parser)
    arguments.add_seconds(parser, "stop after this time in seconds; Ctrl-C stops, too")
    parser.option(
        "--rotate-mb",
        "N",
        "continue in FILE-001.spots after this size in MB",
        type=arguments.megabytes,
    )
    parser.option(
        "--calibration", "FILE.toml", "calibration file of the board, to be stored in the recording"
    )
    parser.flag(
        "--marks", "mark the moment of each line of standard input: type a name, or just Enter"
    )
    return _record


def replay(parser: Parser):
    """Show a recording as 'monitor' shows a board.

    example:
      spots replay run.spots --speed 2
    """
    parser.option("file", "FILE.spots", "a recording")
    parser.option(
        "--speed",
        "N",
        "speed of the playback: 2 is twice as fast, inf has no pauses",
        type=arguments.speed,
        default=1.0,
    )
    return _replay


def info(parser: Parser):
    """Print a summary of a recording.

    example:
      spots info run.spots
    """
    parser.option("file", "FILE.spots", "a recording")
    parser.flag("--json", "print one JSON object")
    return _info


def export(parser: Parser):
    """Convert a recording to MCAP, CSV, NumPy arrays, a bag of ROS 2 or a dataset of LeRobot.

    example:
      spots export run.spots --to csv
    """
    parser.option("file", "FILE.spots", "a recording")
    parser.add_argument(
        "--to",
        required=True,
        metavar="FORMAT",
        help="mcap, csv or npz, or a format of another package: ros2 (MCAP of ROS 2), lerobot "
        "(dataset v3.0; an episode from each mark to the next one)",
    )
    parser.option(
        "--out",
        "NAME",
        "the new file; named like the recording if not given; with csv, a file for each kind, "
        "and the settings in NAME-header.json",
    )
    return _export


def recalibrate(parser: Parser):
    """Compute positions and forces of a recording again with another calibration.

    The result is a new recording, with the readings that the board would have sent. It needs the
    spectra of 'spots record', firmware of this version, and a calibration at the gain, LED current
    and channels of the recording: calibrate with --keep-settings.

    examples:
      spots recalibrate run.spots --calibration new.toml
      spots recalibrate run.spots --calibration new.toml --out again.spots
    """
    parser.option("file", "FILE.spots", "a recording")
    parser.option(
        "--calibration",
        "FILE.toml",
        "calibration file of the board; several for a board with several strips",
        action="append",
        required=True,
    )
    parser.option("--out", "FILE.spots", "the new recording; FILE-recalibrated.spots if not given")
    return _recalibrate


COMMANDS = record, replay, info, export, recalibrate


def _record(options: argparse.Namespace) -> None:
    from ..calibrate.calibration_file import load
    from ..recording.record import record

    rotate_bytes = options.rotate_mb and round(1e6 * options.rotate_mb)
    # Before a board is opened, so that an invalid file is reported first.
    path = Path(options.file)
    if os.path.lexists(path):
        raise exists(path)
    check_writable(path)
    calibration = options.calibration and list(load(Path(options.calibration)).lines)
    with arguments.open_board(options) as board:
        record(board, options.file, options.seconds, rotate_bytes, calibration, options.marks)


def _replay(options: argparse.Namespace) -> None:
    from ..recording.replay import open_recording
    from ..terminal.monitor import watch
    from ..terminal.opening import doubted

    with doubted(open_recording(options.file, options.speed)) as board:
        watch(board, None, quiet=False)


def _info(options: argparse.Namespace) -> None:
    from ..recording.info import report, summary

    found = summary(options.file)
    print(json.dumps(found) if options.json else report(found))


def _export(options: argparse.Namespace) -> None:
    from ..recording.export import export
    from ..terminal.opening import print_doubts

    def warn(doubts: list[str]) -> None:
        print_doubts(options.file, doubts)

    for path in export(options.file, options.to, options.out, warn):
        print(printable(str(path)))


def _recalibrate(options: argparse.Namespace) -> None:
    from ..recording.recalibrate import recalibrate

    made = recalibrate(options.file, options.calibration, options.out)
    for path in made.paths:
        print(printable(str(path)))
    print(f"spots: {made.known} readings computed, {made.unknown} unknown", file=sys.stderr)
    for why in made.why:
        print(f"spots: {printable(why)}", file=sys.stderr)
