"""Commands for recordings."""

from __future__ import annotations

import argparse
import json

from ..errors import printable
from . import arguments


def add(commands) -> None:
    """Add the commands to a parser's subparsers."""
    record = commands.add_parser("record", help="write what a board sends into a file")
    record.add_argument("file", metavar="FILE.spots", help="a new file")
    arguments.add_port(record)
    record.add_argument(
        "--seconds", type=arguments.seconds, help="end after so long; Ctrl-C ends it, too"
    )
    record.add_argument(
        "--rotate-mb", type=arguments.megabytes, help="go on in FILE-001.spots after so much"
    )
    record.add_argument("--calibration", metavar="FILE.toml", help="the board's, to have it there")
    record.set_defaults(run=_record)

    replay = commands.add_parser("replay", help="show a recording as 'monitor' shows a board")
    replay.add_argument("file", metavar="FILE.spots")
    replay.add_argument(
        "--speed", type=arguments.speed, default=1.0, help="2 is twice as fast, inf no pace"
    )
    replay.set_defaults(run=_replay)

    info = commands.add_parser("info", help="what is in a recording")
    info.add_argument("file", metavar="FILE.spots")
    info.add_argument("--json", action="store_true", help="one JSON object")
    info.set_defaults(run=_info)

    export = commands.add_parser("export", help="a recording as MCAP, CSV or NumPy arrays")
    export.add_argument("file", metavar="FILE.spots")
    export.add_argument("--to", required=True, choices=["mcap", "csv", "npz"])
    export.add_argument("--out", metavar="NAME", help="if not beside the recording")
    export.set_defaults(run=_export)


def _record(options: argparse.Namespace) -> None:
    from ..recording.record import read_calibration, record

    rotate_bytes = options.rotate_mb and round(1e6 * options.rotate_mb)
    # Before a board is opened: what is wrong with a file is said at once.
    calibration = None if options.calibration is None else read_calibration(options.calibration)
    with arguments.open_board(options) as board:
        record(board, options.file, options.seconds, rotate_bytes, calibration)


def _replay(options: argparse.Namespace) -> None:
    from ..recording.replay import open_recording
    from ..terminal.monitor import watch

    with open_recording(options.file, options.speed) as board:
        watch(board, None, quiet=False)


def _info(options: argparse.Namespace) -> None:
    from ..recording.info import report, summary

    found = summary(options.file)
    print(json.dumps(found) if options.json else report(found))


def _export(options: argparse.Namespace) -> None:
    from ..recording.export import export

    for path in export(options.file, options.to, options.out):
        print(printable(str(path)))
