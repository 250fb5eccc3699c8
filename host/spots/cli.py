"""The command line: ``spots ports | monitor | demo | bench | command``."""

from __future__ import annotations

import argparse
import json
import os
import sys

from . import __version__
from .errors import SpotsError


def main(arguments: list[str] | None = None) -> int:
    """Run a command; a mistake of the user's is one sentence and exit code 2."""
    options = _parser().parse_args(arguments)
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
    _add_simulation(demo)
    demo.set_defaults(run=_demo)

    bench = commands.add_parser("bench", help="driver, firmware and host against their peers")
    bench.add_argument("--json", action="store_true", help="one JSON object")
    bench.set_defaults(run=_bench)

    command = commands.add_parser("command", help="send a command line, print the reply")
    _add_port(command)
    command.add_argument("line", nargs="+", help="such as: set exposure_us=10000")
    command.set_defaults(run=_command)
    return parser


def _add_port(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--port", help="serial port, or 'virtual'; found if not given")
    _add_simulation(parser)


def _add_simulation(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("virtual board")
    group.add_argument("--sensor", default="default", metavar="FILE", help="sensor file or name")
    group.add_argument("--scenario", default="demo", metavar="FILE", help="scenario file or name")
    group.add_argument("--seed", type=_seed, default=0, help="of the noise")


def _seconds(text: str) -> float:
    value = float(text)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError("seconds must be greater than 0")
    return value


def _seed(text: str) -> int:
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError("a seed is 0 or greater")
    return value


def _open(options: argparse.Namespace):
    from .connect import open

    return open(options.port, sensor=options.sensor, scenario=options.scenario, seed=options.seed)


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
    from .demo import watch

    with _open(options) as board:
        watch(board, options.seconds, quiet=False)


def _demo(options: argparse.Namespace) -> None:
    from .demo import demo

    seconds = options.seconds
    if seconds is None and not sys.stdout.isatty():
        seconds = 10.0
    summary = demo(
        options.sensor, options.scenario, options.seed, seconds, options.fast, quiet=options.json
    )
    if options.json:
        print(json.dumps(summary))


def _bench(options: argparse.Namespace) -> None:
    from .bench import report, run

    results = run()
    print(json.dumps(results) if options.json else report(results))


def _command(options: argparse.Namespace) -> None:
    with _open(options) as board:
        print(json.dumps(board.command(" ".join(options.line))))


if __name__ == "__main__":
    sys.exit(main())
