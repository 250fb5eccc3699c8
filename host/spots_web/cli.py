"""The command ``spots serve``."""

from spots.cli import arguments
from spots.cli.parser import Parser, calls

from .panels import installed

HTTP_PORT = 8765

PURPOSE = "look at a board"


def serve(parser: Parser):
    """Show boards live in a web browser.

    examples:
      spots serve
      spots serve --http-port 8080
    """
    arguments.add_ports(parser, arguments.PRACTICE)
    arguments.add_layout(parser)
    parser.add_argument(
        "--address",
        default="127.0.0.1",
        help="address to listen on; 127.0.0.1 (only this machine) if not given; other machines "
        "need the token, which 'spots serve' prints",
    )
    parser.option(
        "--host",
        "NAME",
        "another name under which browsers reach this server, such as the name of a proxy; may be "
        "given several times",
        action="append",
    )
    parser.option(
        "--http-port",
        "N",
        "TCP port of the server; 8765 if not given, 0 for any free port",
        type=arguments.http_port,
        default=HTTP_PORT,
    )
    parser.option("--edit", "FILE.toml", "let browsers with the token change this key layout")
    parser.option(
        "--edit-controller",
        "FILE.toml",
        "let browsers with the token change these controller settings",
    )
    parser.option(
        "--edit-gestures", "FILE.toml", "let browsers with the token change the keys of gestures"
    )
    parser.option("--record-to", "FOLDER", "let browsers with the token record to this folder")
    parser.option(
        "--session",
        "FILE.jsonl",
        "let browsers with the token calibrate; this file stores the presses",
    )
    parser.flag(
        "--practice", "let browsers with the token practise a calibration; no file is written"
    )
    # Last: an option of a panel does not replace one of these.
    for panel in installed():
        panel.add_options(parser)
    return calls("spots_web.serve:serve_command")
