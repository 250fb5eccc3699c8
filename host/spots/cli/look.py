"""Commands that show a board."""

from __future__ import annotations

import argparse
import json
import sys

from ..errors import SpotsError
from . import arguments


def add(commands) -> None:
    """Add the commands to a parser's subparsers."""
    monitor = commands.add_parser("monitor", help="show a board's readings")
    arguments.add_port(monitor)
    monitor.add_argument("--seconds", type=arguments.seconds, help="end after so long")
    monitor.set_defaults(run=_monitor)

    demo = commands.add_parser("demo", help="the virtual board: real firmware, simulated sensor")
    demo.add_argument(
        "--seconds", type=arguments.seconds, help="end after so long (10 off a terminal)"
    )
    demo.add_argument("--json", action="store_true", help="no picture; end with figures as JSON")
    demo.add_argument("--fast", action="store_true", help="simulated time, the same bytes each run")
    demo.add_argument("--page", action="store_true", help="a page in a web browser, until Ctrl-C")
    demo.add_argument(
        "--use", help="strip, keyboard, controller, wearable, fivebar; in this terminal"
    )
    arguments.add_simulation(demo)
    demo.set_defaults(run=_demo, scenario=None)  # that of the use

    serve = commands.add_parser("serve", help="a live page of a board for web browsers")
    arguments.add_ports(serve)
    serve.add_argument("--linkage", metavar="FILE.toml", help="of which the board is a joint")
    arguments.add_simulation(serve)
    serve.add_argument("--layout", default="digits", metavar="FILE.toml", help="of keys; or a name")
    serve.add_argument("--address", default="127.0.0.1", help="show it to others, with a token")
    serve.add_argument("--http-port", type=arguments.http_port, default=8765, help="0 for any")
    serve.add_argument("--record-to", metavar="FOLDER", help="let who has the token record")
    serve.set_defaults(run=_serve)


def _monitor(options: argparse.Namespace) -> None:
    from ..terminal.monitor import watch

    with arguments.open_board(options) as board:
        watch(board, options.seconds, quiet=False)


def _demo(options: argparse.Namespace) -> None:
    from ..web import browser

    _check(options)
    plain = options.seconds is options.use is None and not (options.json or options.fast)
    if options.page or (plain and browser.opens()):
        from ..web.serve import show_demo

        show_demo(options.use, options.sensor, options.scenario or "demo", options.seed)
        return
    from spots_sim.demo import demo

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


def _check(options: argparse.Namespace) -> None:
    """Raise SpotsError for options of the demo that do not go together."""
    from spots_sim.demo import FIVEBAR

    if options.page and (options.seconds or options.json or options.fast):
        raise SpotsError(
            "--page is shown in real time until Ctrl-C: leave out --seconds, --json and --fast"
        )
    if options.use == FIVEBAR and options.scenario:
        raise SpotsError("--use fivebar goes along a path of its own: leave out --scenario")
    if options.use == FIVEBAR and options.fast and options.seconds:
        raise SpotsError("--use fivebar --fast goes along its path once: leave out --seconds")


def _serve(options: argparse.Namespace) -> None:
    from ..web.serve import run

    run(options)
