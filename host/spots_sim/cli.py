"""Commands of the laboratory: the demonstration, and measuring and designing a simulated sensor."""

from __future__ import annotations

import argparse
import json
import sys

from spots.cli import arguments
from spots.errors import SpotsError


def add(commands) -> None:
    """Add the commands to a parser's subparsers."""
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
    _add_change(demo)
    demo.set_defaults(run=_demo, scenario=None)  # that of the use

    characterize = commands.add_parser(
        "characterize", help="measure a simulated sensor, on a stage"
    )
    characterize.add_argument(
        "--sensor", default="default", metavar="FILE", help="sensor file or name"
    )
    _add_change(characterize)
    characterize.add_argument("--seed", type=arguments.seed, default=0, help="of the noise")
    characterize.add_argument("--exposure-us", type=int, default=100_000, help="1000 to 1000000")
    characterize.add_argument("--average", type=int, default=1, help="exposures a reading, 1 to 64")
    characterize.add_argument(
        "--rezero", type=int, default=0, metavar="MARKS", help="after the change: 0, 1 or 3 marks"
    )
    characterize.add_argument("--presses", type=arguments.presses, default=1, help="of each mark")
    characterize.add_argument(
        "--mark-error-um", type=float, default=0.0, help="standard deviation of each press"
    )
    characterize.add_argument("--json", action="store_true", help="one JSON object")
    characterize.add_argument("--out", metavar="DIR", help="draw figures there")
    characterize.set_defaults(run=_characterize)

    design = commands.add_parser("design", help="dye and exposure for a length and a resolution")
    design.add_argument("--length-mm", type=float, required=True)
    design.add_argument("--resolution-um", type=float, required=True)
    design.add_argument("--rate-hz", type=float, required=True, help="readings a second")
    design.add_argument("--json", action="store_true", help="one JSON object")
    design.add_argument("--out", metavar="DIR", help="write sensor file and figure there")
    design.set_defaults(run=_design)


def _add_change(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--change", metavar="FILE", help="what changed since the calibration")


def _demo(options: argparse.Namespace) -> None:
    from .files import changed

    _check(options)
    with changed(options.sensor, options.change) as options.sensor:
        _demonstrate(options)


def _demonstrate(options: argparse.Namespace) -> None:
    from spots.web import browser

    plain = options.seconds is options.use is None and not (options.json or options.fast)
    if options.page or (plain and browser.opens()):
        from .demo import show_page

        show_page(options.use, options.sensor, options.scenario or "demo", options.seed)
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


def _check(options: argparse.Namespace) -> None:
    """Raise SpotsError for options of the demo that do not go together."""
    from .demo import FIVEBAR

    if options.page and (options.seconds or options.json or options.fast):
        raise SpotsError(
            "--page is shown in real time until Ctrl-C: leave out --seconds, --json and --fast"
        )
    if options.use == FIVEBAR and options.scenario:
        raise SpotsError("--use fivebar goes along a path of its own: leave out --scenario")
    if options.use == FIVEBAR and options.fast and options.seconds:
        raise SpotsError("--use fivebar --fast goes along its path once: leave out --seconds")


def _characterize(options: argparse.Namespace) -> None:
    from .characterize import measure
    from .rezeroed import Hand

    measure(
        options.sensor,
        options.seed,
        options.exposure_us,
        options.average,
        options.json,
        options.out,
        options.change,
        Hand(options.rezero, options.presses, options.mark_error_um),
    )


def _design(options: argparse.Namespace) -> None:
    from .design import design_command

    design_command(
        options.length_mm, options.resolution_um, options.rate_hz, options.json, options.out
    )
