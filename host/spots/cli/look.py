"""Commands that show a board."""

from __future__ import annotations

import argparse

from . import arguments


def add(commands) -> None:
    """Add the commands to a parser's subparsers."""
    monitor = commands.add_parser("monitor", help="show a board's readings")
    arguments.add_port(monitor)
    monitor.add_argument("--seconds", type=arguments.seconds, help="end after so long")
    monitor.set_defaults(run=_monitor)

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


def _serve(options: argparse.Namespace) -> None:
    from ..web.serve import serve_command

    serve_command(options)
