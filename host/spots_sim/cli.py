"""The commands ``spots demo`` and ``spots characterize``."""

from __future__ import annotations

import argparse
import json
import sys

from spots.cli import arguments
from spots.cli.parser import Parser
from spots.errors import SettingError

from .options import add_options

PURPOSE = "simulate, without hardware"


def demo(parser: Parser):
    """Watch a virtual board: real firmware on a simulated sensor.

    examples:
      spots demo
      spots demo --use keyboard --seconds 10
    """
    arguments.add_seconds(
        parser, "stop after this time in seconds; 10 if the output is not a terminal"
    )
    parser.add_argument("--json", action="store_true", help="print only the results, as JSON")
    parser.add_argument(
        "--fast",
        action="store_true",
        help="run in simulated time: the output is the same in each run",
    )
    parser.add_argument(
        "--page", action="store_true", help="open the web UI in a browser, until Ctrl-C"
    )
    parser.add_argument(
        "--use",
        help="application to run: strip (if not given), keyboard, controller, wearable or fivebar",
    )
    parser.add_argument(
        "--layout",
        metavar="FILE",
        help="key layout of --use keyboard: a .toml file, or a name such as mini",
    )
    add_options(parser)
    _add_change(parser)
    parser.add_argument(
        "--rezero",
        action="store_true",
        help="correct the calibration after the change (--change) with simulated presses; needs "
        "--fast",
    )
    parser.add_argument("--warm", action="store_true", help="start with a warm LED; needs --fast")
    parser.add_argument(
        "--cpu",
        metavar="NAME",
        help="give the firmware the speed of this processor: pico or pico-xip50; needs --fast",
    )
    parser.set_defaults(sensor="default", seed=0)
    parser.set_defaults(scenario=None)  # the default depends on the application
    return _demo


def characterize(parser: Parser):
    """Measure the accuracy of a simulated sensor.

    examples:
      spots characterize
      spots characterize --sensor long_200mm --exposure-us 10000
      spots characterize --change phosphor --rezero 3
    """
    parser.add_argument(
        "--sensor",
        default="default",
        metavar="FILE",
        help="simulated strip and sensor: a .toml file, or a name such as default",
    )
    parser.add_argument("--seed", type=arguments.seed, default=0, help="random seed of the noise")
    parser.add_argument(
        "--exposure-us",
        type=arguments.whole,
        default=100_000,
        help="integration time in us, 1000 to 1000000",
    )
    parser.add_argument(
        "--average", type=arguments.whole, default=1, help="samples averaged in a reading, 1 to 64"
    )
    _add_change(parser)
    parser.add_argument(
        "--rezero",
        type=arguments.whole,
        default=0,
        metavar="MARKS",
        help="correct the calibration after the change (--change) with simulated presses on this "
        "number of marks: 0, 1 or 3",
    )
    parser.add_argument(
        "--presses",
        type=arguments.presses,
        default=1,
        help="number of presses on each mark of --rezero",
    )
    parser.add_argument(
        "--mark-error-um",
        type=arguments.finite,
        default=0.0,
        help="standard deviation of the position of a press on a mark, in um",
    )
    presses = "--presses", "--mark-error-um"
    parser.needs(presses, lambda options: options.rezero, "add --rezero 3")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--out", metavar="DIR", help="draw figures into this folder")
    return _characterize


def _add_change(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--change",
        metavar="FILE",
        help="change of the sensor since its calibration: a .toml file, or a name such as warm",
    )


def _demo(options: argparse.Namespace) -> None:
    from .strip.files import changed

    _check(options)
    with changed(options.sensor, options.change) as options.sensor:
        _demonstrate(options)


def _demonstrate(options: argparse.Namespace) -> None:
    from .demo import browser

    plain = options.seconds is options.use is None and not (options.json or options.fast)
    if options.page or (plain and browser.opens()):
        from .demo.demo import show_page

        scenario = options.scenario or "demo"
        show_page(options.use, options.sensor, scenario, options.seed, options.layout)
        return
    from .demo.demo import KEYBOARD, demo

    seconds = options.seconds
    scored = options.use == KEYBOARD and options.json  # such a run ends with its scenario
    if seconds is None and not scored and not sys.stdout.isatty():
        seconds = 10.0
    summary = demo(
        options.sensor,
        options.scenario,
        options.seed,
        seconds,
        options.fast,
        options.json,
        options.use or "strip",
        options.layout,
        options.rezero,
        options.warm,
        options.cpu,
    )
    if options.json:
        print(json.dumps(summary))


def _check(options: argparse.Namespace) -> None:
    """Raise SettingError for options of the demo that do not fit together."""
    from .demo.demo import FIVEBAR, KEYBOARD

    if options.layout and options.use != KEYBOARD:
        raise SettingError("--layout needs a keyboard: add --use keyboard")

    fast_only = options.rezero or options.warm or options.cpu
    if options.page and (options.seconds or options.json or options.fast or fast_only):
        raise SettingError(
            "--page always runs in real time until Ctrl-C: leave out --seconds, --json, --fast, "
            "--rezero, --warm and --cpu"
        )
    if fast_only and (not options.fast or options.use == FIVEBAR):
        raise SettingError(
            "--rezero, --warm and --cpu need simulated time and one strip: add --fast, and leave "
            "out --use fivebar"
        )
    if options.use == FIVEBAR and options.scenario:
        raise SettingError("--use fivebar has a fixed scenario: leave out --scenario")
    if options.use == FIVEBAR and options.fast and options.seconds:
        raise SettingError("--use fivebar --fast ends at the end of its path: leave out --seconds")


def _characterize(options: argparse.Namespace) -> None:
    from .measure.characterize import measure
    from .measure.rezeroed import Hand

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
