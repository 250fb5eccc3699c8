"""The command line; ``spots --help`` lists the commands."""

from __future__ import annotations

import argparse
import json
import math
import os
import sys

from . import __version__
from .errors import SpotsError


def main(arguments: list[str] | None = None) -> int:
    """Run a command; a mistake of the user's is one sentence and exit code 2."""
    options = _parser().parse_args(arguments)
    if getattr(options, "zenoh_config", None):
        os.environ["ZENOH_CONFIG"] = options.zenoh_config  # Zenoh's own name for it
    try:
        options.run(options)
    except SpotsError as error:
        print(f"spots: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        # Whoever read our output has seen enough.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="spots", description="SPOTS tactile sensor, host side")
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(metavar="COMMAND", required=True)

    ports = commands.add_parser("ports", help="list boards and what answers on each port")
    ports.add_argument("--json", action="store_true", help="one JSON list")
    ports.set_defaults(run=_ports)

    monitor = commands.add_parser("monitor", help="show a board's readings")
    _add_port(monitor)
    monitor.add_argument("--seconds", type=_seconds, help="end after so long")
    monitor.set_defaults(run=_monitor)

    demo = commands.add_parser("demo", help="the virtual board: real firmware, simulated sensor")
    demo.add_argument("--seconds", type=_seconds, help="end after so long (10 off a terminal)")
    demo.add_argument("--json", action="store_true", help="no picture; end with figures as JSON")
    demo.add_argument("--fast", action="store_true", help="simulated time, the same bytes each run")
    demo.add_argument("--page", action="store_true", help="a page in a web browser, until Ctrl-C")
    demo.add_argument(
        "--use", help="strip, keyboard, controller, wearable, fivebar; in this terminal"
    )
    _add_simulation(demo)
    demo.set_defaults(run=_demo, scenario=None)  # that of the use

    _add_serve(commands)
    _add_zenoh(commands)

    _add_uses(commands)

    _add_soak(commands)

    bench = commands.add_parser("bench", help="driver, firmware and host against their peers")
    bench.add_argument("--json", action="store_true", help="one JSON object")
    bench.set_defaults(run=_bench)

    calibrate = commands.add_parser("calibrate", help="a guided session: where to press, then fit")
    calibrate.add_argument("kind", choices=["position", "force", "strain", "joint"])
    _add_port(calibrate)
    calibrate.add_argument("--session", default="calibration.jsonl", metavar="FILE.jsonl")
    calibrate.add_argument("--out", metavar="FILE.toml", help="if not beside the session")
    calibrate.add_argument("--places", type=int, help="how many places, forces or angles")
    calibrate.add_argument("--length-mm", type=_length_mm, help="of the strip at rest")
    calibrate.add_argument("--strain-percent", type=_strain_percent, help="for 'strain'")
    calibrate.add_argument("--plan", help="six channels, as F3,F4,...; chosen if not given")
    calibrate.add_argument("--keep-settings", action="store_true", help="do not search the gain")
    calibrate.set_defaults(run=_calibrate)

    _add_characterize(commands)
    _add_design(commands)

    _add_recordings(commands)

    _add_boards(commands)
    _add_twin(commands)

    command = commands.add_parser("command", help="send a command line, print the reply")
    _add_port(command)
    command.add_argument("line", nargs="+", help="such as: set exposure_us=10000")
    command.set_defaults(run=_command)
    return parser


def _add_serve(commands) -> None:
    serve = commands.add_parser("serve", help="a live page of a board for web browsers")
    _add_ports(serve)
    serve.add_argument("--linkage", metavar="FILE.toml", help="of which the board is a joint")
    _add_simulation(serve)
    serve.add_argument("--layout", default="digits", metavar="FILE.toml", help="of keys; or a name")
    serve.add_argument("--address", default="127.0.0.1", help="show it to others, with a token")
    serve.add_argument("--http-port", type=_http_port, default=8765, help="0 for any")
    serve.add_argument("--record-to", metavar="FOLDER", help="let who has the token record")
    serve.set_defaults(run=_serve)


def _add_zenoh(commands) -> None:
    publish = commands.add_parser("publish", help="a board for other machines, over Zenoh")
    _add_port(publish)
    publish.add_argument("--seconds", type=_seconds, help="end after so long")
    publish.set_defaults(run=_publish)

    subscribe = commands.add_parser("subscribe", help="print what boards elsewhere feel, by Zenoh")
    subscribe.add_argument(
        "expression",
        nargs="?",
        default="spots/*/*/touch",
        metavar="EXPR",
        help="of keys, such as spots/**; the touches of all boards if not given",
    )
    subscribe.add_argument("--json", action="store_true", help="every sample, a JSON object a line")
    subscribe.add_argument("--seconds", type=_seconds, help="end after so long")
    _add_zenoh_config(subscribe)
    subscribe.set_defaults(run=_subscribe)


def _add_uses(commands) -> None:
    keys = commands.add_parser("keys", help="layouts of keys: looked at, checked, onto a board")
    keys.add_argument("what", choices=["check", "show", "push"])
    keys.add_argument("layout", metavar="FILE.toml", help="or a name, such as mini")
    _add_port(keys)
    keys.set_defaults(run=_keys)

    keyboard = commands.add_parser("keyboard", help="be a keyboard that a strip plays")
    _add_port(keyboard)
    keyboard.add_argument("--layout", default="digits", metavar="FILE.toml", help="or a name")
    keyboard.add_argument("--dry-run", action="store_true", help="print keys, be no keyboard")
    keyboard.add_argument("--seconds", type=_seconds, help="end after so long")
    keyboard.set_defaults(run=_keyboard)

    wearable = commands.add_parser("wearable", help="gestures on a worn strip to keys")
    _add_port(wearable)
    wearable.add_argument("--gestures", metavar="FILE.toml", help="the default if not given")
    wearable.add_argument("--dry-run", action="store_true", help="print keys, be no keyboard")
    wearable.add_argument("--seconds", type=_seconds, help="end after so long")
    wearable.set_defaults(run=_wearable)

    controller = commands.add_parser("controller", help="be a gamepad that a strip plays")
    _add_port(controller)
    controller.add_argument("--settings", metavar="FILE.toml", help="the default if not given")
    controller.add_argument("--dry-run", action="store_true", help="print states, be no gamepad")
    controller.add_argument("--calibrate", action="store_true", help="measure rest and ends")
    controller.add_argument("--seconds", type=_seconds, help="end after so long")
    controller.set_defaults(run=_controller)


def _add_soak(commands) -> None:
    parser = commands.add_parser("soak", help="hours of faults in simulated time, and a ledger")
    parser.add_argument("--hours", type=_hours, default=1.0, help="of simulated time (1)")
    parser.add_argument(
        *("--faults", "--scenario"), default="fire", metavar="FILE", help="scenario file or name"
    )
    parser.add_argument("--sensor", default="default", metavar="FILE", help="sensor file or name")
    parser.add_argument("--seed", type=_seed, default=0, help="of noise and faults")
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.set_defaults(run=_soak)


def _add_boards(commands) -> None:
    boards = commands.add_parser("boards", help="list the boards that there are files for")
    boards.add_argument("--json", action="store_true", help="one JSON list")
    boards.set_defaults(run=_boards)

    build = commands.add_parser("build", help="make a board's files, in build/BOARD")
    build.add_argument("board", metavar="BOARD")
    build.set_defaults(run=_build)

    flash = commands.add_parser("flash", help="put the firmware on a board and start it")
    flash.add_argument("board", metavar="BOARD")
    flash.add_argument("--port", help="serial port or CIRCUITPY drive; found if not given")
    flash.add_argument("--dry-run", action="store_true", help="only print what would be done")
    flash.set_defaults(run=_flash)

    erase = commands.add_parser("erase", help="remove firmware, settings and calibration")
    erase.add_argument("board", metavar="BOARD")
    erase.add_argument("--port", help="serial port or CIRCUITPY drive; found if not given")
    erase.add_argument("--yes", action="store_true", help="do not ask")
    erase.set_defaults(run=_erase)

    doctor = commands.add_parser("doctor", help="what is wrong with a board, and what to do")
    doctor.add_argument("--port", help="serial port, or 'virtual'; found if not given")
    doctor.set_defaults(run=_doctor)


def _add_characterize(commands) -> None:
    parser = commands.add_parser("characterize", help="measure a simulated sensor, on a stage")
    parser.add_argument("--sensor", default="default", metavar="FILE", help="sensor file or name")
    parser.add_argument("--seed", type=_seed, default=0, help="of the noise")
    parser.add_argument("--exposure-us", type=int, default=100_000, help="1000 to 1000000")
    parser.add_argument("--average", type=int, default=1, help="exposures a reading, 1 to 64")
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.add_argument("--out", metavar="DIR", help="draw figures there")
    parser.set_defaults(run=_characterize)


def _add_design(commands) -> None:
    parser = commands.add_parser("design", help="dye and exposure for a length and a resolution")
    parser.add_argument("--length-mm", type=float, required=True)
    parser.add_argument("--resolution-um", type=float, required=True)
    parser.add_argument("--rate-hz", type=float, required=True, help="readings a second")
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.add_argument("--out", metavar="DIR", help="write sensor file and figure there")
    parser.set_defaults(run=_design)


def _add_twin(commands) -> None:
    parser = commands.add_parser("twin", help="a five-bar linkage's twin, of boards or simulated")
    parser.add_argument("--linkage", default="default", metavar="FILE", help="file or name")
    parser.add_argument("--seconds", type=_seconds, help="end after so long")
    parser.add_argument("--json", action="store_true", help="a line each; simulated: the errors")
    _add_ports(parser)
    parser.add_argument(
        "--record", action="append", default=[], metavar="FILE.spots", help="once for each board"
    )
    group = parser.add_argument_group("what the linkage is")
    group.add_argument("--measure", metavar="POINTS.csv", help="ask where the terminal is")
    group.add_argument("--calibrate", metavar="POINTS.csv", help="find lengths and mounting")
    group.add_argument("--place-sigma-mm", type=_sigma_mm, default=0.1, help="of the points (0.1)")
    group.add_argument("--out", metavar="FILE.toml", help="the linkage file that was found")
    group = parser.add_argument_group("simulated linkage")
    group.add_argument("--path", default="sust", metavar="FILE", help="path file or name")
    group.add_argument("--sensor", default="default", metavar="FILE", help="sensor file or name")
    group.add_argument("--seed", type=_seed, default=0, help="of the noise")
    group.add_argument("--exposure-us", type=_exposure_us, default=30_000, help="of both strips")
    group.add_argument("--picture", metavar="FILE.png", help="draw path and truth")
    parser.set_defaults(run=_twin)


def _add_recordings(commands) -> None:
    record = commands.add_parser("record", help="write what a board sends into a file")
    record.add_argument("file", metavar="FILE.spots", help="a new file")
    _add_port(record)
    record.add_argument("--seconds", type=_seconds, help="end after so long; Ctrl-C ends it, too")
    record.add_argument(
        "--rotate-mb", type=_megabytes, help="go on in FILE-001.spots after so much"
    )
    record.add_argument("--calibration", metavar="FILE.toml", help="the board's, to have it there")
    record.set_defaults(run=_record)

    replay = commands.add_parser("replay", help="show a recording as 'monitor' shows a board")
    replay.add_argument("file", metavar="FILE.spots")
    replay.add_argument("--speed", type=_speed, default=1.0, help="2 is twice as fast, inf no pace")
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


def _add_port(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--port", help="serial port, 'virtual', recording:FILE or zenoh:ID; found if not given"
    )
    _add_zenoh_config(parser)
    _add_simulation(parser)


def _add_zenoh_config(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--zenoh-config", metavar="FILE", help="of Zenoh; else $ZENOH_CONFIG")


def _add_ports(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--port",
        action="append",
        default=[],
        help="serial port, 'virtual', recording:FILE or zenoh:ID; of a linkage, one a joint",
    )
    _add_zenoh_config(parser)


def _add_simulation(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("virtual board")
    group.add_argument("--sensor", default="default", metavar="FILE", help="sensor file or name")
    group.add_argument("--scenario", default="demo", metavar="FILE", help="scenario file or name")
    group.add_argument("--seed", type=_seed, default=0, help="of the noise")


def _number(what: str, low: float, high: float, kind: type = float):
    """Return a converter for argparse that takes numbers in a range."""

    def convert(text: str) -> float:
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{what} is a number from {low:g} to {high:g}")
        return value

    return convert


_seconds = _number("a time in seconds", 0.001, 1e9)
_hours = _number("a time in hours", 0.001, 10_000)
_length_mm = _number("the length of a strip in mm", 1, 1000)
_strain_percent = _number("a strain in percent", 0.01, 50)
_megabytes = _number("a size in MB", 0.1, 1e6)
_speed = _number("a speed", 0.001, math.inf)
_seed = _number("a seed", 0, 2**63, int)
_sigma_mm = _number("a standard error in mm", 1e-6, 100)
_http_port = _number("a port for web browsers", 0, 65535, int)
_exposure_us = _number("an exposure in us", 2000, 200_000, int)


def _open(options: argparse.Namespace):
    from .connect import open_named

    return open_named(options)


def _ports(options: argparse.Namespace) -> None:
    from .connect import survey

    rows = survey()
    if options.json:
        print(json.dumps(rows))
    elif not rows:
        print("no USB serial port; plug a board in, or use port 'virtual'")
    for row in [] if options.json else rows:
        print(f"{row['port']}  {row['device']}  {row['answer']}")


def _monitor(options: argparse.Namespace) -> None:
    from .watch import watch

    with _open(options) as board:
        watch(board, options.seconds, quiet=False)


def _demo(options: argparse.Namespace) -> None:
    from .web import browser

    plain = options.seconds is options.use is None and not (options.json or options.fast)
    if options.page or (plain and browser.opens()):
        from .web.serve import show_demo

        show_demo(options.use, options.sensor, options.scenario or "demo", options.seed)
        return
    from .demo import demo

    seconds = options.seconds
    if seconds is None and not sys.stdout.isatty():
        seconds = 10.0
    summary = demo(
        options.sensor,
        options.scenario,
        options.seed,
        seconds,
        options.fast,
        options.json,
        options.use or "strip",
    )
    if options.json:
        print(json.dumps(summary))


def _serve(options: argparse.Namespace) -> None:
    from .web.serve import run

    run(options)


def _publish(options: argparse.Namespace) -> None:
    from .remote.publish import run

    run(options)


def _subscribe(options: argparse.Namespace) -> None:
    from .remote.subscribe import run

    run(options)


def _keys(options: argparse.Namespace) -> None:
    from .uses import keys

    if options.what == "check":
        keys.check(options.layout)
    elif options.what == "show":
        keys.show(options.layout)
    else:
        layout = keys.load(options.layout)
        with _open(options) as board:
            note = keys.push(board, layout)
        print(f"{layout.name} is on the board" + (f": {note}" if note else ""))


def _keyboard(options: argparse.Namespace) -> None:
    from .uses.type_keys import run

    run(options)


def _wearable(options: argparse.Namespace) -> None:
    from .uses.wearable import run

    run(options)


def _controller(options: argparse.Namespace) -> None:
    from .uses.play import run

    run(options)


def _soak(options: argparse.Namespace) -> None:
    from .soak import run

    run(options.hours, options.faults, options.seed, options.sensor, options.json)


def _bench(options: argparse.Namespace) -> None:
    from .bench import report, run

    results = run()
    print(json.dumps(results) if options.json else report(results))


def _calibrate(options: argparse.Namespace) -> None:
    from .calibrate.command import run

    run(options)


def _characterize(options: argparse.Namespace) -> None:
    from .calibrate.measure import measure

    measure(
        options.sensor,
        options.seed,
        options.exposure_us,
        options.average,
        options.json,
        options.out,
    )


def _design(options: argparse.Namespace) -> None:
    from .calibrate.design import run

    run(options.length_mm, options.resolution_um, options.rate_hz, options.json, options.out)


def _record(options: argparse.Namespace) -> None:
    from .recording.command import record

    rotate_bytes = options.rotate_mb and round(1e6 * options.rotate_mb)
    with _open(options) as board:
        record(board, options.file, options.seconds, rotate_bytes, options.calibration)


def _replay(options: argparse.Namespace) -> None:
    from .recording.replay import open_recording
    from .watch import watch

    with open_recording(options.file, options.speed) as board:
        watch(board, None, quiet=False)


def _info(options: argparse.Namespace) -> None:
    from .recording.summary import report, summary

    found = summary(options.file)
    print(json.dumps(found) if options.json else report(found))


def _export(options: argparse.Namespace) -> None:
    from .recording.export import export

    for path in export(options.file, options.to, options.out):
        print(path)


def _boards(options: argparse.Namespace) -> None:
    from .stage import board_names, device_of

    rows = [
        {
            "name": device.name,
            "title": device.title,
            "runtime": device.runtime,
            "arch": device.march,
            "sda": device.wiring.get("sda"),
            "scl": device.wiring.get("scl"),
        }
        for device in map(device_of, board_names())
    ]
    if options.json:
        print(json.dumps(rows))
        return
    table = [list(rows[0])] + [[value or "-" for value in row.values()] for row in rows]
    widths = [max(map(len, column)) for column in zip(*table)]
    for line in table:
        print("  ".join(cell.ljust(width) for cell, width in zip(line, widths)).rstrip())


def _build(options: argparse.Namespace) -> None:
    from .build import build

    print(build(options.board))


def _flash(options: argparse.Namespace) -> None:
    from .flash import flash

    flash(options.board, options.port, options.dry_run)


def _erase(options: argparse.Namespace) -> None:
    from .erase import erase

    erase(options.board, options.port, options.yes)


def _doctor(options: argparse.Namespace) -> None:
    from .doctor import doctor

    doctor(options.port)


def _twin(options: argparse.Namespace) -> None:
    from .uses.twin_command import run

    run(options)


def _command(options: argparse.Namespace) -> None:
    with _open(options) as board:
        print(json.dumps(board.command(" ".join(options.line))))


if __name__ == "__main__":
    sys.exit(main())
