"""The command ``spots design``."""

from __future__ import annotations

import argparse

from spots.cli import arguments
from spots.cli.parser import Parser

PURPOSE = "make a strip"


def design(parser: Parser):
    """Find the dye and exposure for a strip, and make its moulds, drawings and recipe.

    examples:
      spots design --length-mm 85 --resolution-um 50 --rate-hz 100
      spots design --length-mm 85 --resolution-um 50 --rate-hz 100 --out strip --strips 2
      spots design --length-mm 85 --resolution-um 50 --rate-hz 100 --measure-dye --test-dose 2
    """
    parser.add_argument(
        "--length-mm", type=arguments.finite, required=True, help="length of the strip in mm"
    )
    parser.add_argument(
        "--resolution-um",
        type=arguments.finite,
        required=True,
        help="position resolution to reach, in um",
    )
    parser.add_argument(
        "--rate-hz", type=arguments.finite, required=True, help="readings per second"
    )
    parser.flag("--json", "print one JSON object")
    parser.option(
        "--out",
        "DIR",
        "write sensor file, figure, moulds, drawings, recipe and parts into this folder; "
        "not one that has a design",
    )
    parser.option(
        "--strips",
        "N",
        "number of strips in the recipe; 1 if not given",
        type=arguments.whole,
        default=1,
    )
    parser.option(
        "--breakout",
        "NAME",
        "AS7341 breakout that the caps must fit: adafruit-4698 (if not given) or sparkx-17719",
        default="adafruit-4698",
    )
    parser.flag("--measure-dye", "read a clear and a dyed test piece, and print the dose of dye")
    parser.option(
        "--test-dose",
        "G",
        "dose of the dyed test piece: g of tint in 100 g of rubber; 2 if not given",
        type=_dose,
        default=2.0,
    )
    parser.option(
        "--test-length-mm",
        "N",
        "length of both test pieces in mm; 60 if not given",
        type=_test_mm,
        default=60.0,
    )
    arguments.add_port(parser, arguments.READ_ONLY)
    measures = "--port", "--sensor", "--test-dose", "--test-length-mm"
    parser.needs(measures, lambda options: options.measure_dye, "add --measure-dye")
    parser.needs(["--out"], lambda options: not options.measure_dye, "leave out --measure-dye")
    parser.needs(["--breakout"], lambda options: options.out, "add --out DIR")
    parser.needs(["--strips"], lambda options: options.out or options.measure_dye, "add --out DIR")
    return _design


_dose = arguments.number("a dose in g per 100 g", 1e-4, 60)
_test_mm = arguments.number("the length of a test piece in mm", 10, 300)


def _design(options: argparse.Namespace) -> None:
    if options.measure_dye:
        from .dye_dose import measure_dye_command

        measure_dye_command(options)
        return
    from .design import design_command

    design_command(options)
