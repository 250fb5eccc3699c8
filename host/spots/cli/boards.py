"""Commands that make a board ready: find, flash, check and calibrate it."""

import argparse
import json

from spots_device.board.light import LEDS

from ..errors import printable
from ..link.ports import known
from . import arguments
from .parser import Parser, calls

PURPOSE = "set up a board"


def ports(parser: Parser):
    """List the USB serial ports and the board on each.

    example:
      spots ports --json
    """
    parser.flag("--json", "print one JSON list")
    return _ports


def boards(parser: Parser):
    """List the boards that SPOTS has files for.

    example:
      spots boards --json
    """
    parser.flag("--json", "print one JSON list")
    return _boards


def build(parser: Parser):
    """Write a board's files to build/BOARD.

    example:
      spots build pico
    """
    parser.option("board", "BOARD", "a name that 'spots boards' lists")
    _add_strips(parser)
    return _build


def flash(parser: Parser):
    """Copy the firmware to a board, and restart the board.

    examples:
      spots flash pico
      spots flash pico --dry-run
      spots flash pico --runtime RPI_PICO.uf2
      spots flash pico --runtime RPI_PICO.uf2 --layout mini --led gpio
    """
    _add_board(parser)
    parser.flag("--dry-run", "print which files would change, but copy nothing")
    parser.option(
        "--runtime",
        "FILE.uf2",
        "for a board in its boot loader: copy MicroPython or CircuitPython, as downloaded, and the "
        "firmware; erases the board",
    )
    parser.flag("--yes", "with --runtime: do not ask for a confirmation")
    _add_first_start(parser, "with --runtime: ")
    parser.needs(
        ["--yes", "--layout", "--led"], lambda options: options.runtime, "add --runtime FILE.uf2"
    )
    parser.needs(
        ["--dry-run"],
        lambda options: not options.runtime,
        "to write the file that --runtime copies, use 'spots image'",
    )
    _add_strips(parser)
    return _flash


def image(parser: Parser):
    """Write one file that turns a bare board into a SPOTS board: runtime, firmware, layout.

    Copying this file to a board erases the board's settings, calibration and other files. 'spots
    flash' keeps them.

    examples:
      spots image pico --runtime RPI_PICO.uf2 --out spots-pico.uf2
      spots image pico --runtime RPI_PICO.uf2 --out keyboard.uf2 --layout mini
    """
    parser.option("board", "BOARD", "a name that 'spots boards' lists")
    parser.option(
        "--runtime",
        "FILE",
        "MicroPython or CircuitPython for this board, as downloaded: .uf2, or .bin for an ESP32-S3",
        required=True,
    )
    parser.option("--out", "FILE", "file to write, of the same kind", required=True)
    _add_first_start(parser)
    _add_strips(parser)
    return _image


def doctor(parser: Parser):
    """Check a board, its LED and its calibration, and print a remedy for each problem.

    examples:
      spots doctor
      spots doctor --port /dev/ttyACM0
      spots doctor --mark 40
    """
    parser.add_argument("--port", help=f"{arguments.PORTS}; the only board on USB if not given")
    parser.option(
        "--mark",
        "MM",
        "also ask for a press at this distance from the sensor's end, and print its error",
        type=arguments.number("a place on the strip in mm", 0, 1000),
    )
    return calls("spots.deploy.doctor:doctor", "port", "mark")


def calibrate(parser: Parser):
    """Calibrate a strip: a guided session asks for presses and computes the calibration.

    examples:
      spots calibrate --practice
      spots calibrate --rough
      spots calibrate
      spots calibrate strain --strain-percent 10
    """
    parser.option(
        "kind",
        "KIND",
        "fine (with ruler and scale; the default), position, force, strain or joint",
        nargs="?",
        default="fine",
        choices=["fine", "position", "force", "strain", "joint"],
    )
    parser.flag("--rough", "for a fingertip and a ruler, without a scale; forces are then relative")
    parser.flag("--practice", "practise a session without a strip; no file is written")
    arguments.add_port(parser, arguments.READ_ONLY, arguments.PRACTICE)
    parser.option(
        "--session",
        "FILE.jsonl",
        "file for the presses; an existing file continues its session; calibration.jsonl if not "
        "given",
    )
    parser.option(
        "--out", "FILE.toml", "calibration file to write; named like the session if not given"
    )
    parser.option(
        "--places",
        "N",
        "number of presses, positions, forces or angles to take, depending on KIND",
        type=arguments.whole,
    )
    parser.option(
        "--length-mm",
        "N",
        "length of the strip at rest in mm; if not given, that of the session, or 85",
        type=arguments.length_mm,
    )
    parser.option(
        "--strain-percent",
        "N",
        "strain of the strip in percent, for KIND 'strain'",
        type=arguments.strain_percent,
    )
    parser.option(
        "--channels",
        "F3,F4,...",
        "six channels to measure; if not given, the best ones, but with --rough or led=always the "
        "present ones",
    )
    parser.flag("--keep-settings", "do not adjust gain and LED current")
    chooses = "--channels", "--keep-settings"
    parser.needs(
        chooses,
        lambda options: options.kind not in ("strain", "joint"),
        "the session has these settings already",
    )
    parser.needs(
        ["--length-mm"], lambda options: options.kind != "joint", "a joint needs no length"
    )
    return calls("spots.calibrate.session.calibrate:calibrate_command")


def rezero(parser: Parser):
    """Correct the drift of a calibrated strip: press its three marks again.

    examples:
      spots rezero
      spots rezero mine.toml --presses 3
    """
    parser.add_argument(
        "calibration",
        nargs="?",
        default="calibration.toml",
        metavar="FILE.toml",
        help="calibration file to correct; calibration.toml if not given",
    )
    arguments.add_port(parser, arguments.READ_ONLY)
    parser.option(
        "--marks",
        "N",
        "number of marks to press, 1, 3, 5 or 9; 3 if not given. One cannot correct a bleached "
        "dye, three cannot correct a dye that has changed at one place",
        choices=("1", "3", "5", "9"),
        default="3",
    )
    parser.option(
        "--with",
        "PRESSER",
        "what presses the marks, finger or indenter; if not given, what uses the strip",
        dest="presser",
        choices=("finger", "indenter"),
    )
    parser.option(
        "--use",
        "PRESSER",
        "press nothing; the board gets the tables for a finger or an indenter from the file",
        choices=("finger", "indenter"),
    )
    parser.flag("--joint", "use the lowest, a middle and the highest angle of a joint as marks")
    parser.option(
        "--presses", "N", "number of presses at each mark", type=arguments.presses, default=1
    )
    parser.option(
        "--force-N",
        "N",
        "force of each press in N, read from a scale; corrects the force, too",
        type=arguments.force_N,
    )
    parser.needs(
        ["--force-N", "--with"],
        lambda options: not (options.joint or options.use),
        "a joint presses with its own indenter, and --use not at all",
    )
    parser.needs(
        ["--joint", "--presses", "--marks"],
        lambda options: not options.use,
        "--use presses nothing",
    )
    parser.set_defaults(length_mm=None)
    return calls("spots.calibrate.session.calibrate:rezero_command")


def dark(parser: Parser):
    """Take the dark frame of a board that cannot switch its LED off: asks you to unplug the LED.

    example:
      spots dark
    """
    arguments.add_port(parser, arguments.READ_ONLY)
    return calls("spots.calibrate.session.dark:dark_command")


def erase(parser: Parser):
    """Remove the firmware, the settings, the calibration and the layout from a board.

    example:
      spots erase pico
    """
    _add_board(parser)
    parser.flag("--yes", "do not ask for a confirmation")
    return calls("spots.deploy.erase:erase", "board", "port", "yes")


COMMANDS = ports, boards, build, flash, image, doctor, dark, calibrate, rezero, erase


def _add_strips(parser: Parser) -> None:
    parser.option(
        "--strips",
        "N",
        "number of strips on the board; 1 if not given",
        type=arguments.whole,
        default=1,
    )


def _add_first_start(parser: Parser, when: str = "") -> None:
    parser.option(
        "--layout",
        "LAYOUT",
        f"{when}key layout: the board is then a keyboard as soon as it has a calibration",
    )
    parser.option(
        "--led", "KIND", f"{when}connection of the strip's LED: {', '.join(LEDS)}", choices=LEDS
    )


def _add_board(parser: Parser) -> None:
    parser.option("board", "BOARD", "a name that 'spots boards' lists")
    parser.add_argument(
        "--port", help="serial port or CIRCUITPY drive; the only connected board if not given"
    )


def _ports(options: argparse.Namespace) -> None:
    from ..link.connect import survey

    rows = survey()
    lines = ["  ".join(map(printable, row.values())) for row in rows]
    none = f"no USB serial port: plug a board in; other commands also take --port {known()}"
    print(json.dumps(rows) if options.json else "\n".join(lines or [none]))


def _boards(options: argparse.Namespace) -> None:
    from ..deploy.staging import board_names, device_of

    rows = [
        {"name": one.name, "title": one.title, "runtime": one.runtime, "arch": one.march}
        | {wire: one.wiring.get(wire) for wire in ("sda", "scl", "led")}
        for one in map(device_of, board_names())
    ]
    if options.json:
        print(json.dumps(rows))
        return
    table = [list(rows[0])] + [[printable(value or "-") for value in row.values()] for row in rows]
    widths = [max(map(len, column)) for column in zip(*table)]
    for line in table:
        print("  ".join(cell.ljust(width) for cell, width in zip(line, widths)).rstrip())


def _build(options: argparse.Namespace) -> None:
    from ..deploy.build import build

    print(printable(str(build(options.board, strips=options.strips))))


def _flash(options: argparse.Namespace) -> None:
    if options.runtime is None:
        from ..deploy.flash import flash

        flash(options.board, options.port, options.dry_run, options.strips)
        return
    from ..deploy.bootsel import install

    install(
        options.board,
        options.runtime,
        options.port,
        options.strips,
        _layout(options),
        options.led,
        options.yes,
    )


def _image(options: argparse.Namespace) -> None:
    from ..deploy.image import image

    layout = _layout(options)
    image(options.board, options.runtime, options.out, options.strips, layout, options.led)


def _layout(options: argparse.Namespace) -> list[str]:
    if options.layout is None:
        return []
    from ..keyboard.layout import load

    return load(options.layout).lines
